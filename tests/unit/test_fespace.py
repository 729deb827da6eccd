import gc
import weakref

import numpy as np
import pytest

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.errors import CapabilityError, MeshError, ShapeError
from dacore_skfem.backend import SkfemBackend
from tests.meshes import shuffled_box


@pytest.fixture(params=[(2, 1), (2, 2), (3, 2)], ids=lambda p: f"{p[0]}d-P{p[1]}")
def space(request):
    dim, order = request.param
    mesh = shuffled_box(dim, n=2, seed=1, perturb=0.1)
    disc = SkfemBackend().discretize(mesh, [Field("u", dim, order, "cm"), Field("p", 1, 1, "dyn/cm^2")])
    return FiniteElementSpace(disc)


def nodes(space, field):
    return space.discretization.mesh.nodes(space.layout.field(field).order)


def state(space, u, p):
    """Nodal values of functions u: x -> (d, n) and p: x -> (n,)."""
    return np.concatenate([np.asarray(u(nodes(space, "u"))).ravel(), p(nodes(space, "p"))])


def test_layout_counts_vertices_and_edges(space):
    mesh = space.discretization.mesh
    n_u = len(mesh.points) + (len(mesh.edges) if space.layout.field("u").order == 2 else 0)
    assert space.n_dofs == mesh.dim * n_u + len(mesh.points)
    assert [field.name for field in space.fields] == ["u", "p"]


def test_inner_product_is_the_weighted_integral(space):
    dim = space.discretization.mesh.dim
    y = state(space, lambda x: x.T, lambda x: 1.0 + x[:, 0])
    # ∫ |x|² = d/3; ∫ (1 + x)² = 7/3; the gradients add d and 1.
    assert y @ space.inner_product({"u": 2.0, "p": 3.0}) @ y == pytest.approx(2 * dim / 3 + 7.0, rel=1e-12)
    h1 = space.inner_product({"u": 2.0, "p": 3.0}, "h1")
    assert y @ h1 @ y == pytest.approx(2 * dim / 3 + 7.0 + 2 * dim + 3.0, rel=1e-12)
    assert np.linalg.eigvalsh(h1.toarray()).min() > 0


def test_products_are_made_once(space):
    assert space.scalar_product("u") is space.scalar_product("u")
    assert space.scalar_product("u", "h1") is space.scalar_product("u", "h1")
    assert space.scalar_product("u") is not space.scalar_product("u", "h1")


def test_what_is_let_go_of_is_made_again(space):
    disc = space.discretization
    points = np.full((1, disc.mesh.dim), 0.3)
    first, there = disc.strain("u"), disc.evaluation(points, "u")
    want, library = first.toarray(), weakref.ref(disc._assembler)
    disc.release()
    disc.release()
    gc.collect()
    assert library() is None
    assert np.array_equal(first.toarray(), want)
    again = disc.strain("u")
    assert again is not first
    assert again is disc.strain("u")
    assert np.array_equal(again.toarray(), want)
    assert np.array_equal(disc.evaluation(points, "u").toarray(), there.toarray())


def test_evaluation_puts_each_component_in_its_rows(space):
    dim = space.discretization.mesh.dim
    factors = np.arange(1.0, dim + 1)
    y = state(space, lambda x: factors[:, None] * x[:, 0], lambda x: x[:, 1])
    x = np.random.default_rng(0).uniform(size=(7, dim))
    matrix = space.evaluation(x, "u")
    assert matrix.shape == (7 * dim, space.n_dofs)
    np.testing.assert_allclose((matrix @ y).reshape(dim, 7), factors[:, None] * x[:, 0], atol=1e-12)
    np.testing.assert_allclose((space.evaluation(x, "u", 0) @ y).reshape(dim, 7), factors[:, None] * np.ones(7))
    np.testing.assert_allclose(space.evaluation(x, "p") @ y, x[:, 1], atol=1e-12)
    np.testing.assert_allclose(space.evaluation(x, "p", 0) @ y, 0.0, atol=1e-12)
    with pytest.raises(ShapeError, match="point 0 at"):
        space.evaluation(x + 5.0, "p")


def test_boundary_mean_is_a_mean_over_the_surface(space):
    dim = space.discretization.mesh.dim
    y = state(space, lambda x: np.stack([k + x[:, 1] for k in range(dim)]), lambda x: 4.0 * x[:, 0] + x[:, 1])
    mean = space.boundary_mean("right", "p")
    assert mean.shape == (1, space.n_dofs)
    assert (mean @ y).item() == pytest.approx(4.5, rel=1e-12)
    # The sides have area 2(d − 1), not 1.
    assert (space.boundary_mean("side", "p") @ y).item() == pytest.approx(2.5, rel=1e-12)
    np.testing.assert_allclose(space.boundary_mean("left", "u") @ y, np.arange(dim) + 0.5, rtol=1e-12)
    with pytest.raises(MeshError, match="not on this mesh"):
        space.boundary_mean("neck", "p")


def test_cells_describe_the_local_polynomials(space):
    mesh = space.discretization.mesh
    cells = space.cells()
    assert cells.orders == {"u": space.layout.field("u").order, "p": 1}
    np.testing.assert_array_equal(cells.nodes["u"], mesh.cell_nodes(cells.orders["u"]))
    np.testing.assert_array_equal(cells.nodes["p"], mesh.cells)
    assert {"cells", "boundary"} <= space.capabilities


def test_errors(space):
    with pytest.raises(ShapeError, match="expected 'l2' or 'h1'"):
        space.scalar_product("u", "h2")
    with pytest.raises(CapabilityError, match="field 'T'"):
        space.scalar_product("T")
    for weights in ({"u": 1.0}, {"u": 1.0, "p": 0.0}, {"u": 1.0, "p": -1.0}, {"u": 1.0, "p": float("nan")}):
        with pytest.raises(ShapeError, match="weight of field p: got"):
            space.inner_product(weights)
