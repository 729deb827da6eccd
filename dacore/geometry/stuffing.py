"""Tetrahedra inside a level set: isosurface stuffing.

Labelle & Shewchuk, "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles",
ACM Trans. Graph. 26(3), 2007. A graded body-centred cubic lattice is laid over the domain; lattice
points close to the surface are moved onto it; the tetrahedra that still cross it are cut. The
paper's angle bounds hold for a uniform lattice at the surface; here the result is measured.
"""

from collections.abc import Callable

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.mesh import exterior_facets
from dacore.errors import MeshError
from dacore.geometry.lattice import LevelSet, lattice_tetrahedra, octree, oriented
from dacore.geometry.polish import polish
from dacore.geometry.quality import Quality, check_manifold, measure
from dacore.geometry.stencils import cut_cells

# Fractions of an edge within which a cut point pulls a lattice point onto the surface. The paper
# has 0.24999 and 0.41189 for long and short edges of a uniform lattice, 0.21509 and 0.35900 for a
# graded one.
_WARP_LONG, _WARP_SHORT = 0.24999, 0.41189
_ROOT_STEPS = 6


def stuff(
    level_set: LevelSet,
    lower: Array,
    upper: Array,
    edge: float,
    sizing: LevelSet | None = None,
    *,
    floor: bool = False,
    smallest_angle: float = 10.0,
    attempts: int = 24,
    accept: Callable[[Quality], str] | None = None,
) -> tuple[Array, IntArray]:
    """Fill the region where a level set is negative with tetrahedra.

    Parameters
    ----------
    level_set : callable
        Points (n, 3) [cm] -> (n,) [cm]: negative inside, positive outside, close to the signed
        distance. It must be positive on the box's sides, but for a floor.
    lower, upper : (3,) array [cm]
        A box that holds the region.
    edge : float [cm]
        Edge of the coarse lattice cubes.
    sizing : callable, optional
        Points (n, 3) -> (n,) [cm]: cubes larger than this at their centre are split in eight.
    floor : bool
        Whether the region is cut off at the lowest z of the box: a lattice plane lies there.
    smallest_angle : float [degrees]
        Dihedral angle below which a mesh is refused.
    attempts : int
        How many shifts of the lattice to try before giving up.
    accept : callable, optional
        Says what is wrong with a mesh of this quality, or nothing ("").

    Returns
    -------
    points : (n, 3) array [cm]
    cells : (c, 4) int array
        Positively oriented; the boundary is a manifold.

    Raises
    ------
    MeshError
        If no shift of the lattice gives a mesh that passes the checks.
    """
    if not (np.isfinite(edge) and edge > 0.0):
        raise MeshError(f"mesh edge: got {edge} cm, expected a positive length")
    shape = tuple(int(n) for n in np.ceil((np.asarray(upper) - lower) / edge).astype(int) + 3)
    offset = np.array([1.0, 1.0, 0.0 if floor else 1.0])

    def checked(points: Array) -> Array:
        value = np.asarray(level_set(points), dtype=np.float64)
        if value.shape != (len(points),) or not np.isfinite(value).all():
            raise MeshError("the level set must give one finite number a point, got another shape, NaN or infinity")
        return value

    reasons: dict[str, None] = {}
    for attempt in range(attempts):
        origin = np.asarray(lower, dtype=np.float64) - edge * offset * (1.0 + _shift(attempt))
        tree = octree(origin, edge, (shape[0], shape[1], shape[2]), sizing)
        try:
            points, cells = _fill(checked, *lattice_tetrahedra(tree, checked), origin[2])
            check_manifold(exterior_facets(cells))
            points = polish(checked, points, cells, floor & (points[:, 2] == origin[2]))
            found = measure(points, cells)
        except MeshError as error:
            reasons[str(error)] = None
            continue
        if found.smallest_angle < smallest_angle:
            reasons[f"smallest dihedral angle {found.smallest_angle:.1f} degrees"] = None
            continue
        complaint = accept(found) if accept else ""
        if not complaint:
            return points, cells
        reasons[complaint] = None
    raise MeshError(
        f"meshing failed for {attempts} shifts of the lattice ({'; '.join(list(reasons)[:3])}); "
        f"choose an edge smaller than {edge:g} cm"
    )


def _shift(attempt: int) -> Array:
    """Shift (3,) of an attempt in cubes, in [0, 1): multiples of the powers of the 3-D golden ratio (R3 sequence)."""
    ratio = 1.2207440846057596
    return np.asarray((attempt * ratio ** -np.arange(1.0, 4.0)) % 1.0)


def _fill(level_set: LevelSet, points: Array, cells: IntArray, bottom: float) -> tuple[Array, IntArray]:
    """Warp, cut and keep what lies inside; `bottom` is the lowest z of the lattice."""
    value = level_set(points).copy()
    value[np.abs(value) < 1e-9 * np.ptp(points, axis=0).max()] = 0.0
    cells = cells[(value[cells] < 0.0).any(axis=1)]
    if len(cells) == 0:
        raise MeshError("no lattice point lies inside the level set")
    crossing = cells[(value[cells] > 0.0).any(axis=1)]
    edges = _crossing_edges(crossing, value)
    cuts = _roots(level_set, points, value, edges)
    points, value, gone = _warp(points, value, edges, cuts, points[:, 2] == bottom)
    nodes, pieces = cut_cells(points, value, cells, edges[~gone], cuts[~gone])
    outer = np.unique(exterior_facets(pieces))
    lattice = outer[outer < len(points)]
    if ((value[lattice] < 0.0) & (points[lattice, 2] != bottom)).any():
        raise MeshError("the level set reaches the side of the box, or is far from a distance")
    used, compact = np.unique(pieces, return_inverse=True)
    return nodes[used], oriented(nodes[used], compact.reshape(pieces.shape).astype(np.int64))


def _crossing_edges(cells: IntArray, value: Array) -> IntArray:
    """Edges (e, 2), inner vertex first, whose ends lie on different sides."""
    first, second = np.triu_indices(4, k=1)
    pairs = np.stack([cells[:, first].ravel(), cells[:, second].ravel()], axis=1)
    pairs = pairs[value[pairs[:, 0]] * value[pairs[:, 1]] < 0.0]
    swap = value[pairs[:, 0]] > 0.0
    pairs[swap] = pairs[swap, ::-1]
    return np.asarray(np.unique(pairs, axis=0))


def _roots(level_set: LevelSet, points: Array, value: Array, edges: IntArray) -> Array:
    """Where the level set vanishes on each edge, as a point (e, 3): the Illinois method."""
    start, along = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    f_low, f_high = value[edges[:, 0]].copy(), value[edges[:, 1]].copy()
    side = np.zeros(len(edges), dtype=np.int64)
    t = -f_low / (f_high - f_low)
    for _ in range(_ROOT_STEPS):
        f = level_set(start + t[:, None] * along)
        inner = f < 0.0
        # An end that stays twice running counts half, or the secants creep up from one side.
        f_high = np.where(inner, np.where(side < 0, 0.5 * f_high, f_high), f)
        f_low = np.where(inner, f, np.where(side > 0, 0.5 * f_low, f_low))
        low, high, side = np.where(inner, t, low), np.where(inner, high, t), np.where(inner, -1, 1)
        t = low - f_low * (high - low) / np.maximum(f_high - f_low, np.finfo(float).tiny)
    return np.asarray(start + np.clip(t, low, high)[:, None] * along)


def _warp(
    points: Array, value: Array, edges: IntArray, cuts: Array, floor: BoolArray
) -> tuple[Array, Array, BoolArray]:
    """Move vertices to cut points that are close to them, the closest first; those of the floor stay in it.

    Returns
    -------
    points, value : (n, 3) and (n,) arrays
        Moved points and the level set, 0 at those.
    gone : (e,) bool array
        Cut points that no longer cut an edge.
    """
    points, value = points.copy(), value.copy()
    span = points[edges[:, 1]] - points[edges[:, 0]]
    length = np.linalg.norm(span, axis=1)
    # Edges along an axis are the long ones of the lattice, those along a cube's diagonal the short.
    axial = np.abs(span).max(axis=1) > 0.99 * length
    reach = np.where(axial, _WARP_LONG, _WARP_SHORT)
    distance = np.stack([np.linalg.norm(cuts - points[edges[:, end]], axis=1) for end in (0, 1)], axis=1)
    leaves_floor = floor[edges] & ~floor[edges[:, ::-1]]
    score = np.where(leaves_floor, np.inf, distance / (reach * length)[:, None])
    live = np.ones(len(edges), dtype=bool)
    while True:
        close = live[:, None] & (score < 1.0)
        row, end = np.nonzero(close)
        if len(row) == 0:
            break
        vertex, s = edges[row, end], score[row, end]
        order = np.lexsort((row, s, vertex))
        vertex, first = np.unique(vertex[order], return_index=True)
        chosen_row, best = row[order][first], s[order][first]
        # A vertex moves when no neighbour across the surface is closer to its own cut point.
        priority = np.full(len(points), np.inf)
        priority[vertex] = best
        ends = edges[live]
        rival = np.full(len(points), np.inf)
        np.minimum.at(rival, ends[:, 0], priority[ends[:, 1]])
        np.minimum.at(rival, ends[:, 1], priority[ends[:, 0]])
        number = np.full(len(points), len(points))
        number[vertex] = vertex
        rival_number = np.full(len(points), len(points))
        for a, b in ((0, 1), (1, 0)):
            tied = priority[ends[:, b]] == priority[ends[:, a]]
            np.minimum.at(rival_number, ends[tied, a], number[ends[tied, b]])
        go = (best < rival[vertex]) | ((best == rival[vertex]) & (vertex < rival_number[vertex]))
        moved = vertex[go]
        points[moved] = cuts[chosen_row[go]]
        value[moved] = 0.0
        live &= (value[edges] != 0.0).all(axis=1)
    return points, value, np.asarray(~live)
