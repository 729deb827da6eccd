"""Exact integrals over grid boxes against an independent geometry (Qhull) and closed forms."""

import tracemalloc
from itertools import combinations, permutations, product
from math import factorial

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, Delaunay, HalfspaceIntersection, QhullError

from dacore.core.simplex import lagrange, local_edges
from dacore.errors import ShapeError
from dacore.geometry.clip import basis_means, box_integrals, clip
from dacore.geometry.clip_split import split, volume_fractions


def kuhn(dim, n, length, jitter=0.0, seed=0):
    """Points and positive cells of a cube of `length` cut in n^dim cubes, inner points moved at random."""
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    inner = ((grid > 0) & (grid < n)).all(axis=1)
    shift = np.random.default_rng(seed).uniform(-jitter, jitter, grid.shape) * inner[:, None]
    strides = (n + 1) ** np.arange(dim - 1, -1, -1)
    corners = np.array(list(product(range(n), repeat=dim))) @ strides
    cells = []
    for order in permutations(range(dim)):
        steps = np.concatenate([[0], np.cumsum(strides[list(order)])])
        cells.append(corners[:, None] + steps)
    cells = np.concatenate(cells)
    points = (grid + shift) * length / n
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[negative, :2] = cells[negative, 1::-1]
    return points, cells


def p2_nodes(points, cells):
    """P2 nodes (c, n_local) and their coordinates."""
    pairs = np.sort(cells[:, local_edges(points.shape[1])], axis=2)
    edges, number = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    nodes = np.concatenate([cells, len(points) + number.reshape(len(cells), -1)], axis=1)
    return nodes, np.concatenate([points, points[edges].mean(axis=1)])


def span(points):
    """Boxes that hold all points."""
    return np.floor(points.min(axis=0)).astype(int), np.ceil(points.max(axis=0)).astype(int)


def rotation(dim, seed):
    """A random rotation."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))
    return q


def quadratic_integral(corners, function):
    """∫ of a quadratic over simplices (k, d + 1, d): its P2 interpolant integrated by nodal weights."""
    dim = corners.shape[2]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / factorial(dim)
    middles = np.stack([0.5 * (corners[:, i] + corners[:, j]) for i, j in combinations(range(dim + 1), 2)], axis=1)
    vertex, edge = {2: (0.0, 1 / 3), 3: (-1 / 20, 1 / 5)}[dim]
    return float((volumes * (vertex * function(corners).sum(axis=1) + edge * function(middles).sum(axis=1))).sum())


def intersection(corners, box):
    """Simplices that fill the intersection of a simplex with the unit box `box`, by Qhull."""
    dim = corners.shape[1]
    planes = [np.append(row, -box[a] - 1.0) for a, row in enumerate(np.eye(dim))]
    planes += [np.append(-row, box[a]) for a, row in enumerate(np.eye(dim))]
    planes = np.concatenate([planes, ConvexHull(corners).equations])
    # The deepest point: maximise r under n·x + r <= −b.
    found = linprog(
        np.append(np.zeros(dim), -1.0),
        A_ub=np.column_stack([planes[:, :dim], np.ones(len(planes))]),
        b_ub=-planes[:, dim],
        bounds=[(None, None)] * dim + [(None, 1.0)],
    )
    if found.status != 0 or found.x[dim] < 1e-7:
        return np.empty((0, dim + 1, dim))
    try:
        points = HalfspaceIntersection(planes, found.x[:dim]).intersections
        return points[Delaunay(points).simplices]
    except QhullError:
        return np.empty((0, dim + 1, dim))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_one_cell_against_qhull(dim, seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.3, 2.4, (dim + 1, dim))
    cell = np.arange(dim + 1)[None]
    nodes, places = p2_nodes(corners, cell)
    lower, upper = span(corners)
    weights = rng.standard_normal((dim, dim))
    slope = rng.standard_normal(dim)

    def function(x):
        return 0.7 + x @ slope + np.einsum("...i,ij,...j->...", x, weights, x)

    linear = box_integrals(corners, cell, cell, 1, lower, upper)
    quadratic = box_integrals(corners, cell, nodes, 2, lower, upper)
    for row, box in enumerate(product(*[range(a, b) for a, b in zip(lower, upper)])):
        pieces = intersection(corners, np.array(box))
        volume = quadratic_integral(pieces, lambda x: np.ones(x.shape[:-1]))
        assert linear[[row]].sum() == pytest.approx(volume, abs=1e-9)
        assert (linear[[row]] @ (corners @ slope))[0] == pytest.approx(
            quadratic_integral(pieces, lambda x: x @ slope), abs=1e-8
        )
        assert (quadratic[[row]] @ function(places))[0] == pytest.approx(quadratic_integral(pieces, function), abs=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_boxes_inside_a_rotated_cube_give_closed_forms(dim, order):
    # In a cube whose grid is rotated against it, a polynomial's mean over a whole unit box is known.
    points, cells = kuhn(dim, 4, 4.1, jitter=0.25, seed=3)
    nodes, places = p2_nodes(points, cells) if order == 2 else (cells, points)
    turn, shift = rotation(dim, 5), np.full(dim, 0.37)
    scaled = points @ turn.T + shift
    lower, upper = span(scaled)
    matrix = box_integrals(scaled, cells, nodes, order, lower, upper)
    weights = np.random.default_rng(1).standard_normal((dim, dim)) * (order == 2)
    slope = np.arange(1.0, dim + 1.0)
    grid_places = places @ turn.T + shift
    values = 1.5 + grid_places @ slope + np.einsum("ni,ij,nj->n", grid_places, weights, grid_places)
    whole = np.flatnonzero(np.abs(matrix.sum(axis=1) - 1.0) < 1e-11)
    centres = np.stack(np.unravel_index(whole, upper - lower), axis=1) + lower + 0.5
    expected = 1.5 + centres @ slope + np.einsum("ni,ij,nj->n", centres, weights, centres) + np.trace(weights) / 12.0
    assert len(whole) > 2
    np.testing.assert_allclose((matrix @ values)[whole], expected, atol=1e-12 * np.abs(values).max())
    # All boxes together hold the integral over the cube.
    np.testing.assert_allclose(
        (matrix @ values).sum(),
        quadratic_integral(scaled[cells], lambda x: 1.5 + x @ slope + np.einsum("...i,ij,...j->...", x, weights, x)),
        rtol=1e-12,
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mesh_in_grid_planes_is_not_cut(dim):
    # Two cells a box and axis, facets in the grid's planes: every piece is a whole cell, even after
    # a rotation that misses the planes by round-off.
    points, cells = kuhn(dim, 4, 4.0)
    turn = rotation(dim, 2)
    there_and_back = (points @ turn.T) @ turn
    for mesh in (points, there_and_back):
        pieces = list(clip(mesh, cells, np.zeros(dim, int), np.full(dim, 4)))
        assert sum(len(one.cell) for one in pieces) == len(cells)
        assert all((one.fraction == 1.0).all() for one in pieces)
    matrix = box_integrals(there_and_back, cells, cells, 1, np.zeros(dim, int), np.full(dim, 4))
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_vertices_on_planes_leave_no_empty_pieces_behind(dim):
    points, cells = kuhn(dim, 2, 3.0)
    lower, upper = np.zeros(dim, int), np.full(dim, 3)
    pieces = list(clip(points * np.array([1.0, 2.0, 1.0])[:dim], cells, lower, upper * [1, 2, 1][:dim]))
    fractions = np.concatenate([one.fraction for one in pieces])
    assert (fractions > 0).all()
    assert fractions.sum() == pytest.approx(len(cells), rel=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_asked_boxes_are_those_of_the_whole_grid(dim):
    points, cells = kuhn(dim, 5, 4.0, jitter=0.3, seed=1)
    scaled = points @ rotation(dim, 1).T
    lower, upper = span(scaled)
    whole = box_integrals(scaled, cells, cells, 1, lower, upper).toarray().reshape(*(upper - lower), -1)
    first, last = lower.copy(), upper.copy()
    first[-1], last[-1] = lower[-1] + 2, lower[-1] + 3
    layer = box_integrals(scaled, cells, cells, 1, first, last).toarray()
    np.testing.assert_allclose(layer, whole[..., 2, :].reshape(layer.shape), atol=1e-15)


def test_a_slice_cuts_only_the_cells_that_meet_it():
    points, cells = kuhn(3, 6, 5.9, jitter=0.2)
    lower, upper = np.array([0, 0, 2]), np.array([6, 6, 3])
    heights = points[cells, 2]
    meets = np.flatnonzero((heights.min(axis=1) < 3) & (heights.max(axis=1) > 2))
    seen = np.unique(np.concatenate([one.cell for one in clip(points, cells, lower, upper)]))
    np.testing.assert_array_equal(seen, meets)
    assert len(meets) < len(cells) / 2


@pytest.mark.parametrize("order", [1, 2])
def test_the_batch_changes_nothing(order):
    points, cells = kuhn(3, 2, 3.3, jitter=0.3, seed=4)
    nodes, _ = p2_nodes(points, cells) if order == 2 else (cells, points)
    lower, upper = span(points)
    one = box_integrals(points, cells, nodes, order, lower, upper)
    other = box_integrals(points, cells, nodes, order, lower, upper, batch=13)
    np.testing.assert_allclose(one.toarray(), other.toarray(), atol=1e-16)


def test_a_thin_layer_of_a_large_cell():
    # Round-off of coordinates as large as the cell is far larger than that of coordinates at the layer.
    corners = 1e6 * np.array([[-0.1, -0.2, -0.6], [1.0, -0.3, -0.2], [0.1, 0.9, 0.1], [0.2, 0.2, 0.7]])
    cell = np.arange(4)[None]
    seen = list(clip(corners / [1e5, 1e5, 1.0], cell, np.array([-10, -10, 0]), np.array([20, 20, 1])))
    layer = sum(one.fraction.sum() for one in seen)
    heights = np.linspace(0, 1, 9)
    turned = corners[:, [2, 0, 1]]
    areas = []
    for height in heights:
        below, above = turned[turned[:, 0] < height], turned[turned[:, 0] >= height]
        ends = np.array([a + (height - a[0]) / (b[0] - a[0]) * (b - a) for a in below for b in above])
        areas.append(ConvexHull(ends[:, 1:]).volume)
    volume = abs(np.linalg.det(corners[1:] - corners[0])) / 6
    assert layer == pytest.approx(np.mean(areas) / volume, rel=1e-6)


def test_memory_is_bounded_by_the_batch_not_by_the_boxes():
    corners = np.array([[0.0, 0.0, 0.0], [24.3, 0.2, 0.1], [0.3, 23.7, 0.4], [0.1, 0.2, 24.4]])
    cell = np.arange(4)[None]
    lower, upper = span(corners)
    matrix = box_integrals(corners, cell, cell, 1, lower, upper)
    volume = abs(np.linalg.det(corners[1:] - corners[0])) / 6
    np.testing.assert_allclose(matrix.sum(), volume, rtol=1e-12)
    tracemalloc.start()
    n_pieces = sum(len(one.cell) for one in clip(corners, cell, lower, upper, batch=512))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    piece = 4 * 7 * 8
    assert n_pieces > 40 * 512
    assert peak < 60 * 512 * piece < n_pieces * piece


@pytest.mark.parametrize(("dim", "n_below"), [(2, 1), (2, 2), (3, 1), (3, 2), (3, 3)])
def test_split_keeps_volume_and_separates_sides(dim, n_below):
    rng = np.random.default_rng(n_below)
    heights = rng.uniform(0.1, 1.0, (20, dim + 1))
    heights[:, :n_below] *= -1
    heights = rng.permuted(heights, axis=1)
    corners = rng.uniform(0, 5, (20, dim + 1, dim))
    axis, plane = rng.integers(dim, size=20), rng.integers(-4, 4, size=20)
    corners[np.arange(20), :, axis] = plane[:, None] + heights
    unit = np.broadcast_to(np.eye(dim + 1), (20, dim + 1, dim + 1))
    pieces, source = split(np.concatenate([unit, corners], axis=2), axis, plane)
    fractions = volume_fractions(pieces[:, :, : dim + 1])
    np.testing.assert_allclose(np.bincount(source, fractions), 1.0, rtol=1e-13)
    above = np.einsum("kvi,ki->kv", pieces[:, :, : dim + 1], heights[source])
    assert ((above > -1e-14).all(axis=1) | (above < 1e-14).all(axis=1)).all()
    carried = np.einsum("kvi,kid->kvd", pieces[:, :, : dim + 1], corners[source])
    np.testing.assert_allclose(pieces[:, :, dim + 1 :], carried, atol=1e-13)


@pytest.mark.parametrize(("dim", "vertex", "edge"), [(2, 0.0, 1 / 3), (3, -1 / 20, 1 / 5)])
def test_means_of_the_quadratic_basis_on_a_whole_cell(dim, vertex, edge):
    means = basis_means(2, np.eye(dim + 1)[None])[0]
    np.testing.assert_allclose(means[: dim + 1], vertex, atol=1e-16)
    np.testing.assert_allclose(means[dim + 1 :], edge, rtol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_means_of_the_basis_on_a_part_of_a_cell(dim):
    part = np.random.default_rng(0).dirichlet(np.ones(dim + 1), size=(1, dim + 1))

    def basis(number):
        return lambda b: lagrange(2, b)[..., number]

    own = np.eye(dim + 1)[None, :, 1:]
    volume = quadratic_integral(part[:, :, 1:], lambda x: np.ones(x.shape[:-1]))
    means = basis_means(2, part)[0]
    for number in range(means.size):
        expected = quadratic_integral(
            part[:, :, 1:], lambda x, n=number: basis(n)(np.concatenate([1 - x.sum(-1, keepdims=True), x], -1))
        )
        assert means[number] == pytest.approx(expected / volume, rel=1e-11)
    assert quadratic_integral(own, lambda x: np.ones(x.shape[:-1])) == pytest.approx(1 / factorial(dim))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"order": 3}, "element order: got 3"),
        ({"upper": np.array([2, 0, 2])}, "expected at least one on each axis"),
        ({"nodes": np.zeros((1, 10), dtype=int)}, r"nodes: got shape \(1, 10\), expected \(1, 4\)"),
        ({"lower": np.zeros(2, dtype=int)}, "lower: got shape"),
        ({"points": np.zeros((4, 4))}, "points: got 4 coordinates"),
    ],
)
def test_wrong_input_is_refused(change, message):
    good = {
        "points": np.concatenate([np.zeros((1, 3)), np.eye(3)]),
        "cells": np.arange(4)[None],
        "nodes": np.arange(4)[None],
        "order": 1,
        "lower": np.zeros(3, dtype=int),
        "upper": np.ones(3, dtype=int),
    }
    assert box_integrals(**good).sum() == pytest.approx(1 / 6)
    with pytest.raises(ShapeError, match=message):
        box_integrals(**(good | change))
