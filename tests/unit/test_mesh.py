import numpy as np
import pytest

from dacore.core.fields import Field, Layout
from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient, local_edges, n_local
from dacore.errors import CapabilityError, MeshError, ShapeError
from tests.meshes import shuffled_box

# Two triangles on the unit square.
SQUARE = {
    "points": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
    "cells": [[0, 1, 2], [0, 2, 3]],
    "facets": [[0, 1], [1, 2], [2, 3], [3, 0]],
    "facet_tags": [1, 2, 2, 2],
    "roles": {"bottom": 1, "rest": 2},
}


def square(**change):
    return Mesh(**{**SQUARE, **change})


def test_a_valid_mesh_is_made_and_cannot_be_changed():
    mesh = square()
    assert mesh.dim == 2
    np.testing.assert_allclose(mesh.volumes, 0.5)
    for name in ("points", "cells", "facets", "facet_tags", "volumes", "edges", "cell_edges", "exterior_facets"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(mesh, name)[0] = 0
    with pytest.raises(AttributeError):
        mesh.points = np.zeros((4, 2))


def test_a_mesh_copies_what_it_is_given():
    points = np.array(SQUARE["points"])
    mesh = square(points=points)
    points[0] = 7.0
    assert mesh.points[0, 0] == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": [*SQUARE["points"], [2.0, 2.0]]}, "1 belong to no cell .first: 4.; remove the orphan"),
        ({"points": [[0, 0, 0, 0]] * 4}, "got 4 coordinates a point, expected 2 or 3"),
        ({"points": [0.0, 1.0]}, "mesh points: got shape"),
        ({"points": [[0, 0], [1, 0], [1, np.inf], [0, 1]]}, "NaN or infinite"),
        ({"cells": np.empty((0, 3), dtype=int)}, "mesh cells: got none"),
        ({"cells": [[0, 2, 1], [0, 2, 3]]}, "1 of 2 are inverted or flat .first: 0, volume -0.5.*swap two vertices"),
        ({"points": [[0, 0], [1, 0], [2, 0], [0, 1]]}, "1 of 2 are inverted or flat .first: 0, volume 0"),
        ({"cells": [[0, 1, 2], [0, 2, 3], [1, 2, 0]]}, "1 repeat an earlier one .first: 2.; remove the duplicates"),
        ({"cells": [[0, 1, 1], [0, 2, 3]]}, r"1 of 2 name the same point twice \(first: 0\)"),
        ({"cells": [[0, 1, 2], [0, 2, 4]]}, "indices run from 0 to 4, expected 0 to 3"),
        ({"cells": [[0.0, 1.0, 2.0], [0.0, 2.0, 3.0]]}, "expected integers"),
        ({"cells": [[0, 1, 2, 3]]}, "got 4 corners a cell and points of 2 coordinates, .*cut quadrilaterals"),
        ({"cells": [[0, 1]]}, "got 2 corners a cell and points of 2 coordinates, expected 3 corners"),
        ({"cells": [0, 1, 2]}, r"mesh cells: got shape \(3,\), expected \(any, 3\)"),
        (
            {"facets": [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]], "facet_tags": [1, 2, 2, 2, 2]},
            "1 tagged facets are not",
        ),
        ({"facets": [[0, 1], [1, 2], [2, 3]], "facet_tags": [1, 2, 2]}, "1 of 4 boundary facets have no tag"),
        ({"facets": [[0, 1], [1, 2], [2, 3], [3, 0], [1, 0]], "facet_tags": [1, 2, 2, 2, 2]}, "listed twice"),
        ({"facets": [[0, 1, 2]] * 4}, "mesh facets: got shape"),
        ({"facet_tags": [1, 2, 2]}, r"mesh facet tags: got shape \(3,\), expected \(4\)"),
        ({"facet_tags": [1, 2, 2, 2.5]}, "mesh facet tags: got numbers of type float64"),
        ({"facet_tags": [1, 2, 2, 9]}, r"\[9\] have no role"),
        ({"roles": {"bottom": 1, "rest": 2, "neck": 3}}, "role 'neck': no boundary facet has its tag 3"),
        ({"roles": {}}, r"\[1, 2\] have no role"),
    ],
)
def test_what_is_no_domain_is_refused(change, message):
    with pytest.raises(MeshError, match=message):
        square(**change)


def test_coinciding_points_are_refused():
    """Two triangles that look joined but share no point: a crack through the domain."""
    points = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]
    cells = [[0, 1, 2], [3, 4, 5]]
    facets = exterior_facets(np.array(cells))
    with pytest.raises(MeshError, match=r"2 coincide with another .first pair: 0 and 3.; merge"):
        Mesh(points, cells, facets, np.ones(len(facets), dtype=int), {"all": 1})


def test_three_cells_on_one_facet_are_refused():
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 2], [0, 0, 3]]
    cells = [[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]]
    with pytest.raises(MeshError, match="1 facets belong to more than two cells"):
        Mesh(points, cells, [[0, 1, 3]], [1], {"all": 1})


def test_a_strongly_graded_mesh_is_no_flat_one():
    """Volumes 1e-15 of the largest are fine as long as each cell has a shape."""
    sizes = 10.0 ** np.arange(-8, 1)
    points = np.concatenate(
        [[[0.0, 0.0]], np.stack([sizes, np.zeros(9)], axis=1), np.stack([np.zeros(9), sizes], axis=1)]
    )
    cells = [[0, 1, 10]]
    for k in range(1, 9):
        cells += [[k, k + 1, k + 10], [k, k + 10, k + 9]]
    facets = exterior_facets(np.array(cells))
    mesh = Mesh(points, cells, facets, np.ones(len(facets), dtype=int), {"all": 1})
    assert mesh.volumes.min() < 1e-14 * mesh.volumes.max()


def test_numbering_that_would_overflow_is_refused():
    from dacore.core.mesh import _row_codes

    with pytest.raises(MeshError, match="more than facet numbering can hold"):
        _row_codes(np.zeros((1, 3), dtype=np.int64), 2**21)
    largest = 2**21 - 1
    row = np.array([[largest - 1, largest - 2, largest - 3]])
    assert _row_codes(row, largest)[0] == ((largest - 3) * largest + largest - 2) * largest + largest - 1


@pytest.mark.parametrize("dim", [2, 3])
def test_exterior_facets_point_outwards_and_close_the_domain(dim):
    mesh = shuffled_box(dim, n=3, bumpy=True)
    vertices = mesh.points[mesh.exterior_facets]
    sides = vertices[:, 1:] - vertices[:, :1]
    if dim == 2:
        normals = np.stack([sides[:, 0, 1], -sides[:, 0, 0]], axis=1)
    else:
        normals = np.cross(sides[:, 0], sides[:, 1]) / 2
    np.testing.assert_allclose(normals.sum(axis=0), 0.0, atol=1e-14)
    # The divergence theorem for x gives d times the volume, with this sign only.
    flux = np.einsum("fd,fd->", normals, vertices.mean(axis=1))
    assert flux == pytest.approx(dim * mesh.volumes.sum(), rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_edges_and_nodes_are_in_the_canonical_order(dim):
    mesh = shuffled_box(dim, n=2, seed=3)
    expected = sorted({tuple(sorted((c[i], c[j]))) for c in mesh.cells.tolist() for i, j in local_edges(dim)})
    np.testing.assert_array_equal(mesh.edges, expected)
    nodes, cell_nodes = mesh.nodes(2), mesh.cell_nodes(2)
    assert cell_nodes.shape == (len(mesh.cells), n_local(dim, 2))
    np.testing.assert_array_equal(nodes[: len(mesh.points)], mesh.points)
    np.testing.assert_array_equal(cell_nodes[:, : dim + 1], mesh.cells)
    for k, (i, j) in enumerate(local_edges(dim)):
        middle = (mesh.points[mesh.cells[:, i]] + mesh.points[mesh.cells[:, j]]) / 2
        np.testing.assert_allclose(nodes[cell_nodes[:, dim + 1 + k]], middle, atol=1e-15)
    assert mesh.nodes(1) is mesh.points
    assert mesh.cell_nodes(1) is mesh.cells


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_boundary_nodes_are_those_on_the_closed_facets(dim, order):
    mesh = shuffled_box(dim, n=3, seed=4)
    nodes = mesh.nodes(order)
    np.testing.assert_array_equal(mesh.boundary_nodes("left", order), np.flatnonzero(nodes[:, 0] == 0.0))
    on_side = ((nodes[:, 1:] == 0.0) | (nodes[:, 1:] == 1.0)).any(axis=1)
    np.testing.assert_array_equal(mesh.boundary_nodes("side", order), np.flatnonzero(on_side))


def test_an_edge_inside_between_two_boundary_nodes_is_no_boundary_node():
    assert len(square().boundary_nodes("rest", 2)) == 4 + 3


def test_roles_find_their_facets():
    mesh = square()
    np.testing.assert_array_equal(mesh.boundary_facets("bottom"), [[0, 1]])
    assert len(mesh.boundary_facets("rest")) == 3
    with pytest.raises(MeshError, match="role 'neck': not on this mesh, which has bottom, rest"):
        mesh.boundary_facets("neck")


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_lagrange_polynomials(dim, order):
    rng = np.random.default_rng(0)
    corners = np.eye(dim + 1)
    middles = [(corners[i] + corners[j]) / 2 for i, j in local_edges(dim)]
    nodes = corners if order == 1 else np.concatenate([corners, middles])
    assert len(nodes) == n_local(dim, order)
    np.testing.assert_allclose(lagrange(order, nodes), np.eye(len(nodes)), atol=1e-15)
    b = rng.dirichlet(np.ones(dim + 1), size=(4, 5))
    assert lagrange(order, b).shape == (4, 5, len(nodes))
    np.testing.assert_allclose(lagrange(order, b).sum(axis=-1), 1.0, atol=1e-14)
    gradient = lagrange_gradient(order, b)
    for k in range(dim + 1):
        step = 1e-6 * corners[k]
        difference = (lagrange(order, b + step) - lagrange(order, b - step)) / 2e-6
        np.testing.assert_allclose(gradient[..., k], difference, atol=1e-8)


def test_orders_beyond_two_are_refused():
    for function in (lagrange, lagrange_gradient):
        with pytest.raises(ShapeError, match="element order: got 3"):
            function(3, np.eye(3))


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_barycentric_gradients(dim):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(40, dim))
    cells = np.stack([rng.permutation(40)[: dim + 1] for _ in range(60)])
    gradients, volumes = barycentric_gradients(points, cells)
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    np.testing.assert_allclose(volumes, np.linalg.det(edges) / {1: 1, 2: 2, 3: 6}[dim], atol=1e-13)
    np.testing.assert_allclose(gradients[:, 1:], np.swapaxes(np.linalg.inv(edges), 1, 2), rtol=1e-8)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-9)
    assert (volumes < 0).any()
    assert (volumes > 0).any()


def test_flat_cells_have_no_volume_and_finite_gradients():
    gradients, volumes = barycentric_gradients(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), np.array([[0, 1, 2]]))
    assert volumes[0] == 0.0
    assert np.isfinite(gradients).all()


def test_layout_orders_fields_components_nodes():
    layout = Layout([Field("u", 3, 2), Field("p", 1)], {"u": 10, "p": 4})
    assert layout.n_dofs == 34
    assert layout.block("u") == slice(0, 30)
    assert layout.block("p") == slice(30, 34)
    assert layout.component("u", 1) == slice(10, 20)
    assert layout.component("p", 0) == slice(30, 34)
    assert layout.field("u").order == 2


def test_layout_errors():
    layout = Layout([Field("u", 3)], {"u": 10})
    with pytest.raises(CapabilityError, match="field 'p': this state has the fields u"):
        layout.block("p")
    with pytest.raises(ShapeError, match="component of u: got 3, expected 0 to 2"):
        layout.component("u", 3)
    with pytest.raises(ShapeError, match="no name twice"):
        Layout([Field("u", 3), Field("u", 1)], {"u": 10})
    with pytest.raises(ShapeError, match="at least one"):
        Layout([], {})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("a b", 1), "identifier"), (("u", 0), "got 0 components"), (("u", 1, 3), "got element order 3")],
)
def test_field_errors(arguments, message):
    with pytest.raises(ShapeError, match=message):
        Field(*arguments)
