"""How good a simplicial mesh is, and whether its boundary is a closed manifold."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.simplex import barycentric_gradients
from dacore.errors import MeshError


@dataclass(frozen=True)
class Quality:
    """Figures of a mesh that passed its checks.

    Parameters
    ----------
    smallest_angle, largest_angle : float [degrees]
        Dihedral angles of tetrahedra, angles of triangles.
    volume : float [cm^d]
        Sum of the cells.
    euler : tuple of int
        Euler characteristic of each boundary component, largest component first: 2 for a sphere,
        0 for a torus or a closed curve.
    """

    smallest_angle: float
    largest_angle: float
    volume: float
    euler: tuple[int, ...]


def dihedral_angles(points: Array, cells: IntArray) -> Array:
    """Angles between the facets of each simplex.

    Parameters
    ----------
    points : (n, d) array
    cells : (c, d + 1) int array
        Tetrahedra (six dihedral angles each) or triangles (three angles each).

    Returns
    -------
    (c, d (d + 1) / 2) array [degrees]
    """
    return np.abs(signed_angles(points[cells]))


def signed_angles(corners: Array) -> Array:
    """Angles between the facets of simplices given by their corners (c, d + 1, d).

    Returns
    -------
    (c, d (d + 1) / 2) array [degrees]
        Negative for inverted and zero for flat simplices.
    """
    count, n = corners.shape[:2]
    flat, cells = corners.reshape(-1, corners.shape[2]), np.arange(count * n).reshape(count, n)
    normals, volumes = barycentric_gradients(flat, cells)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.where(length > 0.0, length, 1.0)
    first, second = np.triu_indices(n, k=1)
    cosine = -np.einsum("cki,cki->ck", normals[:, first], normals[:, second])
    return np.asarray(np.sign(volumes)[:, None] * np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def boundary_components(facets: IntArray) -> IntArray:
    """Label (f,) of the connected component of each boundary facet, most facets first.

    Facets are connected when they share a vertex.
    """
    vertices, local = np.unique(facets, return_inverse=True)
    local = local.reshape(facets.shape)
    rows = np.repeat(np.arange(len(facets)), facets.shape[1])
    incidence = coo_array((np.ones(rows.size), (rows, local.ravel())), shape=(len(facets), len(vertices))).tocsr()
    count, label = connected_components(csr_array(incidence @ incidence.T), directed=False)
    order = np.argsort(-np.bincount(label, minlength=count), kind="stable")
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    return np.asarray(rank[label])


def facet_measures(points: Array, facets: IntArray) -> Array:
    """Length or area (f,) [cm^(d-1)] of boundary facets."""
    edges = points[facets[:, 1:]] - points[facets[:, :1]]
    if points.shape[1] == 2:
        return np.asarray(np.linalg.norm(edges[:, 0], axis=1))
    return np.asarray(0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))


def enclosed_volume(points: Array, facets: IntArray) -> float:
    """Volume [cm^d] enclosed by outward oriented facets, by the divergence theorem.

    The facets of a cavity alone point into the cavity and give minus its volume.
    """
    centre = points.mean(axis=0)
    return float(np.linalg.det(points[facets] - centre).sum()) / {2: 2.0, 3: 6.0}[points.shape[1]]


def on_cavity(points: Array, facets: IntArray) -> BoolArray:
    """Whether each outward oriented boundary facet (f,) lies on a cavity: a component that encloses less than 0."""
    label = boundary_components(facets)
    count = int(label.max()) + 1
    return np.array([enclosed_volume(points, facets[label == k]) < 0.0 for k in range(count)])[label]


def check_manifold(facets: IntArray) -> tuple[int, ...]:
    """Check that boundary facets form closed manifolds.

    Parameters
    ----------
    facets : (f, d) int array

    Returns
    -------
    tuple of int
        Euler characteristic of each component, most facets first.

    Raises
    ------
    MeshError
        If a ridge (edge of triangles, end of segments) does not belong to two facets, or the
        facets round a vertex are more than one fan.
    """
    dim = facets.shape[1]
    if dim == 2:
        degree = np.bincount(facets.ravel())
        bad = int(((degree != 2) & (degree != 0)).sum())
        if bad:
            raise MeshError(f"boundary: {bad} points do not join two segments; the outline touches itself or is open")
        return tuple(0 for _ in range(int(boundary_components(facets).max()) + 1))
    sides = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    edges, where, counts = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    bad = int((counts != 2).sum())
    if bad:
        raise MeshError(f"boundary: {bad} edges do not join two triangles; the surface touches itself or is open")
    # Two facets that share an edge are linked at both ends of it: as many groups of
    # (facet, vertex) pairs as vertices means one fan round each.
    facet = np.tile(np.arange(len(facets)), 3)
    order = np.argsort(where.reshape(-1), kind="stable")
    pairs = facet[order].reshape(-1, 2)
    links = [np.stack([_corners(facets, pairs[:, side], edges[:, end]) for side in (0, 1)], axis=1) for end in (0, 1)]
    link = np.concatenate(links)
    graph = coo_array((np.ones(len(link)), (link[:, 0], link[:, 1])), shape=(facets.size, facets.size))
    fans = connected_components(graph, directed=False)[0]
    vertices = np.unique(facets)
    if fans != len(vertices):
        raise MeshError(f"boundary: {fans - len(vertices)} vertices join separate parts of the surface")
    label = boundary_components(facets)
    euler = []
    for component in range(int(label.max()) + 1):
        part = facets[label == component]
        euler.append(len(np.unique(part)) - 3 * len(part) // 2 + len(part))
    return tuple(euler)


def _corners(facets: IntArray, facet: IntArray, vertex: IntArray) -> IntArray:
    """Number 3 f + k (n,) of the corner at which facet f has a vertex."""
    return np.asarray(3 * facet + np.argmax(facets[facet] == vertex[:, None], axis=1))


def measure(points: Array, cells: IntArray) -> Quality:
    """Measure a mesh and check its boundary.

    Raises
    ------
    MeshError
        If a cell is inverted, the boundary is not a manifold, or the volume it encloses is not the
        sum of the cells (overlapping cells).
    """
    volumes = barycentric_gradients(points, cells)[1]
    if volumes.min() <= 0.0:
        raise MeshError(f"mesh: {int((volumes <= 0).sum())} of {len(volumes)} cells are inverted or flat")
    facets = exterior_facets(cells)
    euler = check_manifold(facets)
    total = float(volumes.sum())
    enclosed = enclosed_volume(points, facets)
    if abs(enclosed - total) > 1e-9 * total:
        raise MeshError(f"mesh: its surface encloses {enclosed:.6g}, its cells sum to {total:.6g}; cells overlap")
    angles = dihedral_angles(points, cells)
    return Quality(float(angles.min()), float(angles.max()), total, euler)


def check_quality(
    mesh: Mesh,
    smallest_angle: float = 10.0,
    volume: tuple[float, float] | None = None,
    euler: tuple[int, ...] | None = None,
) -> Quality:
    """Measure a mesh and raise if it is worse than asked for.

    Parameters
    ----------
    mesh : Mesh
    smallest_angle : float [degrees]
        No dihedral angle (triangle: angle) may be smaller.
    volume : tuple of float [cm^d], optional
        Lowest and highest volume allowed.
    euler : tuple of int, optional
        Euler characteristics of the boundary's components, largest first.

    Returns
    -------
    Quality

    Raises
    ------
    MeshError
        With one line that says which figure is off.
    """
    found = measure(mesh.points, mesh.cells)
    if found.smallest_angle < smallest_angle:
        raise MeshError(
            f"mesh: smallest angle {found.smallest_angle:.2f} degrees, expected at least {smallest_angle:g}"
        )
    if volume is not None and not volume[0] <= found.volume <= volume[1]:
        raise MeshError(f"mesh: volume {found.volume:.6g} cm^{mesh.dim}, expected {volume[0]:g} to {volume[1]:g}")
    if euler is not None and found.euler != euler:
        raise MeshError(f"mesh: boundary components of Euler characteristic {found.euler}, expected {euler}")
    return found
