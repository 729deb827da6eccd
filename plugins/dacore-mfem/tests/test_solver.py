"""MFEM's Krylov solvers keep the promises of a solver, and what is particular to them."""

import gc
import multiprocessing
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import block_array, block_diag, csr_array

from dacore.core.fields import Field
from dacore.errors import ConvergenceError, SceneError, ShapeError
from dacore.plugins.registry import load
from dacore.plugins.settings import build
from dacore.testing import solver_suite
from dacore.testing.meshes import shuffled_box
from dacore.testing.silence import written_by
from dacore.testing.solvers import System, elastic_step, poroelastic_step
from dacore_mfem.krylov import MfemKrylov

pytest.importorskip("mfem")

METHODS = [
    MfemKrylov(),
    MfemKrylov(sweeps=2),
    MfemKrylov("gmres", restart=30),
    MfemKrylov("minres"),
    MfemKrylov("bicgstab", "gauss_seidel"),
    MfemKrylov("gmres", "ilu"),
    MfemKrylov("minres", "jacobi"),
]
test_defaults, test_sweeps, test_gmres, test_minres, test_gauss_seidel, test_ilu, test_jacobi = (
    solver_suite(method).as_test() for method in METHODS
)


def solve(system, method, tolerance=1e-8, columns=2):
    """The method's solver after a solve, and how far the answer is from numpy's."""
    rhs = np.random.default_rng(0).standard_normal((len(system.nodes), columns)) / system.scale[:, None]
    solver = method.prepare(system.matrix, system.definite, tolerance)
    given = solver.solve(rhs)
    exact = np.linalg.solve(system.matrix.toarray(), rhs)
    return solver, np.linalg.norm((given - exact) / system.scale[:, None]) / np.linalg.norm(
        exact / system.scale[:, None]
    )


def test_a_scene_finds_it_by_name():
    cls = load().get("solver", "mfem_krylov")
    assert cls is MfemKrylov
    table = {"iteration": "gmres", "preconditioner": "ilu", "restart": 20}
    assert build(cls, table, "scene.toml: solver") == MfemKrylov("gmres", "ilu", restart=20)
    with pytest.raises(SceneError, match=r"scene.toml: solver\.iteration: got 'bicg', expected 'bicgstab' or"):
        build(cls, {"iteration": "bicg"}, "scene.toml: solver")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"iteration": "qmr"}, "iteration: got 'qmr', expected one of bicgstab, gmres, minres, cg"),
        ({"preconditioner": "amg"}, "preconditioner: got 'amg', expected one of blocks, gauss_seidel, ilu, jacobi"),
        ({"sweeps": 0}, "sweeps: got 0, expected a whole number of at least 1"),
        ({"restart": -3}, "restart: got -3"),
        ({"max_iterations": 2.5}, "max_iterations: got 2.5"),
        ({"max_iterations": True}, "max_iterations: got True"),
        ({"iteration": "minres", "preconditioner": "ilu"}, "minres needs a positive definite preconditioner"),
        ({"iteration": "cg", "preconditioner": "gauss_seidel"}, "use blocks or jacobi, or bicgstab or gmres"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(ShapeError, match=re.escape(message)):
        MfemKrylov(**settings)


@pytest.mark.parametrize("preconditioner", ["blocks", "jacobi"])
def test_conjugate_gradients_are_for_positive_definite_matrices(preconditioner):
    method = MfemKrylov("cg", preconditioner)
    solver, error = solve(elastic_step(), method)
    assert error < 1e-6
    assert re.fullmatch(rf"MFEM's conjugate gradients with {preconditioner} \(\d+ iterations in all\)", solver.name)
    system = poroelastic_step()
    pressures = (~system.definite).sum()
    with pytest.raises(ShapeError, match=f"{pressures} of {len(system.definite)} rows are not of a positive definite"):
        method.prepare(system.matrix, system.definite, 1e-8)


@pytest.mark.parametrize("iteration", ["bicgstab", "gmres", "minres"])
def test_a_system_may_have_the_negative_block_alone(iteration):
    system = elastic_step()
    turned = type(system)(-system.matrix, np.zeros_like(system.definite), system.nodes)
    assert solve(turned, MfemKrylov(iteration))[1] < 1e-6


def soft_step(mesh):
    """A time step of 0.5 ms of soft wet tissue in cgs units: displacement held on one side, pressure on the others."""
    from dacore_mfem.backend import MfemBackend

    disc = MfemBackend().discretize(mesh, [Field("u", 3), Field("p", 1)])
    mass, n = disc.scalar_mass("p"), len(mesh.points)
    upper = 8e6 * block_diag([mass] * 3) + 3.8e5 * disc.strain("u") + 1.2e6 * disc.divergence("u")
    lower = 2e-8 * mass + 5e-4 * 5.5e-7 * disc.scalar_stiffness("p")
    coupling = disc.divergence_coupling("u", "p")
    matrix = csr_array(block_array([[upper, coupling.T], [coupling, -lower]]))
    held = np.zeros(4 * n, dtype=bool)
    held.reshape(4, n)[:3, mesh.boundary_nodes("left")] = True
    held.reshape(4, n)[3, np.union1d(mesh.boundary_nodes("right"), mesh.boundary_nodes("side"))] = True
    free = np.flatnonzero(~held)
    return System(csr_array(matrix[free][:, free]), free < 3 * n, free % n)


def test_the_block_preconditioner_pays():
    """Iterations of each on a step of some size: fewer than with Gauss–Seidel on the whole, than with none."""
    system = soft_step(shuffled_box(3, n=8, seed=1))
    rhs = np.random.default_rng(0).standard_normal(len(system.nodes)) / system.scale
    used = {}
    for name in ("blocks", "gauss_seidel", "jacobi"):
        solver = MfemKrylov(preconditioner=name).prepare(system.matrix, system.definite, 1e-10)
        assert system.residual(solver.solve(rhs), rhs) < 1e-10
        used[name] = solver.iterations
    assert used["blocks"] < 0.6 * used["gauss_seidel"], used
    assert used["gauss_seidel"] < 0.6 * used["jacobi"], used


def test_too_few_iterations_are_said():
    with pytest.raises(ConvergenceError, match=r"MFEM's BiCGSTAB with blocks \(\d+ iterations in all\): the relative"):
        solve(poroelastic_step(), MfemKrylov(max_iterations=1), 1e-10)


def test_a_breakdown_is_said_and_not_printed(monkeypatch):
    from dacore_mfem import solver as module

    system = poroelastic_step()
    solver = MfemKrylov().prepare(system.matrix, system.definite, 1e-8)
    # What MFEM does when a number overflows inside an iteration.
    real = module.mfem.Vector
    monkeypatch.setattr(
        module.mfem, "Vector", lambda given: real(np.full(len(given), np.nan)) if np.ndim(given) else real(given)
    )

    def work():
        with pytest.raises(ConvergenceError, match=r"broke down \(.*resid = .*\); use the direct method"):
            solver.solve(np.ones(len(system.nodes)))

    assert written_by(work) == ""


def test_settings_can_be_read_without_mfem():
    """Where MFEM is missing, settings can be made, pickled and compared; only preparing needs the library."""
    code = (
        "import pickle, sys; sys.modules['mfem'] = None; from dacore_mfem.krylov import MfemKrylov; "
        "assert pickle.loads(pickle.dumps(MfemKrylov('gmres'))) == MfemKrylov('gmres'); print('made')"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "made\n"


def _norm(task):
    method, seed = pickle.loads(task)
    return solve(poroelastic_step(seed), method)[1]


def test_it_works_in_spawned_processes():
    tasks = [pickle.dumps((MfemKrylov(), seed)) for seed in range(2)]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert max(pool.map(_norm, tasks)) < 1e-6


def resident():
    """Memory [MB] of this process."""
    return int(re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from Linux's /proc")
def test_memory_does_not_grow():
    system = soft_step(shuffled_box(3, n=6))
    rhs = np.ones(len(system.nodes))

    def work(times):
        for _ in range(times):
            MfemKrylov().prepare(system.matrix, system.definite, 1e-6).solve(rhs)
        gc.collect()
        return resident()

    before = work(10)
    times = int(30 / (8 * system.matrix.nnz / 2**20)) + 1
    # If each solver left the values of its matrix behind, 30 MB more would be there.
    assert work(times) < before + 10
