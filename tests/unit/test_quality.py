"""Angles, manifold checks and enclosed volumes against shapes whose figures are known."""

from itertools import product

import numpy as np
import pytest

from dacore.core.mesh import Mesh, exterior_facets
from dacore.domains.box import Box
from dacore.errors import MeshError
from dacore.geometry.quality import (
    boundary_components,
    check_manifold,
    check_quality,
    dihedral_angles,
    enclosed_volume,
    facet_measures,
    measure,
    on_cavity,
    signed_angles,
)

REGULAR = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])


def cubes(shape, keep):
    """Points and cells of those unit cubes of a grid that `keep` (i, j, k) holds."""
    mesh = Box((0.0, 0.0, 0.0), tuple(map(float, shape)), shape).mesh()
    centre = np.floor(mesh.points[mesh.cells].mean(axis=1)).astype(int)
    cells = mesh.cells[[bool(keep(*index)) for index in centre]]
    used, cells_used = np.unique(cells, return_inverse=True)
    return mesh.points[used], cells_used.reshape(cells.shape)


def test_angles_of_a_regular_tetrahedron_and_triangle():
    cells = np.array([[0, 1, 2, 3]])
    np.testing.assert_allclose(dihedral_angles(REGULAR, cells), np.degrees(np.arccos(1 / 3)), rtol=1e-12)
    triangle = np.array([[0.0, 0], [1, 0], [0.5, np.sqrt(3) / 2]])
    np.testing.assert_allclose(dihedral_angles(triangle, np.array([[0, 1, 2]])), 60.0, rtol=1e-12)


def test_angles_of_a_right_corner_and_of_an_inverted_cell():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    angles = np.sort(signed_angles(corner[None])[0])
    np.testing.assert_allclose(angles, [*[np.degrees(np.arctan(np.sqrt(2)))] * 3, 90, 90, 90], rtol=1e-12)
    np.testing.assert_allclose(
        signed_angles(corner[None, [0, 1, 3, 2]]), -signed_angles(corner[None])[:, [0, 2, 1, 4, 3, 5]]
    )


def test_triangle_angles_sum_to_180():
    corners = np.random.default_rng(3).normal(size=(50, 3, 2))
    np.testing.assert_allclose(np.abs(signed_angles(corners)).sum(axis=1), 180.0, rtol=1e-10)


@pytest.mark.parametrize(
    ("shape", "hole", "euler"),
    [
        ((1, 1, 1), lambda i, j, k: True, (2,)),
        ((3, 3, 1), lambda i, j, k: (i, j) != (1, 1), (0,)),
        ((3, 3, 3), lambda i, j, k: (i, j, k) != (1, 1, 1), (2, 2)),
        ((5, 3, 1), lambda i, j, k: (i, j) not in ((1, 1), (3, 1)), (-2,)),
        ((3, 1, 1), lambda i, j, k: i != 1, (2, 2)),
    ],
)
def test_euler_characteristic(shape, hole, euler):
    points, cells = cubes(shape, hole)
    assert check_manifold(exterior_facets(cells)) == euler
    found = measure(points, cells)
    assert found.euler == euler
    assert found.volume == pytest.approx(sum(hole(*index) for index in product(*map(range, shape))))


def test_cavity_encloses_minus_its_volume():
    points, cells = cubes((3, 4, 3), lambda i, j, k: not (i == k == 1 and j in (1, 2)))
    facets = exterior_facets(cells)
    cavity = on_cavity(points, facets)
    assert enclosed_volume(points, facets[cavity]) == pytest.approx(-2.0)
    assert enclosed_volume(points, facets[~cavity]) == pytest.approx(36.0)
    assert facet_measures(points, facets[cavity]).sum() == pytest.approx(10.0)
    assert set(boundary_components(facets)[cavity]) == {1}


def test_a_shared_edge_or_vertex_alone_is_refused():
    points, cells = cubes((2, 2, 1), lambda i, j, k: i == j)
    with pytest.raises(MeshError, match="edges do not join two triangles"):
        measure(points, cells)
    points, cells = cubes((2, 2, 2), lambda i, j, k: i == j == k)
    with pytest.raises(MeshError, match="1 vertices join separate parts"):
        measure(points, cells)


def test_an_outline_that_touches_itself_is_refused():
    cells = np.array([[0, 1, 2], [2, 3, 4]])
    with pytest.raises(MeshError, match="1 points do not join two segments"):
        check_manifold(exterior_facets(cells))
    assert check_manifold(np.array([[0, 1], [1, 2], [2, 0], [4, 5], [5, 6], [6, 4]])) == (0, 0)


def test_a_missing_facet_is_an_open_surface():
    facets = exterior_facets(np.array([[0, 1, 2, 3]]))
    assert check_manifold(facets) == (2,)
    with pytest.raises(MeshError, match="3 edges"):
        check_manifold(facets[1:])


def test_overlapping_and_inverted_cells_are_refused():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(MeshError, match="1 of 1 cells are inverted"):
        measure(corner, np.array([[0, 2, 1, 3]]))
    doubled = np.concatenate([corner, corner + 0.1])
    # Two overlapping bodies pass every local test; overlap across a shared face does not.
    assert measure(doubled, np.array([[0, 1, 2, 3], [4, 5, 6, 7]])).euler == (2, 2)
    folded = np.concatenate([corner, [[0.2, 0.2, 0.5]]])
    with pytest.raises(MeshError, match="inverted"):
        measure(folded, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]))


def test_check_quality_names_what_is_off():
    mesh = Box(divisions=(2, 2, 2)).mesh()
    assert check_quality(mesh, 44.0, (0.99, 1.01), (2,)).smallest_angle == pytest.approx(45.0)
    with pytest.raises(MeshError, match=r"smallest angle 45.00 degrees, expected at least 46"):
        check_quality(mesh, 46.0)
    with pytest.raises(MeshError, match=r"volume 1 cm\^3, expected 2 to 3"):
        check_quality(mesh, 10.0, (2.0, 3.0))
    with pytest.raises(MeshError, match=r"Euler characteristic \(2,\), expected \(0,\)"):
        check_quality(mesh, 10.0, euler=(0,))


def test_two_dimensions():
    mesh = Box((0.0, 0.0), (2.0, 1.0), (4, 2)).mesh()
    found = check_quality(mesh, 44.0, (1.999, 2.001), (0,))
    assert found.largest_angle == pytest.approx(90.0)
    assert facet_measures(mesh.points, mesh.facets).sum() == pytest.approx(6.0)
    assert isinstance(mesh, Mesh)
