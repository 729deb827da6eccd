"""What is particular to MFEM: its own vector integrators, its numbers, its memory, its output."""

import gc
import os
import pickle
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from dacore.core.fields import Field
from dacore.core.simplex import lagrange
from dacore.testing.meshes import graded_box, shuffled_box
from dacore.testing.reference import Reference
from dacore.testing.silence import written_by
from dacore_mfem.backend import MfemBackend

pytest.importorskip("mfem")

CASES = [(dim, order) for dim in (2, 3) for order in (1, 2)]


def biot(mesh, order=1):
    return MfemBackend().discretize(mesh, [Field("u", mesh.dim, order), Field("p", 1)])


def every_form(disc):
    for ask in (disc.strain, disc.divergence, disc.scalar_mass, disc.scalar_stiffness):
        ask("u")
    disc.gradient_coupling("p", "u")
    disc.divergence_coupling("u", "p")
    disc.scalar_boundary_mass("u", "side")
    return disc.boundary_coupling("p", "u", "side")


@pytest.mark.parametrize(("dim", "order"), CASES)
def test_composed_forms_are_those_of_mfems_elasticity(dim, order):
    from dacore_mfem.library import from_native, mfem
    from dacore_mfem.pattern import renumbered
    from dacore_mfem.spaces import MfemMesh

    mesh = shuffled_box(dim, n=2, seed=7, bumpy=True)
    disc = biot(mesh, order)
    space = MfemMesh(mesh).space(order)
    numbers = np.concatenate([axis * len(space.nodes) + space.nodes for axis in range(dim)])
    # ∫ λ (∇·a)(∇·b) + 2μ ε(a):ε(b)
    for lame, shear, ours in ((0.0, 0.5, disc.strain("u")), (1.0, 0.0, disc.divergence("u"))):
        form = mfem.BilinearForm(space.vector)
        coefficients = mfem.ConstantCoefficient(lame), mfem.ConstantCoefficient(shear)
        form.AddDomainIntegrator(mfem.ElasticityIntegrator(*coefficients))
        form.Assemble()
        form.Finalize()
        theirs = renumbered(from_native(form.SpMat()), numbers, numbers)
        assert abs(ours - theirs).max() < 1e-14 * abs(ours).max() * len(mesh.cells)


@pytest.mark.parametrize("dim", [2, 3])
def test_vertices_and_cells_keep_their_numbers_and_their_turns(dim):
    from dacore_mfem.spaces import MfemMesh

    mesh = shuffled_box(dim, n=2, seed=8, bumpy=True)
    native = MfemMesh(mesh).native
    assert [native.GetElementVertices(k) for k in range(native.GetNE())] == mesh.cells.tolist()
    np.testing.assert_array_equal(np.array(native.GetVertexArray())[:, :dim], mesh.points)
    assert native.GetNBE() == len(mesh.facets)


def test_edge_nodes_are_found_by_their_vertices():
    """MFEM numbers edges in its own way, and its elements put them elsewhere in a cell."""
    from dacore_mfem.shapes import Shapes
    from dacore_mfem.spaces import MfemMesh

    mesh = shuffled_box(2, n=3, seed=9)
    space = MfemMesh(mesh).space(2)
    assert not np.array_equal(space.nodes, np.sort(space.nodes))
    np.testing.assert_array_equal(np.sort(space.nodes), np.arange(len(mesh.nodes(2))))
    assert Shapes(space).local.tolist() == [0, 1, 2, 3, 5, 4]


@pytest.mark.parametrize(("dim", "order"), CASES)
def test_shape_functions_are_read_off_exactly(dim, order):
    from dacore_mfem.shapes import Shapes
    from dacore_mfem.spaces import MfemMesh

    shapes = Shapes(MfemMesh(shuffled_box(dim, n=1)).space(order))
    inside = np.random.default_rng(0).dirichlet(np.ones(dim + 1), 50)
    given = shapes.values(inside[:, 1:])
    np.testing.assert_allclose(given, lagrange(order, inside)[:, shapes.local], rtol=0, atol=1e-13)


def test_thin_facets_keep_their_digits():
    """MFEM takes areas from a difference that loses digits unless a facet begins at its widest angle."""
    mesh = graded_box(3, 3, seed=2)
    corner = mesh.points[mesh.facets]
    edges = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
    assert (edges.max(axis=1) / edges.min(axis=1)).max() > 300
    disc = biot(mesh)
    for role in mesh.roles:
        form, want = disc.scalar_boundary_mass("p", role).diagonal(), Reference(mesh).boundary_mass(1, role).matrix
        there = mesh.boundary_nodes(role)
        np.testing.assert_allclose(form[there], want.diagonal()[there], rtol=1e-12)


def test_twenty_thousand_points_take_no_seconds():
    import time

    mesh = shuffled_box(3, n=6, bumpy=False)
    disc = biot(mesh, 2)
    x = np.random.default_rng(0).uniform(size=(20_000, 3))
    disc.evaluation(x[:1], "u")
    start = time.process_time()
    disc.evaluation(x, "u")
    disc.evaluation(x, "u", 1)
    assert time.process_time() - start < 3.0


def test_pickled_discretisations_need_no_mfem_until_a_form_is_asked_for():
    """A process that only passes discretisations on works without the library, and one that has it does not load it."""
    disc = biot(shuffled_box(2, n=2))
    disc.strain("u")
    code = (
        "import pickle, sys; from dacore.errors import PluginError; sys.modules['mfem'] = None; "
        "disc = pickle.loads(sys.stdin.buffer.read()); assert disc.layout.n_dofs == 27; "
        "assert pickle.loads(pickle.dumps(disc)).mesh.dim == 2\n"
        "try: disc.strain('u')\n"
        "except PluginError: print('asked')"
    )
    done = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(disc), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout == b"asked\n"


def test_objects_that_mfem_points_to_live_as_long_as_needed():
    """Discretisations made, used in part and dropped in any order, with memory collected in between."""
    rng = np.random.default_rng(0)
    meshes = [shuffled_box(dim, n=2, seed=seed) for dim in (2, 3) for seed in range(2)]
    want = [every_form(biot(mesh, 2)) for mesh in meshes]
    held = []
    for _ in range(30):
        k = int(rng.integers(len(meshes)))
        disc = biot(meshes[k], 2)
        assert abs(every_form(disc) - want[k]).max() == 0.0
        held.append((k, disc, disc.strain("u")))
        del disc
        if rng.random() < 0.5:
            held.pop(int(rng.integers(len(held))))
            gc.collect()
    for k, disc, strain in held:
        assert np.isfinite(strain.data).all()
        # Elements of the other order come from the same MFEM mesh, long after it was made.
        assert disc.scalar_mass("p").sum() == pytest.approx(meshes[k].volumes.sum())


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from Linux's /proc")
def test_memory_does_not_grow():
    mesh = shuffled_box(3, n=5)

    def work(times):
        for _ in range(times):
            every_form(biot(mesh))
        gc.collect()
        return int(re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024

    before = work(10)
    disc = biot(mesh)
    every_form(disc)
    size = sum(12 * form.nnz for form in (disc.strain("u"), disc.divergence("u"))) / 2**20
    times = int(30 / size) + 1
    # If each left its two largest forms behind, 30 MB more would be there.
    assert work(times) < before + 10


def test_quiet_silences_mfem_and_nobody_else():
    from dacore_mfem.library import mfem, quiet

    def fail():
        with pytest.raises(RuntimeError, match="incorrect number of vertices"):
            mfem.Mesh(2, 3, 1, 0, 2).FinalizeTriMesh(1, 0, True)

    def work():
        with quiet():
            fail()
            os.write(1, b"said by others")
            with quiet():
                pass
            fail()

    assert written_by(work) == "said by others"
    assert "incorrect number of vertices" in written_by(fail)


def test_quiet_may_overlap_in_threads():
    from dacore_mfem.library import mfem, quiet

    ready, leave = threading.Barrier(2), threading.Event()

    def inside():
        with quiet():
            ready.wait(10)
            leave.wait(10)

    thread = threading.Thread(target=inside)
    thread.start()
    ready.wait(10)
    with quiet():
        pass
    assert not mfem.err.IsEnabled()
    leave.set()
    thread.join(10)
    assert mfem.err.IsEnabled()
    assert mfem.out.IsEnabled()


def test_streams_that_were_off_stay_off():
    from dacore_mfem.library import mfem, quiet

    mfem.out.Disable()
    try:
        with quiet():
            pass
        assert not mfem.out.IsEnabled()
        assert mfem.err.IsEnabled()
    finally:
        mfem.out.Enable()
