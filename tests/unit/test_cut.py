"""Cuts of meshes by planes: exact areas, exact fields, conforming triangulations."""

import numpy as np
import pytest

from dacore.core.mesh import Mesh
from dacore.errors import ShapeError
from dacore.geometry.cut import cut_plane, planar_domain


def box(n, lengths=(1.0, 2.0, 3.0)):
    """Points and Kuhn tetrahedra of a box of n³ cubes."""
    axes = [np.linspace(0.0, length, n + 1) for length in lengths]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = []
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]):
        path = [corner]
        for axis in order:
            path.append(path[-1] + np.eye(3, dtype=int)[axis])
        tets = np.stack([p @ [(n + 1) ** 2, n + 1, 1] for p in path], axis=1)
        cells.append(tets if order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]) else tets[:, [0, 2, 1, 3]])
    return points, np.concatenate(cells)


def jiggled(n, seed=0):
    points, cells = box(n)
    rng = np.random.default_rng(seed)
    inside = ((points > 1e-9) & (points < np.array([1.0, 2.0, 3.0]) - 1e-9)).all(axis=1)
    points[inside] += 0.2 / n * rng.uniform(-1, 1, (inside.sum(), 3))
    return points, cells


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.77, 1.0])
def test_area_and_linear_fields_are_exact(axis, share):
    points, cells = jiggled(4)
    lengths = np.array([1.0, 2.0, 3.0])
    cut = cut_plane(points, cells, axis, share * lengths[axis])
    rest = [a for a in range(3) if a != axis]
    assert cut.axes == tuple(rest)
    assert cut.area == pytest.approx(lengths[rest].prod(), rel=1e-12)
    assert (cut.areas > 0).all()
    coefficients = np.array([0.3, -2.0, 1.7])
    matrix = cut.interpolation(cells, 1, len(points))
    expected = cut.points @ coefficients[rest] + coefficients[axis] * cut.value + 5.0
    np.testing.assert_allclose(matrix @ (points @ coefficients + 5.0), expected, atol=1e-12)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-14)


def test_plane_through_nodes_of_a_regular_mesh_counts_faces_once():
    points, cells = box(4)
    for value in (0.0, 0.75, 1.5, 3.0):
        cut = cut_plane(points, cells, 2, value)
        assert cut.area == pytest.approx(2.0, rel=1e-12)
        assert len(np.unique(np.round(cut.points, 9), axis=0)) == len(cut.points) == 25


@pytest.mark.parametrize("value", [0.33, 1.5])
def test_triangulation_conforms_and_outline_is_closed(value):
    points, cells = jiggled(4)
    cut = cut_plane(points, cells, 2, value)
    # Euler: V - E + F = 1 for a disc, and every boundary point has one edge in and one out.
    edges = np.unique(np.sort(cut.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    assert len(cut.points) - len(edges) + len(cut.triangles) == 1
    np.testing.assert_array_equal(np.sort(cut.outline[:, 0]), np.sort(cut.outline[:, 1]))
    lengths = np.linalg.norm(cut.points[cut.outline[:, 1]] - cut.points[cut.outline[:, 0]], axis=1)
    assert lengths.sum() == pytest.approx(6.0, rel=1e-12)


def test_hole_is_left_out_and_outlined():
    points, cells = box(6, (1.0, 1.0, 1.0))
    centres = points[cells].mean(axis=1)
    kept = cells[~((centres > 1 / 3) & (centres < 2 / 3)).all(axis=1)]
    cut = cut_plane(points, kept, 1, 0.45)
    assert cut.area == pytest.approx(1 - 1 / 9, rel=1e-12)
    lengths = np.linalg.norm(cut.points[cut.outline[:, 1]] - cut.points[cut.outline[:, 0]], axis=1)
    assert lengths.sum() == pytest.approx(4 + 4 / 3, rel=1e-12)


def test_area_of_a_ball_cut_converges_to_the_disc():
    from scipy.spatial import Delaunay

    errors = []
    for n in (6, 12):
        grid = np.linspace(-1, 1, n + 1)
        cube = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
        size, length = np.abs(cube).max(axis=1, keepdims=True), np.linalg.norm(cube, axis=1, keepdims=True)
        points = cube * size / np.where(length > 0, length, 1.0)
        cells = Delaunay(points, qhull_options="QJ Pp").simplices
        errors.append(abs(cut_plane(points, cells, 2, 0.3).area - np.pi * (1 - 0.09)))
    assert errors[1] < 0.4 * errors[0]
    assert errors[1] < 0.1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_quadratic_field_is_exact_at_the_points_and_closer_when_refined(axis):
    points, cells = jiggled(3)
    facets = Mesh.__new__(Mesh)  # Only the numbering of P2 nodes is needed, not a valid domain.
    for name, value in (("points", points), ("cells", cells)):
        object.__setattr__(facets, name, value)
    nodes, where = facets.cell_nodes(2), facets.nodes(2)

    def field(x):
        return x[:, 0] ** 2 - 3.0 * x[:, 1] * x[:, 2] + x[:, 2]

    cut = cut_plane(points, cells, axis, 0.41)
    fine = cut.refined(points, cells)
    assert len(fine.triangles) == 4 * len(cut.triangles)
    assert fine.area == pytest.approx(cut.area, rel=1e-12)
    assert len(fine.outline) == 2 * len(cut.outline)
    for slice_ in (cut, fine):
        space = np.insert(slice_.points, axis, 0.41, axis=1)
        got = slice_.interpolation(nodes, 2, len(where)) @ field(where)
        np.testing.assert_allclose(got, field(space), atol=1e-11)


def test_planar_domain_is_its_own_slice():
    points = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    cut = planar_domain(points, cells)
    assert cut.area == pytest.approx(2.0)
    assert len(cut.outline) == 4
    np.testing.assert_array_equal((cut.interpolation(cells, 1, 4) @ points), points)


def test_inputs_are_not_changed():
    points, cells = jiggled(2)
    before = points.copy(), cells.copy()
    cut_plane(points, cells, 0, 0.5)
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(cells, before[1])


def test_errors_say_what_to_do():
    points, cells = box(2)
    with pytest.raises(ShapeError, match="misses the domain, which runs from 0 to 3"):
        cut_plane(points, cells, 2, 3.5)
    with pytest.raises(ShapeError, match="planar_domain"):
        cut_plane(points[:, :2], cells[:, :3], 2, 0.5)
    with pytest.raises(ShapeError, match="expected triangles"):
        planar_domain(points, cells)
    with pytest.raises(ShapeError, match="only touches"):
        cut_plane(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]]), 2, 1.0)
    cut = cut_plane(points, cells, 2, 1.0)
    with pytest.raises(ShapeError, match="expected 10 for order 2"):
        cut.interpolation(cells, 2, len(points))
