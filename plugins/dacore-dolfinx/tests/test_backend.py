"""DOLFINx keeps every promise of a backend, and what is particular to it."""

import gc
import importlib
import logging
import os
import pickle
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.core.fields import Field
from dacore.errors import MeshError, PluginError, ShapeError
from dacore.testing import backend_suite
from dacore.testing.meshes import shuffled_box
from dacore.testing.silence import written_by
from dacore_dolfinx.backend import DolfinxBackend

# Never hide that a required backend cannot run.
missing = find_spec("dolfinx") is None and "dolfinx" not in os.environ.get("DACORE_REQUIRE", "")
pytestmark = pytest.mark.skipif(missing, reason="dolfinx is not installed")

test_backend = backend_suite(DolfinxBackend()).as_test()


def module(name):
    """A module of the plugin that imports DOLFINx, so that it is not imported where there is none."""
    return importlib.import_module(f"dacore_dolfinx.{name}")


def biot(mesh, order_u=1, order_p=1):
    return DolfinxBackend().discretize(mesh, [Field("u", mesh.dim, order_u), Field("p", 1, order_p)])


def fresh(code, *flags, **environment):
    """Run Python code in a process of its own."""
    command = [sys.executable, "-W", "error", *flags, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=False)


FIRST_USE = """
import logging, sys
from dacore.core.fields import Field
from dacore.testing.meshes import shuffled_box
from dacore_dolfinx.backend import DolfinxBackend
flags = sys.getdlopenflags()
disc = DolfinxBackend().discretize(shuffled_box(2, n=2), [Field("u", 2, 2), Field("p", 1)])
disc.strain("u"), disc.boundary_coupling("p", "u", "left")
assert sys.getdlopenflags() == flags, "flags of dlopen"
assert not logging.getLogger().handlers and logging.getLogger().level == logging.WARNING, "logging was set up"
"""


def test_the_first_use_compiles_in_silence_and_leaves_no_trace(tmp_path):
    """With an empty cache, where the compiler runs, and warnings as errors."""
    done = fresh(FIRST_USE, XDG_CACHE_HOME=str(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert len(list(tmp_path.glob("fenics/libffcx_forms_*.c.cached"))) == 2


def test_every_process_finds_the_kernels_of_the_first(tmp_path):
    """Also one that has made many constants and meshes before, which UFL numbers through."""
    assert fresh(FIRST_USE, XDG_CACHE_HOME=str(tmp_path)).returncode == 0
    made = sorted(path.name for path in tmp_path.glob("fenics/*"))
    used = (
        "from dacore_dolfinx import compat\n"
        "from dacore.testing.meshes import shuffled_box\n"
        "mesh = shuffled_box(2, n=1)\n"
        "domains = [compat.make_mesh(mesh.points, mesh.cells) for _ in range(9)]\n"
        "constants = [compat.constant(domain, ()) for domain in domains for _ in range(11)]\n"
    )
    for start in (0, 99):
        done = fresh(used.replace("range(11)", f"range({start // 9})") + FIRST_USE, XDG_CACHE_HOME=str(tmp_path))
        assert (done.returncode, done.stderr) == (0, "")
        assert sorted(path.name for path in tmp_path.glob("fenics/*")) == made


def test_roles_share_a_kernel(monkeypatch):
    compat = module("compat")
    signatures = set()
    compiled = compat.compiled
    monkeypatch.setattr(compat, "compiled", lambda form, jit: signatures.add(form.signature()) or compiled(form, jit))
    for seed in (1, 2):
        disc = biot(shuffled_box(3, n=1, seed=seed))
        for role in disc.mesh.roles:
            disc.boundary_coupling("p", "u", role)
    assert len(signatures) == 1


def test_an_abandoned_compilation_is_said(tmp_path, monkeypatch):
    """A process that was stopped while it compiled leaves a file behind, and others wait for it in vain."""
    assert fresh(FIRST_USE, XDG_CACHE_HOME=str(tmp_path)).returncode == 0
    for ready in tmp_path.glob("fenics/libffcx_forms_*.c.cached"):
        ready.unlink()
    code = "from dacore_dolfinx import compilation; compilation._OPTIONS['timeout'] = 1\n" + FIRST_USE
    done = fresh(code, XDG_CACHE_HOME=str(tmp_path))
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("dacore.errors.PluginError: backend dolfinx: JIT compilation timed out")
    assert "libffcx_forms_" in last
    assert last.endswith("if no other process is compiling, one was stopped while it did: remove that file")


def test_a_missing_compiler_is_said(tmp_path):
    done = fresh(FIRST_USE, XDG_CACHE_HOME=str(tmp_path), CC="/nowhere/cc")
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("dacore.errors.PluginError: backend dolfinx: its C compiler failed")
    assert last.endswith("sudo apt install gcc python3-dev")


def test_logging_is_as_before_also_after_a_failure():
    compilation = module("compilation")
    root = logging.getLogger()
    before = root.level, list(root.handlers), list(root.filters)

    def fail():
        root.setLevel(logging.DEBUG)
        logging.info("a command")
        raise TimeoutError("x.c")

    def work():
        with pytest.raises(PluginError, match=r"x\.c; if no other process"):
            compilation._compiled(fail)

    assert written_by(work) == ""
    assert (root.level, list(root.handlers), list(root.filters)) == before


def test_a_pickle_needs_no_dolfinx(tmp_path):
    disc = biot(shuffled_box(2, n=2))
    strain = disc.strain("u")
    path = tmp_path / "disc.pickle"
    path.write_bytes(pickle.dumps(disc))
    done = fresh(
        "import pickle, sys\n"
        f"disc = pickle.load(open({str(path)!r}, 'rb'))\n"
        "assert disc.layout.n_dofs and 'dolfinx' not in sys.modules\n",
        "-W",
        "ignore::ResourceWarning",
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert abs(pickle.loads(path.read_bytes()).strain("u") - strain).max() == 0.0


def test_orphan_points_never_reach_dolfinx():
    """DOLFINx drops them without a word, which would shift every number behind."""
    mesh = shuffled_box(2, n=2)
    points = np.concatenate([mesh.points, [[0.5, 0.5001]]])
    with pytest.raises(MeshError, match="1 belong to no cell"):
        type(mesh)(points, mesh.cells, mesh.facets, mesh.facet_tags, mesh.roles)


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_and_facets_are_found_again(dim):
    """DOLFINx renumbers both."""
    compat, numbering = module("compat"), module("numbering")
    mesh = shuffled_box(dim, n=3, seed=4)
    domain = compat.make_mesh(mesh.points, mesh.cells)
    vertices, facets = compat.cell_vertices(domain), compat.cell_facets(domain)
    assert (vertices != mesh.cells).any()
    np.testing.assert_array_equal(
        np.unique(np.sort(vertices, axis=1), axis=0), np.unique(np.sort(mesh.cells, axis=1), axis=0)
    )
    marked = [numbering.marked_facets(mesh, vertices, facets, role) for role in mesh.roles]
    assert [len(found) for found in marked] == [len(mesh.boundary_facets(role)) for role in mesh.roles]
    exterior = np.flatnonzero(np.bincount(facets.ravel()) == 1)
    np.testing.assert_array_equal(np.sort(np.concatenate(marked)), exterior)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_agrees_with_vector_elements_of_dolfinx(dim, order):
    """Blocks of scalar kernels are what DOLFINx makes of vector elements, through PETSc."""
    compat = module("compat")
    import ufl
    from dolfinx import fem
    from dolfinx.fem import petsc

    mesh = shuffled_box(dim, n=2, seed=2, bumpy=True)
    domain = compat.make_mesh(mesh.points, mesh.cells)
    compiled = module("compilation")._compiled
    if compat.VERSION < (0, 7):
        space = compiled(lambda: fem.VectorFunctionSpace(domain, ("Lagrange", order)))
    else:
        space = fem.functionspace(domain, ("Lagrange", order, (dim,)))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    # Dofs by place: those of one node follow each other.
    where = space.tabulate_dof_coordinates()[:, :dim]
    row = {tuple(x): k for k, x in enumerate(np.round(where, 9).tolist())}
    node = np.array([row[tuple(x)] for x in np.round(mesh.nodes(order), 9).tolist()])
    number = np.concatenate([dim * node + component for component in range(dim)])
    disc = biot(mesh, order_u=order)
    dx = ufl.dx(metadata={"quadrature_degree": 2 * order - 2})
    for form, ours in (
        (ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * dx, disc.strain("u")),
        (ufl.div(u) * ufl.div(v) * dx, disc.divergence("u")),
    ):
        matrix = petsc.assemble_matrix(compiled(lambda form=form: fem.form(form)))
        matrix.assemble()
        start, indices, values = matrix.getValuesCSR()
        theirs = csr_array((values.copy(), indices, start), shape=matrix.getSize())[number][:, number]
        matrix.destroy()
        assert abs(ours - theirs).max() < 1e-13


def test_evaluation_does_not_depend_on_how_many_points_are_tabulated_at_once(monkeypatch):
    evaluation = module("evaluation")
    disc = biot(shuffled_box(3, n=2), order_u=2)
    x = np.random.default_rng(0).uniform(size=(50, 3))
    whole = [disc.evaluation(x, "u", axis) for axis in (None, 1)]
    monkeypatch.setattr(evaluation, "_POINTS", 7)
    for axis, matrix in zip((None, 1), whole, strict=True):
        assert abs(disc.evaluation(x, "u", axis) - matrix).max() < 1e-14
    assert disc.evaluation(np.empty((0, 3)), "u", 0).shape == (0, len(disc.mesh.nodes(2)))


def test_a_point_outside_is_the_same_error_as_on_every_backend():
    with pytest.raises(ShapeError, match=r"point 1 at \(2, 0.5\) lies outside the mesh \(1 of 2 points do\)"):
        biot(shuffled_box(2, n=2)).evaluation(np.array([[0.5, 0.5], [2.0, 0.5]]), "p")


def resident():
    """Resident memory [MiB] of this process (Linux)."""
    return int(re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 2**10


def test_memory_is_given_back():
    """Meshes, kernels and matrices of discretisations that are gone; one holds some MB."""
    mesh = shuffled_box(3, n=8)

    def once():
        disc = biot(mesh)
        disc.strain("u"), disc.gradient_coupling("p", "u"), disc.scalar_boundary_mass("p", "left")

    for _ in range(5):
        once()
    gc.collect()
    before = resident()
    for _ in range(25):
        once()
    gc.collect()
    assert resident() - before < 8.0
