"""States in another space: polynomials, constants, identities, projections, and what is said where it cannot be."""

import numpy as np
import pytest

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.space import StateSpace
from dacore.domains.ball import Ball
from dacore.errors import CapabilityError, ShapeError
from dacore.studies.errors import Contrast, ErrorMeter
from dacore.studies.places import node_places
from dacore.studies.transfer import Projection, interpolation, unattainable
from dacore.testing.meshes import shuffled_box, with_points
from dacore.testing.spaces import Chain
from dacore_skfem.backend import SkfemBackend


def space(mesh, order=1):
    fields = [Field("u", mesh.dim, order, "cm"), Field("p", 1, 1, "dyn/cm^2")]
    return FiniteElementSpace(SkfemBackend().discretize(mesh, fields))


def box(dim, n, seed=0, order=1, bumpy=False):
    return space(shuffled_box(dim, n, seed, bumpy=bumpy), order)


def polynomial(of, degree, seed):
    """A state whose fields are polynomials, of degree `degree` for u and 1 for p."""
    rng, dim = np.random.default_rng(seed), of.discretization.mesh.dim
    state = np.zeros(of.n_dofs)
    for field in of.fields:
        x = node_places(of, field.name)
        for component in range(field.components):
            value = rng.normal() + x @ rng.normal(size=dim)
            if degree == 2 and field.name == "u":
                value = value + np.einsum("ni,ij,nj->n", x, rng.normal(size=(dim, dim)), x)
            state[of.layout.component(field.name, component)] = value
    return state


@pytest.mark.parametrize("outside", ["nearest", "extend", "error"])
@pytest.mark.parametrize("orders", [(1, 1), (1, 2), (2, 1), (2, 2)])
@pytest.mark.parametrize("dim", [2, 3])
def test_polynomials_of_the_source_are_reproduced(dim, orders, outside):
    one, other = box(dim, 3, 1, orders[0]), box(dim, 4, 2, orders[1])
    move = interpolation(one, other, outside)
    assert (move.outside, move.distance) == (0, 0.0)
    np.testing.assert_allclose(move(polynomial(one, orders[0], 3)), polynomial(other, orders[0], 3), atol=1e-12)


@pytest.mark.parametrize("orders", [(1, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("dim", [2, 3])
def test_outside_they_are_continued_or_bounded(dim, orders):
    one = box(dim, 4, 1, orders[0])
    wide = shuffled_box(dim, 5, 2)
    other = space(with_points(wide, 1.2 * wide.points - 0.1), orders[1])
    x = node_places(other, "u")
    beyond = np.linalg.norm(np.maximum(np.maximum(-x, x - 1.0), 0.0), axis=1)
    far = int((beyond > 1e-9).sum())
    assert far > 0
    given, wanted = polynomial(one, orders[0], 3), polynomial(other, orders[0], 3)
    extended, nearest = (interpolation(one, other, outside) for outside in ("extend", "nearest"))
    np.testing.assert_allclose(extended(given), wanted, atol=1e-11)
    for move in (extended, nearest):
        assert move.fields["u"].outside == far
        assert move.distance == pytest.approx(beyond.max(), rel=1e-12)
    # Nearest points of a box are known: coordinates are clipped.
    rows = [other.layout.component("p", 0)]
    at = np.clip(node_places(other, "p"), 0.0, 1.0)
    again = with_points(wide, np.clip(1.2 * wide.points - 0.1, -9, 9))
    flat = space(again, orders[1])
    assert flat.n_dofs == other.n_dofs
    rng = np.random.default_rng(5)
    slope = rng.normal(size=dim)
    state = np.zeros(one.n_dofs)
    state[one.layout.block("p")] = node_places(one, "p") @ slope
    np.testing.assert_allclose(nearest(state)[rows[0]], at @ slope, atol=1e-12)
    with pytest.raises(ShapeError, match=rf"{far} of {len(x)} nodes are outside the source's domain, the farthest at"):
        interpolation(one, other, "error")


@pytest.mark.parametrize("outside", ["nearest", "extend"])
@pytest.mark.parametrize("orders", [(1, 1), (2, 1), (1, 2)])
def test_constants_are_reproduced_everywhere(orders, outside):
    one, other = space(Ball(edge=1.6).mesh(), orders[0]), space(Ball(edge=1.2, neck_height=2.0).mesh(), orders[1])
    for a, b in ((one, other), (other, one)):
        move = interpolation(a, b, outside)
        assert move.outside > 0
        assert 0.0 < move.distance < 0.3
        np.testing.assert_allclose(move(np.full(a.n_dofs, 7.0)), 7.0, rtol=1e-13)


def test_nearest_values_stay_within_the_bounds_of_the_data():
    one, other = space(Ball(edge=1.6).mesh()), space(Ball(edge=1.2).mesh())
    states = np.random.default_rng(0).uniform(-1, 1, size=(one.n_dofs, 3))
    assert np.abs(interpolation(one, other)(states)).max() <= 1.0 + 1e-12
    assert np.abs(interpolation(one, other, "extend")(states)).max() > 1.0


@pytest.mark.parametrize("order", [1, 2])
def test_equal_spaces_give_the_identity(order):
    one, other = box(3, 3, 1, order, bumpy=True), box(3, 3, 1, order, bumpy=True)
    matrix = interpolation(one, other).matrix
    assert (abs(matrix - matrix.T).nnz, matrix.nnz) == (0, one.n_dofs)
    states = np.random.default_rng(0).normal(size=(one.n_dofs, 4))
    np.testing.assert_array_equal(interpolation(one, other)(states), states)


@pytest.mark.parametrize("dim", [2, 3])
def test_order_one_in_order_two_on_the_same_mesh_is_exact(dim):
    mesh = shuffled_box(dim, 3, 4, bumpy=True)
    one, two = space(mesh, 1), space(mesh, 2)
    states = np.random.default_rng(0).normal(size=(one.n_dofs, 2))
    there, back = interpolation(one, two, "error"), interpolation(two, one, "error")
    lifted = there(states)
    for component in range(dim):
        nodes = lifted[two.layout.component("u", component)]
        ends = states[one.layout.component("u", component)]
        np.testing.assert_array_equal(nodes[: len(mesh.points)], ends)
        np.testing.assert_allclose(nodes[len(mesh.points) :], ends[mesh.edges].mean(axis=1), atol=1e-14)
    np.testing.assert_array_equal(back(lifted), states)
    # The same function: of the same norm.
    for name in ("u", "p"):
        a, b = (s[of.layout.block(name)][:, 0] for s, of in ((states, one), (lifted, two)))
        assert a @ one.field_product(name) @ a == pytest.approx(b @ two.field_product(name) @ b, rel=1e-12)


def test_the_operator_is_the_matrix_of_its_action():
    one, other = box(2, 4, 1, 2, bumpy=True), box(2, 5, 2, 1, bumpy=True)
    move = interpolation(one, other)
    states = np.random.default_rng(0).normal(size=(one.n_dofs, 3))
    assert move.matrix.shape == (other.n_dofs, one.n_dofs)
    np.testing.assert_allclose(move.matrix @ states, move(states), atol=1e-13)
    np.testing.assert_allclose(move(states)[:, 1], move(states[:, 1]), atol=1e-14)


@pytest.mark.parametrize("kind", ["l2", "h1"])
@pytest.mark.parametrize("dim", [2, 3])
def test_projection_is_orthogonal_and_the_best_of_the_target(dim, kind):
    fine, coarse = box(dim, 6, 1, bumpy=True), box(dim, 3, 2, bumpy=True)
    down = Projection(fine, coarse, kind, hold=0.0)
    rng = np.random.default_rng(0)
    states = rng.normal(size=(fine.n_dofs, 2))
    left = states - down.basis(down(states))
    product = fine.inner_product({"u": 1.0, "p": 1.0}, kind)
    tried = down.basis(rng.normal(size=(coarse.n_dofs, 5)))
    size = np.sqrt(np.outer((tried * (product @ tried)).sum(axis=0), (states * (product @ states)).sum(axis=0)))
    assert np.abs(tried.T @ (product @ left) / size).max() < 1e-11
    inside = rng.normal(size=coarse.n_dofs)
    np.testing.assert_allclose(down(down.basis(inside)), inside, atol=1e-9)


def test_what_no_coarse_state_can_have_is_measured():
    fine, coarse = box(3, 6, 1), box(3, 3, 2)
    down, meter = (
        Projection(fine, coarse, hold=0.0),
        ErrorMeter(fine, "l2", [Contrast("p less 1", "p", 1.0)], {"u": 1, "p": 1}),
    )
    rng = np.random.default_rng(0)
    states = down.basis(rng.normal(size=(coarse.n_dofs, 3)))
    assert max(unattainable(down, down.basis, states, meter).values()) < 1e-10
    rough = rng.normal(size=(fine.n_dofs, 3))
    by_projection = unattainable(down, down.basis, rough, meter)
    by_nodes = unattainable(interpolation(fine, coarse), down.basis, rough, meter)
    assert set(by_projection) == {"u", "p", "p less 1", "joint"}
    assert all(0.1 < by_projection[name] < by_nodes[name] for name in by_projection)
    held = unattainable(Projection(fine, coarse), down.basis, rough, meter)
    assert held == pytest.approx(by_projection, rel=1e-3)


def test_functions_that_no_node_of_the_source_is_in_are_held_at_their_interpolation():
    """The target reaches beyond the source: its outer functions could take any value."""
    wide = shuffled_box(2, 8, 2)
    fine, wider = box(2, 9, 1), space(with_points(wide, 1.6 * wide.points - 0.3))
    states = polynomial(fine, 1, 0)[:, None] + np.sin(40 * np.arange(fine.n_dofs))[:, None]
    with pytest.raises(ShapeError, match=r"do not tell the target's .* apart \(.*\); expected a finer source, or hold"):
        Projection(fine, wider, hold=0.0)(states)
    held = Projection(fine, wider)
    free = np.flatnonzero(abs(held.basis.matrix).sum(axis=0) == 0)
    assert free.size
    assert np.abs(held(states)).max() < 3 * np.abs(states).max()
    np.testing.assert_allclose(held(np.full(fine.n_dofs, 3.0)), 3.0, rtol=1e-9)


def test_interpolation_converges_as_the_elements_promise():
    fine = box(2, 40, 1, 2)
    meter = ErrorMeter(fine, "l2", (), {"u": 1, "p": 1})
    state = np.zeros((fine.n_dofs, 1))
    x = node_places(fine, "u")
    for component in range(2):
        state[fine.layout.component("u", component), 0] = np.sin(3 * x[:, 0] + component) * np.cos(2 * x[:, 1])
    state[fine.layout.block("p"), 0] = 1.0
    lost = []
    for n in (5, 10, 20):
        coarse = box(2, n, 2)
        lost.append(unattainable(interpolation(fine, coarse), interpolation(coarse, fine), state, meter)["u"])
    assert np.log2(lost[0] / lost[1]) > 1.7
    assert np.log2(lost[1] / lost[2]) > 1.7


class Bare(StateSpace):
    """A space with nothing but what it must have, or points."""

    def __init__(self, inner):
        self.inner = inner

    @property
    def layout(self):
        return self.inner.layout

    def scalar_product(self, field, kind="l2"):
        return self.inner.scalar_product(field, kind)


class Pointed(Bare):
    def evaluation(self, points, field, derivative=None):
        return self.inner.evaluation(points, field, derivative)


def test_a_source_with_points_alone_is_enough_inside():
    one, other = box(2, 4, 1, 2), box(2, 5, 2)
    gap = interpolation(Pointed(one), other).matrix - interpolation(one, other).matrix
    assert abs(gap).max() < 1e-14
    mesh = shuffled_box(2, 5, 2)
    with pytest.raises(ShapeError, match="lies outside the mesh"):
        interpolation(Pointed(one), space(with_points(mesh, 1.1 * mesh.points)))


def test_what_cannot_be_is_said_in_a_line():
    one = box(2, 3, 1)
    with pytest.raises(CapabilityError, match="the target, Bare, has no cells"):
        interpolation(one, Bare(one))
    with pytest.raises(CapabilityError, match="the source, Bare, has neither cells nor points"):
        interpolation(Bare(one), one)
    with pytest.raises(ShapeError, match=r"got fields u \(2\) \[cm\], p .* and u \(3\) \[cm\], p"):
        interpolation(one, box(3, 2))
    flat = FiniteElementSpace(SkfemBackend().discretize(shuffled_box(2, 2), [Field("p", 1)]))
    solid = FiniteElementSpace(SkfemBackend().discretize(shuffled_box(3, 2), [Field("p", 1)]))
    with pytest.raises(ShapeError, match="a source of 2 dimensions and a target of 3"):
        interpolation(flat, solid)
    with pytest.raises(ShapeError, match="outside: got 'drop', expected 'nearest', 'extend' or 'error'"):
        interpolation(one, one, "drop")
    with pytest.raises(ShapeError, match=r"states to transfer: got shape \(5,\), expected \(\d+,\) or with columns"):
        interpolation(one, one)(np.zeros(5))
    coarse, fine = box(2, 2, 1), box(2, 8, 2)
    with pytest.raises(ShapeError, match=r"projection of u: the source's .* do not tell the target's .* apart"):
        Projection(coarse, fine, hold=0.0)(np.zeros(coarse.n_dofs))
    with pytest.raises(ShapeError, match="hold: got -1"):
        Projection(coarse, fine, hold=-1.0)
    with pytest.raises(CapabilityError, match="the target, Chain, has no cells"):
        interpolation(Chain(3), Chain(4))
