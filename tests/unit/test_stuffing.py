"""Isosurface stuffing: the lattice fits together, cuts are exact, volumes converge, angles hold."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from dacore.core.mesh import exterior_facets
from dacore.core.simplex import barycentric_gradients
from dacore.errors import MeshError
from dacore.geometry.lattice import lattice_tetrahedra, octree, oriented
from dacore.geometry.polish import polish
from dacore.geometry.quality import check_manifold, dihedral_angles, facet_measures, measure
from dacore.geometry.sampled import SampledLevelSet, smooth_distance
from dacore.geometry.stencils import cut_cells
from dacore.geometry.stuffing import stuff

LOWER, UPPER = np.full(3, -2.0), np.full(3, 2.0)


def everywhere(points):
    return np.full(len(points), -1.0)


def sphere(radius, centre=(0.0, 0.0, 0.0)):
    return lambda points: np.linalg.norm(points - np.array(centre), axis=1) - radius


def graded(points):
    """Fine near a point off the centre, coarse far from it."""
    return 0.15 + 0.5 * np.linalg.norm(points - [0.7, 0.4, -0.3], axis=1)


# --- the lattice


@pytest.mark.parametrize("sizing", [None, graded, lambda points: np.where(points[:, 0] > 0.3, 0.25, 1.0)])
def test_the_lattice_fits_together(sizing):
    tree = octree(LOWER, 1.0, (4, 4, 4), sizing)
    points, cells = lattice_tetrahedra(tree, everywhere)
    volumes = barycentric_gradients(points, cells)[1]
    assert volumes.min() > 0.0
    # No facet inside: between the outermost leaves' centres and the box's sides there is one surface.
    facets = exterior_facets(cells)
    depth = np.abs(points[facets]).max(axis=2).min(axis=1)
    assert (2.0 - depth <= 0.5 + 1e-12).all()
    assert check_manifold(facets) == (2,)
    assert measure(points, cells).smallest_angle > 29.9


def test_touching_leaves_differ_by_one_level_at_most():
    tree = octree(LOWER, 1.0, (4, 4, 4), lambda points: 0.1 + np.abs(points - 0.55).max(axis=1))
    assert tree.depth >= 3
    boxes = []
    for level in range(tree.depth + 1):
        leaves = tree.leaves(level)
        size = 1.0 / 2**level
        boxes.append(np.column_stack([LOWER + leaves * size, LOWER + (leaves + 1) * size, np.full(len(leaves), level)]))
    every = np.concatenate(boxes)
    assert np.prod(every[:, 3:6] - every[:, :3], axis=1).sum() == pytest.approx(64.0)
    touch = (every[:, None, :3] <= every[None, :, 3:6] + 1e-9).all(2) & (
        every[None, :, :3] <= every[:, None, 3:6] + 1e-9
    ).all(2)
    assert np.abs(every[:, None, 6] - every[None, :, 6])[touch].max() == 1


def test_leaves_are_as_fine_as_asked():
    tree = octree(LOWER, 1.0, (4, 4, 4), graded)
    for level in range(tree.depth + 1):
        leaves = tree.leaves(level)
        if len(leaves):
            assert (1.0 / 2**level <= graded(tree.centres(level, leaves)) * (1 + 1e-9)).all()


# --- cutting


def clipped(values):
    """Share of a tetrahedron where the linear function with these vertex values is negative."""
    inner, outer = values[values < 0], values[values > 0]
    if len(inner) > len(outer):
        return 1.0 - clipped(-values)
    if len(inner) == 0:
        return 0.0
    # Sum over inner vertices of |v_i|³ / Π (v_j - v_i), the simplex formula; limits avoided by distinct values.
    total = 0.0
    for i, v in enumerate(values):
        if v < 0:
            total += (-v) ** 3 / np.prod(np.delete(values, i) - v)
    return total


@pytest.mark.parametrize("signs", [s for s in product((-1, 0, 1), repeat=4) if min(s) < 0])
def test_cut_volume_is_exact_for_every_sign_pattern(signs):
    rng = np.random.default_rng(5)
    points = np.array([[0.0, 0, 0], [1, 0.1, 0], [0.2, 1, 0], [0.1, 0.2, 1]])
    value = np.array(signs) * rng.uniform(0.3, 1.0, 4)
    cells = np.array([[0, 1, 2, 3]])
    edges = np.array([(a, b) for a in range(4) for b in range(4) if value[a] < 0 < value[b]], dtype=int).reshape(-1, 2)
    t = value[edges[:, 0]] / (value[edges[:, 0]] - value[edges[:, 1]])
    cuts = points[edges[:, 0]] + t[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    nodes, pieces = cut_cells(points, value, cells, edges, cuts)
    volumes = barycentric_gradients(nodes, oriented(nodes, pieces))[1]
    whole = barycentric_gradients(points, cells)[1][0]
    assert volumes.min() > 0.0
    assert volumes.sum() / whole == pytest.approx(clipped(value), rel=1e-12)


def test_a_cut_without_its_point_is_refused():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(MeshError, match="no cut point"):
        cut_cells(points, np.array([-1.0, 1, 1, 1]), np.array([[0, 1, 2, 3]]), np.zeros((0, 2), int), np.zeros((0, 3)))


# --- stuffing


def test_volume_and_area_of_a_ball_converge_at_second_order():
    errors = []
    for edge in (0.5, 0.25, 0.125):
        points, cells = stuff(sphere(1.5), LOWER, UPPER, edge)
        area = facet_measures(points, exterior_facets(cells)).sum()
        volume = measure(points, cells).volume
        errors.append([4 / 3 * np.pi * 1.5**3 - volume, 4 * np.pi * 1.5**2 - area])
    rates = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert (rates > 1.7).all()
    assert errors[-1][0] < 0.01 * 4 / 3 * np.pi * 1.5**3


def test_surface_vertices_lie_on_the_surface():
    level_set = sphere(1.3, (0.1, -0.05, 0.2))
    points, cells = stuff(level_set, LOWER, UPPER, 0.4)
    assert np.abs(level_set(points[np.unique(exterior_facets(cells))])).max() < 1e-8


def test_grading_is_finer_where_asked_and_keeps_the_angles():
    points, cells = stuff(sphere(1.5), LOWER, UPPER, 0.5, lambda x: np.where(x[:, 2] < -0.5, 0.25, 0.5))
    length = np.cbrt(barycentric_gradients(points, cells)[1])
    height = points[cells][:, :, 2].mean(axis=1)
    assert np.median(length[height < -0.8]) < 0.65 * np.median(length[height > 0.3])
    found = measure(points, cells)
    assert found.smallest_angle > 12.0
    assert found.euler == (2,)


def test_same_input_same_mesh_bit_for_bit():
    first, second = (stuff(sphere(1.5), LOWER, UPPER, 0.4, graded) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1].tobytes() == second[1].tobytes()


@settings(max_examples=12, deadline=None)
@given(
    st.tuples(*[st.floats(0.7, 1.7)] * 3), st.tuples(*[st.floats(-0.2, 0.2)] * 3), st.sampled_from([0.35, 0.45, 0.6])
)
def test_any_ellipsoid_is_meshed_well(axes, centre, edge):
    half = np.array(axes)

    def level_set(points):
        x = (points - centre) / half
        size = np.linalg.norm(x, axis=1)
        return (size - 1.0) * size / np.maximum(np.linalg.norm(x / half, axis=1), 1e-9)

    points, cells = stuff(level_set, LOWER, UPPER, edge)
    found = measure(points, cells)
    assert found.euler == (2,)
    assert found.smallest_angle >= 10.0
    exact = 4 / 3 * np.pi * half.prod()
    assert (1 - 0.5 * (edge / half.min()) ** 2) * exact < found.volume < 1.005 * exact


def test_a_floor_is_flat_and_exact():
    def cylinder(points):
        return np.maximum(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2] - 1.2)

    points, cells = stuff(cylinder, np.array([-1.0, -1, -0.5]), np.array([1.0, 1, 1.2]), 0.25, floor=True)
    facets = exterior_facets(cells)
    flat = (points[facets][:, :, 2] == -0.5).all(axis=1)
    assert facet_measures(points, facets[flat]).sum() == pytest.approx(np.pi, rel=0.02)
    assert points[:, 2].min() == -0.5
    assert measure(points, cells).volume == pytest.approx(1.7 * np.pi, rel=0.02)


@pytest.mark.parametrize(
    ("level_set", "edge", "message"),
    [
        (sphere(1.0), 0.0, "mesh edge: got 0.0 cm"),
        (sphere(1.0), float("nan"), "mesh edge: got nan cm"),
        (lambda x: np.ones(len(x)), 0.5, "no lattice point lies inside"),
        (lambda x: np.full(len(x), np.nan), 0.5, "one finite number a point"),
        (sphere(9.0), 0.5, "reaches the side of the box"),
    ],
)
def test_what_cannot_be_meshed_is_said(level_set, edge, message):
    with pytest.raises(MeshError, match=message):
        stuff(level_set, LOWER, UPPER, edge, attempts=2)


def test_refused_meshes_are_tried_again_and_the_reasons_named():
    calls = []

    def accept(found):
        calls.append(found)
        return "" if len(calls) == 3 else "too plain"

    stuff(sphere(1.0), LOWER, UPPER, 0.5, accept=accept)
    assert len(calls) == 3
    assert len({found.volume for found in calls}) == 3
    with pytest.raises(MeshError, match=r"failed for 3 shifts .*too ugly.*smaller than 0.5 cm"):
        stuff(sphere(1.0), LOWER, UPPER, 0.5, attempts=3, accept=lambda found: "too ugly")
    with pytest.raises(MeshError, match="smallest dihedral angle"):
        stuff(sphere(1.0), LOWER, UPPER, 0.5, attempts=1, smallest_angle=60.0)


# --- polishing, sampled level sets


def test_polishing_betters_the_worst_cell_and_keeps_the_surface():
    level_set = sphere(1.5)
    points, cells = stuff(level_set, LOWER, UPPER, 0.5)
    rng = np.random.default_rng(1)
    inside = np.setdiff1d(np.arange(len(points)), np.unique(exterior_facets(cells)))
    rough = points.copy()
    for vertex in rng.choice(inside, 12, replace=False):
        trial = rough.copy()
        trial[vertex] += rng.normal(scale=0.15, size=3)
        if barycentric_gradients(trial, cells)[1].min() > 0:
            rough = trial
    before = dihedral_angles(rough, cells).min()
    fixed = np.zeros(len(points), dtype=bool)
    better = polish(level_set, rough, cells, fixed, goal=25.0)
    assert before < 15.0
    assert dihedral_angles(better, cells).min() > before + 5.0
    assert np.abs(level_set(better[np.unique(exterior_facets(cells))])).max() < 1e-6
    fixed[:] = True
    assert polish(level_set, rough, cells, fixed, goal=25.0).tobytes() == rough.tobytes()


def test_smoothed_mask_gives_the_distance_to_a_plane_and_a_sphere():
    mask = np.zeros((30, 8, 8), dtype=bool)
    mask[:14] = True
    distance = smooth_distance(mask, 2.0)
    np.testing.assert_allclose(distance[9:19, 4, 4], np.arange(9, 19) - 13.5, atol=5e-4)
    assert distance[0, 4, 4] < -12
    grid = np.stack(np.meshgrid(*[np.arange(40.0)] * 3, indexing="ij"), axis=-1)
    radius = np.linalg.norm(grid - 19.6, axis=-1)
    mask, near = radius < 14.0, np.abs(radius - 14.0) < 1.5
    error = (smooth_distance(mask, 1.5) - (radius - 14.0))[near]
    between_samples = (distance_transform_edt(~mask) - distance_transform_edt(mask) - (radius - 14.0))[near]
    # The blur moves a sphere's outline inwards by σ²/r.
    assert error.mean() == pytest.approx(1.5**2 / 14.0, rel=0.15)
    assert error.std() < 0.05
    assert error.std() < 0.2 * between_samples.std()


def test_sampled_level_set_interpolates_and_moves():
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"), axis=-1)
    level_set = SampledLevelSet(grid @ [1.0, 2.0, 3.0], np.array([1.0, 1.0, 1.0]), 2.0)
    points = np.array([[2.0, 3.5, 8.9], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(level_set(points), (points - 1.0) / 2.0 @ [1.0, 2.0, 3.0])
    moved = level_set.placed(0.1, np.array([5.0, 0.0, -1.0]))
    np.testing.assert_allclose(moved(0.1 * points + [5.0, 0.0, -1.0]), 0.1 * level_set(points))
