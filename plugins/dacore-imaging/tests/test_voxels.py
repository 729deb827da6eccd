"""Voxel averages against closed forms."""

import numpy as np
import pytest

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.errors import CapabilityError, SceneError, ShapeError
from dacore.plugins.settings import build
from dacore_imaging.grid import Grid
from dacore_imaging.voxels import Slice, Voxels

TURN = np.linalg.qr(np.random.default_rng(11).standard_normal((3, 3)))[0]


def turn(dim, seed=11):
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))
    return q


def rows(matrix):
    return tuple(map(tuple, np.asarray(matrix).tolist()))


class Quadratic:
    """a + b·x + x·Q x and its mean over boxes."""

    def __init__(self, dim, order, seed=2):
        rng = np.random.default_rng(seed)
        self.b = rng.standard_normal(dim)
        q = rng.standard_normal((dim, dim)) * (order == 2)
        self.q = 0.5 * (q + q.T)

    def __call__(self, x):
        return 0.3 + x @ self.b + np.einsum("ni,ij,nj->n", x, self.q, x)

    def mean(self, centres, axes, sizes):
        """Mean over boxes with these centres (m, d), axes as rows and edge lengths (m, d)."""
        spread = np.einsum("ai,ij,aj->a", axes, self.q, axes)
        return self(centres) + (np.broadcast_to(sizes, centres.shape) ** 2 / 12.0) @ spread


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_whole_voxels_of_an_aligned_grid(make_space, dim, order):
    space = make_space(dim, n=4, lengths=3.0, order=order)
    size = (0.75, 0.6, 1.5)[:dim]
    found = Voxels(size=size, coverage=1.0).functionals(space)
    function = Quadratic(dim, order)
    values = found(space.state(u=lambda x: np.stack([(k + 1) * function(x) for k in range(dim)], axis=1)))
    n = found.n_sites
    assert n == round(np.prod(3.0 / np.array(size)))
    assert found.dropped == 0
    expected = function.mean(found.centres[:n], np.eye(dim), size)
    np.testing.assert_allclose(values, np.concatenate([(k + 1) * expected for k in range(dim)]), atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_whole_voxels_of_a_rotated_grid(make_space, dim, order):
    space = make_space(dim, n=4, lengths=4.0, order=order)
    size = (0.8, 0.7, 0.9)[:dim]
    grid = {"size": size, "axes": rows(turn(dim)), "origin": (0.1, -0.2, 0.3)[:dim]}
    found = Voxels(**grid, coverage=1.0, components=(0,)).functionals(space)
    function = Quadratic(dim, order)
    assert found.count > 5
    np.testing.assert_allclose(
        found(space.state(u=lambda x: np.stack([function(x)] * dim, axis=1))),
        function.mean(found.centres, turn(dim), size),
        atol=1e-12 * 50,
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_partial_voxels_average_over_what_lies_inside(make_space, dim):
    # Boundary voxels of an aligned grid are cut by the cube to smaller boxes, whose means are known.
    length, size = 2.35, 0.8
    space = make_space(dim, n=3, lengths=length, order=2)
    origin = (-0.3,) * dim
    found = Voxels(size=size, origin=origin, coverage=0.0, components=(0,)).functionals(space)
    low = np.clip(found.centres - size / 2, 0, length)
    high = np.clip(found.centres + size / 2, 0, length)
    assert found.count == 4**dim
    function = Quadratic(dim, 2)
    values = found(space.state(u=lambda x: np.stack([function(x)] * dim, axis=1)))
    np.testing.assert_allclose(values, function.mean(0.5 * (low + high), np.eye(dim), high - low), atol=1e-12)

    # The threshold is on the covered fraction, and what it leaves out is counted.
    fill = np.prod(high - low, axis=1) / size**dim
    for threshold in (0.3, 0.6, 0.95):
        some = Voxels(size=size, origin=origin, coverage=threshold, components=(0,)).functionals(space)
        np.testing.assert_allclose(some.centres, found.centres[fill >= threshold], atol=1e-12)
        assert some.dropped == (fill < threshold).sum() > 0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("axes", ["aligned", "rotated"])
def test_plain_integrals_sum_to_the_integral_over_the_domain(make_space, dim, axes):
    space = make_space(dim, n=3, lengths=3.0, order=2)
    rotated = {} if axes == "aligned" else {"axes": rows(turn(dim))}
    found = Voxels(size=0.71, average=False, coverage=0.0, components=(1,), **rotated).functionals(space)
    function = Quadratic(dim, 2)
    values = found(space.state(u=lambda x: np.stack([function(x)] * dim, axis=1)))
    whole = function.mean(np.full((1, dim), 1.5), np.eye(dim), 3.0)[0] * 3.0**dim
    assert values.sum() == pytest.approx(whole, rel=1e-12)
    assert found.unit == f"cm cm^{dim}"


def test_an_average_is_the_integral_over_the_covered_volume(make_space):
    # Errata of Galarce et al. 2023: the voxel integral is printed without its volume. A constant
    # measured by an average is the constant, whatever the voxel's size and coverage.
    space = make_space(3, n=2, lengths=2.0)
    constant = space.state(u=lambda x: np.full((len(x), 3), 7.0))
    settings = {"axes": rows(TURN), "coverage": 0.1, "size": 0.9}
    average, plain = Voxels(**settings), Voxels(**settings, average=False)
    np.testing.assert_allclose(average.functionals(space)(constant), 7.0, rtol=1e-12)
    integrals = plain.functionals(space)(constant)
    assert integrals.max() <= 7.0 * 0.9**3 * (1 + 1e-12)
    assert integrals.min() < 0.5 * integrals.max()
    assert average.functionals(space).unit == "cm"


def test_a_voxel_that_is_a_union_of_cells(make_space):
    space = make_space(3, n=4, lengths=4.0, jitter=0.0)
    found = Voxels(field="p", size=2.0).functionals(space)
    values = np.random.default_rng(0).standard_normal(len(space.mesh.points))
    state = space.state(p=lambda x: values)
    corners = space.mesh.points[space.mesh.cells].mean(axis=1)
    means = values[space.mesh.cells].mean(axis=1)
    for k, centre in enumerate(found.centres):
        inside = (np.abs(corners - centre) < 1.0).all(axis=1)
        assert inside.sum() == 48
        assert found(state)[k] == pytest.approx(means[inside].mean(), abs=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_numbering_of_the_mesh_does_not_matter(make_space, dim):
    settings = Voxels(size=0.8, axes=rows(turn(dim)))
    values = []
    for renumber in (False, True):
        space = make_space(dim, n=3, renumber=renumber, seed=4)
        found = settings.functionals(space)
        values.append(found(space.state(u=lambda x: np.sin(x))))
        labels = found.labels
    assert len(labels) == len(values[0]) > 10
    one, other = make_space(dim, n=3, seed=4), make_space(dim, n=3, renumber=True, seed=4)
    np.testing.assert_allclose(np.sort(one.mesh.points, axis=0), np.sort(other.mesh.points, axis=0))
    np.testing.assert_allclose(*values, atol=1e-13)


def test_order_labels_sites_and_directions(make_space):
    space = make_space(3, n=2, lengths=2.0)
    found = Voxels(size=1.0).functionals(space)
    assert found.count == 24
    assert found.labels[0] == "u_x @ (0.5, 0.5, 0.5)"
    assert found.labels[1] == "u_x @ (0.5, 0.5, 1.5)"
    assert found.labels[8] == "u_y @ (0.5, 0.5, 0.5)"
    np.testing.assert_array_equal(found.sites, np.tile(np.arange(8), 3))
    np.testing.assert_array_equal(found.directions[8:16], np.tile([0.0, 1.0, 0.0], (8, 1)))
    assert found.spacing == (1.0, 1.0, 1.0)
    # Equal blocks: what one component sees, the others see too.
    blocks = [found.matrix[8 * k : 8 * k + 8, space.layout.component("u", k)].toarray() for k in range(3)]
    np.testing.assert_array_equal(blocks[0], blocks[1])
    np.testing.assert_array_equal(blocks[0], blocks[2])
    scalar = Voxels(field="p", size=1.0).functionals(space)
    assert scalar.labels[0] == "p @ (0.5, 0.5, 0.5)"
    assert not scalar.directions.any()
    pair = Voxels(field="c", size=1.0, components=(1,)).functionals(space)
    assert pair.labels[0] == "c_1 @ (0.5, 0.5, 0.5)"


def test_a_direction_measures_that_part_of_the_vector(make_space):
    space = make_space(3, n=2, lengths=2.0)
    e = (0.6, 0.0, 0.8)
    every = Voxels(size=1.0).functionals(space)
    along = Voxels(size=1.0, directions=[e, (0.0, 1.0, 0.0)]).functionals(space)
    state = space.state(u=lambda x: np.stack([x[:, 0], 2 - x[:, 1], x[:, 2] ** 2], axis=1))
    x, y, z = every(state).reshape(3, -1)
    np.testing.assert_allclose(along(state), np.concatenate([0.6 * x + 0.8 * z, y]), atol=1e-14)
    np.testing.assert_array_equal(along.directions[0], e)
    assert along.labels[0].startswith("u_[0.6, 0, 0.8] @")
    # A direction without x touches no dof of x.
    assert along.matrix[8:, space.layout.component("u", 0)].nnz == 0


def test_slices_are_layers_centred_at_their_positions(make_space):
    space = make_space(3, n=3, lengths=3.0)
    function = Quadratic(3, 1)
    state = space.state(u=lambda x: np.stack([function(x)] * 3, axis=1))
    # Off the raster too: 1.2 is no centre of a layer of the grid at the mesh's zero.
    for position in (1.5, 1.2):
        found = Voxels(size=1.0, slices=[Slice("z", position)]).functionals(space)
        assert found.count == 27
        np.testing.assert_allclose(found.centres[:, 2], position)
        np.testing.assert_allclose(found(state), np.tile(function(found.centres[:9]), 3), atol=1e-12)
    whole = Voxels(size=1.0).functionals(space)
    layer = Voxels(size=1.0, slices=[Slice("z", 1.5)]).functionals(space)
    chosen = np.flatnonzero(whole.centres[:, 2] == 1.5)
    np.testing.assert_allclose(layer.matrix.toarray(), whole.matrix.toarray()[chosen], atol=1e-15)


def test_crossing_slices_measure_a_voxel_once(make_space):
    space = make_space(3, n=3, lengths=3.0)
    both = Voxels(size=1.0, slices=[Slice("z", 1.5), Slice("x", 0.5)], components=(0,)).functionals(space)
    assert both.count == 9 + 9 - 3
    assert len(np.unique(both.centres, axis=0)) == both.count
    twice = Voxels(size=1.0, slices=[Slice("z", 1.5), Slice("z", 1.5)], components=(0,)).functionals(space)
    assert twice.count == 9


def test_a_slice_of_a_rotated_grid(make_space):
    space = make_space(3, n=4, lengths=4.0)
    position = float(TURN[2] @ np.full(3, 2.0))
    found = Voxels(size=0.8, axes=rows(TURN), slices=[Slice(2, position)], coverage=1.0).functionals(space)
    np.testing.assert_allclose(found.centres @ TURN[2], position, atol=1e-12)
    assert found.n_sites > 4


def test_an_affine_places_voxel_centres(make_space):
    space = make_space(3, n=3, lengths=3.0)
    # A flipped first axis and 0.5 x 0.75 x 1 cm voxels: voxel (0, 0, 0) is centred at (2.75, 0.375, 0.5).
    affine = [[-0.5, 0, 0, 2.75], [0, 0.75, 0, 0.375], [0, 0, 1.0, 0.5], [0, 0, 0, 1]]
    found = Voxels(field="p", affine=affine, shape=(6, 4, 3)).functionals(space)
    numbers = np.stack(np.unravel_index(np.arange(72), (6, 4, 3)), axis=1)
    np.testing.assert_allclose(
        found.centres, numbers @ np.array(affine)[:3, :3].T + np.array(affine)[:3, 3], atol=1e-12
    )
    assert found.spacing == pytest.approx((0.5, 0.75, 1.0))
    values = found(space.state(p=lambda x: x @ [1.0, 2.0, 3.0]))
    np.testing.assert_allclose(values, found.centres @ [1.0, 2.0, 3.0], atol=1e-12)


def test_an_oblique_affine(make_space):
    # Voxel edges are the matrix's columns, not its rows.
    space = make_space(3, n=4, lengths=4.0)
    affine = np.eye(4)
    affine[:3, :3] = TURN.T * (0.4, 0.6, 0.9)
    affine[:3, 3] = 2.0 - affine[:3, :3] @ (1.5, 1.0, 0.5)
    found = Voxels(field="p", affine=affine.tolist(), shape=(4, 3, 2), outside="error", coverage=1.0).functionals(space)
    numbers = np.stack(np.unravel_index(np.arange(24), (4, 3, 2)), axis=1)
    np.testing.assert_allclose(found.centres, numbers @ affine[:3, :3].T + affine[:3, 3], atol=1e-12)
    assert found.spacing == pytest.approx((0.4, 0.6, 0.9))
    values = found(space.state(p=lambda x: x @ [1.0, 2.0, 3.0]))
    np.testing.assert_allclose(values, found.centres @ [1.0, 2.0, 3.0], atol=1e-12)


def test_a_field_of_view_counts_or_names_what_lies_outside(make_space):
    space = make_space(2, n=3, lengths=3.0)
    view = {"field": "p", "size": 1.0, "origin": (1.0, 1.0), "shape": (4, 3)}
    found = Voxels(**view).functionals(space)
    assert found.count == 4
    assert found.dropped == 12 - 4
    with pytest.raises(ShapeError, match=r"8 of the grid are less than 60% inside .*first: 1\.5, 3\.5"):
        Voxels(**view, outside="error").functionals(space)
    inside = Voxels(**(view | {"shape": (2, 2)}), outside="error").functionals(space)
    assert inside.count == 4
    assert inside.dropped == 0
    edge = Voxels(**(view | {"shape": (2, 2), "origin": (1.5, 1.5)}), coverage=0.5).functionals(space)
    assert (edge.count, edge.dropped) == (3, 1)
    with pytest.raises(ShapeError, match="first: 3, 3"):
        Voxels(**(view | {"shape": (2, 2), "origin": (1.5, 1.5)}), coverage=0.5, outside="error").functionals(space)


def test_without_a_field_of_view_only_voxels_that_meet_the_domain_count(make_space):
    # The square fills about half of the box around it in a grid turned by 45 degrees.
    space = make_space(2, n=3, lengths=3.0)
    axes = rows(np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0))
    settings = {"field": "p", "size": 0.3, "axes": axes}
    met = Voxels(**settings, coverage=0.0).functionals(space)
    assert met.dropped == 0
    some = Voxels(**settings, coverage=0.7).functionals(space)
    assert some.count + some.dropped == met.count < 0.7 * 15**2


def test_a_field_of_view_limits_slices(make_space):
    space = make_space(3, n=3, lengths=3.0)
    settings = {"field": "p", "size": 1.0, "origin": (1.0, 1.0, -7.0), "shape": (3, 2, 50)}
    found = Voxels(**settings, slices=[Slice("z", 1.5), Slice("z", 2.5)]).functionals(space)
    assert found.count == 2 * 4
    assert found.dropped == 2 * 2
    assert found.centres[:, :2].min() == 1.5


@pytest.mark.parametrize("order", [1, 2])
def test_voxels_add_up_to_the_mass_matrix_of_a_backend(make_space, order):
    backend = pytest.importorskip("dacore_skfem.backend")
    mesh = make_space(3, n=2, lengths=2.0, order=order).mesh
    space = FiniteElementSpace(backend.SkfemBackend().discretize(mesh, [Field("u", 3, order), Field("p", 1)]))
    found = Voxels(size=0.7, axes=rows(TURN), average=False, coverage=0.0, components=(2,)).functionals(space)
    expected = np.zeros(space.n_dofs)
    expected[space.layout.component("u", 2)] = space.scalar_product("u").sum(axis=0)
    np.testing.assert_allclose(found.matrix.sum(axis=0), expected, atol=1e-13)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"slices": [Slice("z", 40.0)]}, r"the slice z = 40 cm lies outside the domain, which spans 0 to 3"),
        ({"slices": [Slice("z", 1.5), Slice("z", 3.3)]}, r"the slice z = 3.3 cm has no voxel that is 60% inside"),
        ({"size": 9.0}, "the grid has no voxel that is 60% inside the domain; use smaller voxels"),
        ({"origin": (50.0, 0.0, 0.0), "shape": (2, 2, 2)}, "the grid lies outside the domain"),
        ({"components": (3,)}, "component of u: got 3, expected x, y, z or 0 to 2"),
        ({"components": (1, "y")}, "expected none twice"),
        ({"field": "p", "directions": [(1.0, 0.0, 0.0)]}, "field p has 1 components, expected 3"),
        ({"size": 0.001}, "expected at most 2e"),
    ],
)
def test_what_a_space_cannot_show_is_refused(make_space, settings, message):
    with pytest.raises(ShapeError, match=message):
        Voxels(**({"size": 1.0} | settings)).functionals(make_space())


def test_unknown_fields_and_spaces_without_cells_are_refused(make_space, point_space):
    with pytest.raises(CapabilityError, match=r"'q'.*u, p"):
        Voxels(field="q", size=1.0).functionals(make_space())
    with pytest.raises(CapabilityError, match="needs a state space with cells"):
        Voxels(size=1.0).functionals(point_space())
    with pytest.raises(ShapeError, match="settings have 2 dimensions, the domain has 3"):
        Voxels(size=(1.0, 1.0)).functionals(make_space())
    with pytest.raises(ShapeError, match="slice axis: got 'z', expected x, y"):
        Voxels(size=1.0, slices=[Slice("z", 1.0)]).functionals(make_space(2))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "neither size nor affine"),
        ({"size": 0.0}, "voxel size"),
        ({"size": (1.0, -1.0, 1.0)}, "voxel size"),
        ({"size": 1.0, "affine": rows(np.eye(4))}, "both affine and size"),
        ({"size": (1.0, 1.0), "origin": (0.0, 0.0, 0.0)}, r"different dimensions \(size: 2, origin: 3\)"),
        ({"size": 1.0, "axes": rows(np.diag([1.0, 1.0, 1.1]))}, "orthonormal to 2.1e-01 only"),
        ({"affine": rows(np.eye(4) + np.eye(4)[:, [1, 0, 2, 3]] * np.array([1, 0, 0, 0]))}, "orthonormal"),
        ({"affine": rows(np.diag([1.0, 1.0, 0.0, 1.0]))}, "a voxel edge has length 0"),
        ({"affine": rows(2.0 * np.eye(4))}, "last row"),
        ({"size": 1.0, "coverage": 1.5}, "coverage: got 1.5"),
        ({"size": 1.0, "outside": "ignore"}, "outside: got 'ignore'"),
        ({"size": 1.0, "quadrature": 0}, "quadrature: got 0"),
        ({"size": 1.0, "quadrature": "gauss"}, "quadrature: got 'gauss'"),
        ({"size": 1.0, "shape": (2, 0, 2)}, "shape"),
        ({"size": 1.0, "components": (0,), "directions": [(1.0, 0.0, 0.0)]}, "both components and directions"),
        ({"size": 1.0, "directions": [(1.0, 1.0, 0.0)]}, "expected a unit vector"),
        ({"size": 1.0, "slices": [{"axis": "w", "position": 1.0}]}, "slice axis: got 'w'"),
        ({"size": 1.0, "slices": [{"axis": "z", "position": float("nan")}]}, "slice position"),
        ({"size": (1.0,) * 4}, "4 dimensions"),
    ],
)
def test_wrong_settings_are_refused_when_made(settings, message):
    with pytest.raises(ShapeError, match=message):
        Voxels(**settings)


def test_settings_come_from_a_scene():
    table = {"size": 1, "slices": [{"axis": "z", "position": 8.5}], "components": ["y", 0], "coverage": 0.5}
    made = build(Voxels, table, "scene.toml: observe")
    assert made == Voxels(size=1.0, slices=(Slice("z", 8.5),), components=("y", 0), coverage=0.5)
    assert hash(made) == hash(Voxels(size=1.0, slices=(Slice("z", 8.5),), components=("y", 0), coverage=0.5))
    with pytest.raises(SceneError, match=r"slices\[0\]"):
        build(Voxels, {"size": 1.0, "slices": [{"axis": "w", "position": 8.5}]}, "scene.toml: observe")


@pytest.mark.parametrize("dim", [2, 3])
def test_quadrature_converges_to_the_exact_average(make_space, dim):
    # In whole voxels, on a mesh that no sample point hits; the midpoint rule is of second order on
    # kinked functions, but its error jumps with the points' luck: a bound on the trend, not on one number.
    space = make_space(dim, n=4, lengths=4.0, order=2, seed=7)
    settings = {"size": 0.93, "axes": rows(turn(dim, 3)), "coverage": 1.0, "components": (0,)}
    state = space.state(u=lambda x: np.stack([np.exp(np.sin(3 * x[:, 0]) + x[:, 1])] * dim, axis=1))
    exact = Voxels(**settings).functionals(space)
    values = exact(state)
    errors, steps = [], np.array([2, 4, 8, 16])
    for points in steps:
        sampled = Voxels(**settings | {"coverage": 0.0}, quadrature=int(points)).functionals(space)
        found = dict(zip(sampled.labels, sampled(state)))
        errors.append(np.abs([found[label] for label in exact.labels] - values).max())
    rate = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert len(values) > 5
    assert 1.5 < rate < 2.6
    assert errors[-1] < 1e-3 * np.abs(values).max()


def test_quadrature_covers_as_clipping_does(make_space):
    space = make_space(2, n=3, lengths=2.35)
    settings = {"field": "p", "size": 0.5, "coverage": 0.5}
    exact = Voxels(**settings).functionals(space)
    sampled = Voxels(**settings, quadrature=20).functionals(space)
    assert exact.labels == sampled.labels
    assert exact.dropped == sampled.dropped


def test_grid_coordinates_go_there_and_back():
    grid = Grid((1.0, 2.0, 3.0), TURN, (0.5, 1.0, 2.0))
    points = np.random.default_rng(0).uniform(-5, 5, (20, 3))
    np.testing.assert_allclose(grid.to_space(grid.to_grid(points)), points, atol=1e-13)
    np.testing.assert_allclose(grid.to_grid(grid.centres(np.array([[1, 2, 3]]))), [[1.5, 2.5, 3.5]], atol=1e-13)
    assert grid.volume == 1.0
    shifted = grid.centred(1, 0.7)
    np.testing.assert_allclose(shifted.centres(np.array([[4, 0, -2]])) @ TURN[1], [0.7], atol=1e-13)
