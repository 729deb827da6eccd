import numpy as np
import pytest
from scipy.spatial import Delaunay

from dacore.core.simplex import barycentric_gradients
from dacore.errors import ShapeError
from dacore.geometry import locate
from dacore.geometry.locate import PointLocator, morton_codes
from tests.meshes import shuffled_box


def exhaustive(points, cells, x, tolerance=1e-9):
    """Test every point against every cell with plain linear solves; the lowest cell that holds it, or −1."""
    vertices = points[cells]
    system = np.concatenate([np.swapaxes(vertices, 1, 2), np.ones((len(cells), 1, cells.shape[1]))], axis=1)
    right = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    coordinates = np.einsum("cij,pj->pci", np.linalg.inv(system), right)
    inside = (coordinates >= -tolerance).all(axis=2)
    return np.where(inside.any(axis=1), inside.argmax(axis=1), -1)


def graded(dim, seed):
    """A mesh with cells from 1 down to about 1e-6 in size, towards a corner."""
    rng = np.random.default_rng(seed)
    radius = 10.0 ** rng.uniform(-6, 0, size=(150, 1))
    points = np.concatenate([radius * rng.uniform(size=(150, dim)), np.eye(dim), np.zeros((1, dim)), np.ones((1, dim))])
    cells = Delaunay(points).simplices.astype(np.int64)
    volumes = barycentric_gradients(points, cells)[1]
    size = np.ptp(points[cells], axis=1).max(axis=1)
    return points, cells[np.abs(volumes) > 1e-6 * size**dim]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_an_exhaustive_search(dim, seed):
    mesh = shuffled_box(dim, n=3, seed=seed, bumpy=True)
    rng = np.random.default_rng(seed)
    facets = np.concatenate([np.delete(mesh.cells, k, axis=1) for k in range(dim + 1)])
    x = np.concatenate(
        [
            rng.uniform(-0.2, 1.2, size=(500, dim)),
            mesh.points,
            mesh.points[mesh.edges].mean(axis=1),
            mesh.points[facets].mean(axis=1),
            mesh.points[mesh.cells].mean(axis=1),
        ]
    )
    cell, barycentric = PointLocator(mesh.points, mesh.cells).locate(x, outside="mark")
    np.testing.assert_array_equal(cell, exhaustive(mesh.points, mesh.cells, x))
    inside = cell >= 0
    assert 0 < inside.sum() < len(x)
    assert inside[500:].all()
    assert np.isnan(barycentric[~inside]).all()
    assert barycentric[inside].min() >= -1e-9
    np.testing.assert_allclose(barycentric[inside].sum(axis=1), 1.0, atol=1e-14)
    again = np.einsum("pi,pid->pd", barycentric[inside], mesh.points[mesh.cells[cell[inside]]])
    np.testing.assert_allclose(again, x[inside], atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_graded_meshes_lose_no_point(dim, seed):
    points, cells = graded(dim, seed)
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(dim + 1), size=(len(cells), 3))
    x = np.einsum("cki,cid->ckd", weights, points[cells]).reshape(-1, dim)
    cell, _ = PointLocator(points, cells).locate(np.concatenate([x, points[np.unique(cells)]]))
    assert (cell[: len(x)] == np.repeat(np.arange(len(cells)), 3)).mean() > 0.999
    spread = np.concatenate([x, rng.uniform(size=(300, dim)), 10.0 ** rng.uniform(-7, 0, size=(300, dim))])
    found, _ = PointLocator(points, cells).locate(spread, outside="mark")
    np.testing.assert_array_equal(found, exhaustive(points, cells, spread))


@pytest.mark.parametrize("shift", [0.0, 1e4])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e5])
def test_scale_and_place_of_the_mesh_do_not_matter(shift, scale):
    mesh = shuffled_box(3, n=2, bumpy=True)
    points = scale * (mesh.points + shift)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(4), size=len(mesh.cells))
    x = np.einsum("ci,cid->cd", weights, points[mesh.cells])
    surface = points[mesh.facets].mean(axis=1)
    locator = PointLocator(points, mesh.cells)
    np.testing.assert_array_equal(locator.locate(x)[0], np.arange(len(mesh.cells)))
    locator.locate(surface)
    outward = 1e-3 * scale * np.sign(mesh.points[mesh.facets].mean(axis=1) - 0.5)
    assert (locator.locate(surface + 10 * outward, outside="mark")[0] == -1).any()


def test_the_tolerance_is_relative_to_the_cell():
    points = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    locator = PointLocator(points, [[0, 1, 2]], tolerance=1e-6)
    x = np.array([[-9e-6, 5.0], [-11e-6, 5.0], [5.0, -9e-6], [5.0 + 4e-6, 5.0 + 4e-6], [5.0 + 6e-6, 5.0 + 6e-6]])
    np.testing.assert_array_equal(locator.locate(x, outside="mark")[0], [0, -1, 0, 0, -1])


def test_outside_points_are_named():
    mesh = shuffled_box(2, n=2)
    locator = PointLocator(mesh.points, mesh.cells)
    x = np.array([[0.5, 0.5], [1.5, 0.25], [0.1, 0.1], [-1.0, 0.0]])
    with pytest.raises(ShapeError, match=r"point 1 at \(1.5, 0.25\) lies outside the mesh \(2 of 4 points do\)"):
        locator.locate(x)
    np.testing.assert_array_equal(locator.locate(x, outside="mark")[0] >= 0, [True, False, True, False])


def test_holes_are_outside():
    """A box around a point says nothing; only a cell does."""
    mesh = shuffled_box(3, n=5, perturb=0.0)
    middle = np.abs(mesh.points[mesh.cells].mean(axis=1) - 0.5).max(axis=1) < 0.1
    locator = PointLocator(mesh.points, mesh.cells[~middle])
    assert locator.locate([[0.5, 0.5, 0.5], [0.2, 0.5, 0.5]], outside="mark")[0][0] == -1
    assert (locator.locate([[0.2, 0.5, 0.5]])[0] >= 0).all()


def test_small_pieces_of_work_give_the_same(monkeypatch):
    mesh = shuffled_box(3, n=3)
    x = np.random.default_rng(1).uniform(-0.1, 1.1, size=(300, 3))
    whole = PointLocator(mesh.points, mesh.cells).locate(x, outside="mark")
    monkeypatch.setattr(locate, "_PAIRS", 17)
    parts = PointLocator(mesh.points, mesh.cells).locate(x, outside="mark")
    np.testing.assert_array_equal(parts[0], whole[0])
    np.testing.assert_array_equal(parts[1], whole[1])


def test_work_space_stays_bounded_where_all_cells_overlap_in_their_boxes(monkeypatch):
    """A fan of long thin triangles: every box holds the diagonal; pairs are worked off in pieces."""
    n = 800
    angle = np.linspace(0.7, 0.9, n)
    points = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    cells = np.stack([np.zeros(n - 1, dtype=int), np.arange(1, n), np.arange(2, n + 1)], axis=1)
    largest = []
    original = PointLocator._descend

    def watched(self, x, found, level, point, node):
        largest.append(len(point))
        original(self, x, found, level, point, node)

    monkeypatch.setattr(PointLocator, "_descend", watched)
    monkeypatch.setattr(locate, "_PAIRS", 1024)
    x = 0.5 * points[cells].mean(axis=1)
    cell, _ = PointLocator(points, cells).locate(x)
    np.testing.assert_array_equal(cell, np.arange(n - 1))
    assert max(largest) <= 8 * 1024


def test_no_points_and_one_cell():
    locator = PointLocator(np.eye(3)[:, :2], [[0, 1, 2]])
    cell, barycentric = locator.locate(np.empty((0, 2)))
    assert cell.shape == (0,)
    assert barycentric.shape == (0, 3)
    assert locator.locate([[0.2, 0.2]])[0] == [0]


def test_orientation_of_cells_does_not_matter():
    mesh = shuffled_box(3, n=2)
    x = np.random.default_rng(0).uniform(size=(50, 3))
    turned = mesh.cells[:, [1, 0, 2, 3]]
    one, two = (PointLocator(mesh.points, cells).locate(x) for cells in (mesh.cells, turned))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_allclose(one[1], two[1][:, [1, 0, 2, 3]], atol=1e-13)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((3, 4))}, "got 4 coordinates a point"),
        ({"cells": np.empty((0, 3), dtype=int)}, "got none"),
        ({"cells": [[0, 1, 7]]}, "indices run from 0 to 7"),
        ({"cells": [[0, 1]]}, r"got shape \(1, 2\)"),
        ({"tolerance": -1.0}, "tolerance of the locator: got -1.0"),
    ],
)
def test_refuses_what_is_no_mesh(change, message):
    given = {"points": np.eye(3)[:, :2], "cells": [[0, 1, 2]], **change}
    with pytest.raises(ShapeError, match=message):
        PointLocator(**given)


def test_refuses_bad_queries():
    locator = PointLocator(np.eye(3)[:, :2], [[0, 1, 2]])
    with pytest.raises(ShapeError, match="expected 'raise' or 'mark'"):
        locator.locate([[0.1, 0.1]], outside="drop")
    with pytest.raises(ShapeError, match="NaN"):
        locator.locate([[0.1, np.nan]])
    with pytest.raises(ShapeError, match=r"got shape \(1, 3\)"):
        locator.locate([[0.1, 0.1, 0.1]])


@pytest.mark.parametrize("dim", [2, 3])
def test_morton_codes_keep_neighbours_together(dim):
    """Consecutive points along the curve are near each other: far nearer than at random."""
    x = np.random.default_rng(0).uniform(size=(4000, dim))
    along = x[np.argsort(morton_codes(x))]
    step = np.linalg.norm(np.diff(along, axis=0), axis=1).mean()
    assert step < 3.0 * len(x) ** (-1 / dim)
    assert (morton_codes(x) >= 0).all()
    np.testing.assert_array_equal(morton_codes(np.ones((3, dim))), 0)
