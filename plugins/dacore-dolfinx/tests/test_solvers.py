"""PETSc's solvers keep the promises of a solver, and what is particular to them."""

import gc
import multiprocessing
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from dacore.errors import ConvergenceError, SceneError, ShapeError
from dacore.plugins.registry import load
from dacore.plugins.settings import build
from dacore.testing import solver_suite
from dacore.testing.silence import written_by
from dacore.testing.solvers import System, elastic_step, poroelastic_step
from dacore_dolfinx.solvers import PetscKrylov, PetscMumps

# Never hide that a required backend's solvers cannot run.
missing = find_spec("petsc4py") is None and "dolfinx" not in os.environ.get("DACORE_REQUIRE", "")
pytestmark = pytest.mark.skipif(missing, reason="petsc4py is not installed")

METHODS = {
    "blocks": PetscKrylov(),
    "bicgstab": PetscKrylov("bicgstab"),
    "ilu": PetscKrylov(preconditioner="ilu"),
    "fill": PetscKrylov("bicgstab", "ilu", fill=2),
    "mumps": PetscMumps(),
    "no pivoting": PetscMumps(pivot_threshold=0.0, extra_memory=100),
}
test_blocks, test_bicgstab, test_ilu, test_fill, test_mumps, test_no_pivoting = (
    solver_suite(method).as_test() for method in METHODS.values()
)


def right_side(system, columns=2):
    return np.random.default_rng(0).standard_normal((len(system.nodes), columns)) / system.scale[:, None]


def solve(method, system, tolerance=1e-8):
    """Solver after its first solve, and how far the answer is from numpy's, in scaled unknowns."""
    rhs = right_side(system)
    solver = method.prepare(system.matrix, system.definite, tolerance)
    given, exact = solver.solve(rhs), np.linalg.solve(system.matrix.toarray(), rhs)
    size = np.linalg.norm(exact / system.scale[:, None])
    return solver, np.linalg.norm((given - exact) / system.scale[:, None]) / size


def test_a_scene_finds_them_by_name():
    assert load().get("solver", "petsc_krylov") is PetscKrylov
    assert load().get("solver", "petsc_mumps") is PetscMumps
    table = {"method": "bicgstab", "preconditioner": "ilu", "fill": 1}
    assert build(PetscKrylov, table, "scene.toml: solver") == PetscKrylov("bicgstab", "ilu", 1)
    with pytest.raises(SceneError, match=r"scene.toml: solver\.method: got 'minres', expected 'gmres' or 'bicgstab'"):
        build(PetscKrylov, {"method": "minres"}, "scene.toml: solver")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PetscKrylov("qmr"), "method: got 'qmr', expected one of gmres, bicgstab"),
        (lambda: PetscKrylov(preconditioner="amg"), "preconditioner: got 'amg', expected one of blocks, ilu"),
        (lambda: PetscKrylov(fill=-1), "fill: got -1, expected a whole number from 0 to 10"),
        (lambda: PetscKrylov(fill=1.5), "fill: got 1.5, expected a whole number"),
        (lambda: PetscKrylov(restart=0), "restart: got 0, expected a whole number from 1"),
        (lambda: PetscKrylov(iterations=True), "iterations: got True, expected a whole number from 1"),
        (lambda: PetscMumps(pivot_threshold=0.6), "pivot_threshold: got 0.6, expected a number from 0.0 to 0.5"),
        (lambda: PetscMumps(pivot_threshold=float("nan")), "pivot_threshold: got nan"),
        (lambda: PetscMumps(extra_memory=-5), "extra_memory: got -5, expected a whole number from 0 to 1000"),
    ],
)
def test_wrong_settings_are_refused(make, message):
    with pytest.raises(ShapeError, match=re.escape(message)):
        make()


def test_the_iteration_stops_at_the_tolerance_asked_for():
    system = poroelastic_step(n=4)
    counts = []
    for tolerance in (1e-3, 1e-6, 1e-10):
        solver, _ = solve(PetscKrylov(), system, tolerance)
        counts.append(solver.iterations)
    assert 0 < counts[0] < counts[1] < counts[2] < 150
    assert solver.name == f"PETSc's gmres ({counts[2]} iterations in all)"


def test_settings_reach_petsc():
    """More fill saves iterations; the preconditioners differ; a short restart costs iterations."""
    system = poroelastic_step(n=5, inertia=1.0)

    def count(**settings):
        solver, error = solve(PetscKrylov(**settings), system, 1e-9)
        assert error < 1e-6
        return solver.iterations

    plain = count()
    assert count(fill=1) < plain
    assert count(preconditioner="ilu") != plain
    assert count(restart=4) > plain
    assert count(method="bicgstab") < plain  # two products an iteration


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_block_alone_is_solved_by_conjugate_gradients(sign):
    system = elastic_step()
    flags = np.full(len(system.nodes), sign > 0)
    alone = System(csr_array(sign * system.matrix), flags, system.nodes)
    for method in METHODS.values():
        solver, error = solve(method, alone)
        assert error < 1e-6
        assert ("conjugate gradients" in solver.name) == isinstance(method, PetscKrylov)


def test_a_limit_of_iterations_is_kept_and_said():
    system = poroelastic_step(n=4, inertia=1.0)
    solver = PetscKrylov(iterations=2).prepare(system.matrix, system.definite, 1e-10)
    with pytest.raises(ConvergenceError, match=r"PETSc's gmres \(\d+ iter.* wanted 1.0e-10.*; use petsc_mumps"):
        solver.solve(1e3 * right_side(system, 1))
    assert solver.iterations % 2 == 0


def test_mumps_counts_negative_pivots():
    """A matrix with a positive diagonal that is not positive definite is refused before anything is solved."""
    matrix = csr_array(np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(ConvergenceError, match="not quasi-definite: 1 negative pivots, expected 0"):
        PetscMumps().prepare(matrix, np.ones(3, dtype=bool), 1e-8)


def test_mumps_says_that_a_matrix_is_singular():
    matrix = csr_array(np.ones((3, 3)))
    with pytest.raises(ConvergenceError, match=r"MUMPS: the factorisation failed \(MUMPS error -10, \d+\); check that"):
        PetscMumps().prepare(matrix, np.ones(3, dtype=bool), 1e-8)


def test_mumps_solves_static_problems():
    """Without inertia, and pressures beside displacements in units a million apart."""
    system = poroelastic_step(inertia=0.0, units=1e6)
    solver, error = solve(PetscMumps(), system, 1e-12)
    assert error < 1e-9
    assert solver.name == "MUMPS"


def test_nothing_is_written():
    system = poroelastic_step()
    rhs = right_side(system)

    def work():
        for method in METHODS.values():
            method.prepare(system.matrix, system.definite, 1e-8).solve(rhs)
        with pytest.raises(ConvergenceError):
            PetscMumps().prepare(csr_array(np.ones((3, 3))), np.ones(3, dtype=bool), 1e-8)

    assert written_by(work) == ""


def spawned(task):
    """What a fresh process, which knows only what is sent to it, makes of a system."""
    method, system, rhs = task
    before = "petsc4py.PETSc" in sys.modules
    analysis = method.analyse(system.matrix, system.definite, system.nodes)
    return before, method.prepare(system.matrix, system.definite, 1e-10, analysis).solve(rhs)


def test_settings_travel_to_spawned_workers():
    system = poroelastic_step()
    rhs = right_side(system)
    methods = [PetscKrylov(), PetscMumps()]
    tasks = [(method, system, rhs) for method in methods]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        answers = pool.map(spawned, tasks, chunksize=1)
    assert [loaded for loaded, _ in answers] == [False, True]
    for method, (_, answer) in zip(methods, answers, strict=True):
        here = method.prepare(system.matrix, system.definite, 1e-10).solve(rhs)
        np.testing.assert_array_equal(answer, here)


def test_settings_are_made_without_petsc():
    code = (
        "import sys; from dacore_dolfinx.solvers import PetscKrylov, PetscMumps; PetscKrylov(); PetscMumps();"
        "sys.exit(any(name.startswith(('petsc4py', 'mpi4py', 'dolfinx')) for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_solving_needs_no_dolfinx():
    code = (
        "import sys; import numpy as np; from scipy.sparse import csr_array;"
        "from dacore_dolfinx.solvers import PetscMumps;"
        "x = PetscMumps().prepare(csr_array(np.array([[4.0]])), np.array([True]), 1e-8).solve(np.array([2.0]));"
        "sys.exit(x[0] != 0.5 or 'dolfinx' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-W", "error", "-c", code], check=False).returncode == 0


def resident():
    """Resident memory [MiB] of this process (Linux)."""
    return int(re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 2**10


@pytest.mark.parametrize("name", ["blocks", "ilu", "mumps"])
def test_native_memory_is_given_back(name):
    """Matrix, factors and vectors go with their solver: a solver of this size keeps some MB in PETSc."""
    n = 20_000
    ones = np.ones(n - 1)
    flags = np.arange(n) % 2 == 0
    # Definite and negative rows take turns along a line.
    matrix = csr_array(diags_array([ones, np.where(flags, 2.5, -2.5), ones], offsets=(-1, 0, 1)))

    def once():
        METHODS[name].prepare(matrix, flags, 1e-8).solve(np.ones(n))

    for _ in range(5):
        once()
    gc.collect()
    before = resident()
    for _ in range(20):
        once()
    gc.collect()
    assert resident() - before < 10.0


def test_a_solver_may_live_to_the_end_of_the_process():
    code = (
        "import numpy as np; from scipy.sparse import csr_array; from dacore_dolfinx.solvers import *;"
        "made = [method.prepare(csr_array(np.array([[4.0]])), np.array([True]), 1e-8)"
        "        for method in (PetscKrylov(), PetscMumps())]"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
