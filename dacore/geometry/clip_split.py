"""Cut simplices by planes into simplices."""

from functools import cache
from itertools import product

import numpy as np

from dacore.core.arrays import Array, IntArray

#: Grid coordinates this close to a grid plane (relative, in units of round-off) are on it.
SNAP = 64 * np.finfo(np.float64).eps


def snap(coordinates: Array) -> Array:
    """Move grid coordinates that miss a whole number by round-off onto it.

    A mesh whose facets lie in grid planes, once rotated, misses them by 1e-16: cutting there would
    make slivers without volume.
    """
    whole = np.rint(coordinates)
    near = np.abs(coordinates - whole) <= SNAP * np.maximum(1.0, np.abs(coordinates))
    return np.where(near, whole, coordinates)


def split(vertices: Array, axis: IntArray, plane: IntArray) -> tuple[Array, IntArray]:
    """Cut each simplex by its own grid plane; the pieces are simplices.

    Parameters
    ----------
    vertices : (k, d + 1, 2d + 1) array
        Each vertex's barycentric coordinates in its cell (d + 1), then its grid coordinates (d).
    axis, plane : (k,) int array
        The plane: where the grid coordinate `axis` is `plane`. Each simplex has vertices on both
        sides of its own.

    Returns
    -------
    pieces : (q, d + 1, 2d + 1) array
        At most six for a tetrahedron and three for a triangle. Where a vertex lies on the plane
        some have no volume.
    source : (q,) int array
        The simplex each piece is cut from.
    """
    dim = vertices.shape[1] - 1
    column = dim + 1 + axis
    heights = vertices[np.arange(len(axis)), :, column] - plane[:, None]
    order = np.argsort(heights, axis=1)
    heights = np.take_along_axis(heights, order, axis=1)
    below = (heights < 0).sum(axis=1)
    pieces, source = [], []
    for n_below in range(1, dim + 1):
        rows = np.flatnonzero(below == n_below)
        if rows.size == 0:
            continue
        first, second, table = _cases(dim, n_below)
        corners = vertices[rows[:, None], order[rows]]
        low, high = heights[rows[:, None], first], heights[rows[:, None], second]
        t = (low / (low - high))[:, :, None]
        # (1 − t) a + t b gives b exactly where b lies on the plane (t = 1), so that a piece without
        # volume has two equal vertices.
        cuts = (1.0 - t) * corners[:, first] + t * corners[:, second]
        cuts[:, :, dim + 1 :] = snap(cuts[:, :, dim + 1 :])
        # On the plane whatever the round-off, so that no piece is ever cut there again.
        cuts[np.arange(len(rows)), :, column[rows]] = plane[rows, None]
        pool = np.concatenate([corners, cuts], axis=1)
        pieces.append(pool[:, table].reshape(-1, dim + 1, vertices.shape[2]))
        source.append(np.repeat(rows, len(table)))
    return np.concatenate(pieces), np.concatenate(source)


def volume_fractions(barycentric: Array) -> Array:
    """Volumes (k,) of pieces relative to their cells, from vertices (k, d + 1, d + 1)."""
    # Barycentric coordinates lose no digits however far the cell is from the origin.
    edges = barycentric[:, 1:, :-1] - barycentric[:, :1, :-1]
    a = edges[:, 0]
    if edges.shape[1] == 2:
        b = edges[:, 1]
        return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    b, c = edges[:, 1], edges[:, 2]
    determinant = (
        a[:, 0] * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
        - a[:, 1] * (b[:, 0] * c[:, 2] - b[:, 2] * c[:, 0])
        + a[:, 2] * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    )
    return np.asarray(np.abs(determinant))


@cache
def _cases(dim: int, n_below: int) -> tuple[list[int], list[int], IntArray]:
    """How to cut a simplex whose first `n_below` vertices (sorted by height) lie below the plane.

    Returns the lower and upper ends of the cut edges, and the pieces as numbers in the pool made
    of the vertices followed by the cuts.
    """
    edges = list(product(range(n_below), range(n_below, dim + 1)))
    cut = {edge: dim + 1 + number for number, edge in enumerate(edges)}
    upper = range(n_below, dim + 1)
    lower = range(n_below)
    # Each side is the hull of its own vertices and of the cuts: one simplex if it holds one
    # vertex, else a prism with one of two parallel bases at each of them, or bases of vertices and cuts.
    if n_below == 1:
        cuts = [cut[0, j] for j in upper]
        table = [[0, *cuts], *_prism(cuts, list(upper))]
    elif n_below == dim:
        cuts = [cut[i, dim] for i in lower]
        table = [*_prism(list(lower), cuts), [dim, *cuts]]
    else:
        table = [
            *_prism([0, cut[0, 2], cut[0, 3]], [1, cut[1, 2], cut[1, 3]]),
            *_prism([2, cut[0, 2], cut[1, 2]], [3, cut[0, 3], cut[1, 3]]),
        ]
    return [i for i, _ in edges], [j for _, j in edges], np.array(table)


def _prism(bottom: list[int], top: list[int]) -> list[list[int]]:
    """Staircase of simplices that fill a prism (or, in the plane, a quadrilateral)."""
    return [bottom[k:] + top[: k + 1] for k in range(len(bottom))]
