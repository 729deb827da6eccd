"""Cutting tetrahedra along the zero set of a level set known at their vertices.

The stencils of Labelle & Shewchuk 2007, figure 3. A face cut into a triangle and a quadrilateral
is shared by two tetrahedra that must agree on the quadrilateral's diagonal: it starts at the inner
vertex closer to the surface, a rule that knows the face only and never goes round a prism in a circle.
"""

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.errors import MeshError


def cut_cells(points: Array, value: Array, cells: IntArray, edges: IntArray, cuts: Array) -> tuple[Array, IntArray]:
    """Tetrahedra inside, cut where the surface crosses them.

    Parameters
    ----------
    points : (n, 3) array
    value : (n,) array
        Level set at the points: negative inside, 0 on the surface.
    cells : (c, 4) int array
    edges : (e, 2) int array
        Edges with ends on different sides, inner end first, sorted by row.
    cuts : (e, 3) array
        Where the surface crosses them.

    Returns
    -------
    nodes : (n + e, 3) array
        The points, then the cut points.
    pieces : (k, 4) int array
        Tetrahedra of any orientation.
    """
    rank = np.empty(len(points), dtype=np.int64)
    rank[np.argsort(-value, kind="stable")] = np.arange(len(points))
    side = np.sign(value[cells]).astype(np.int64)
    # Vertices of a cell: inner ones by rank, then those on the surface, then outer ones.
    order = np.argsort(side * len(points) * 2 + rank[cells], axis=1, kind="stable")
    cells = np.take_along_axis(cells, order, axis=1)
    inner, outer = (side < 0).sum(axis=1), (side > 0).sum(axis=1)
    base = np.int64(len(points))
    codes = edges[:, 0] * base + edges[:, 1]

    def cut(a: IntArray, b: IntArray) -> IntArray:
        """Node numbers of the cut points of edges from inner vertices a to outer vertices b."""
        wanted = a * base + b
        place = np.searchsorted(codes, wanted)
        if (place >= len(codes)).any() or (codes[place] != wanted).any():
            raise MeshError("stuffing: an edge that crosses the surface has no cut point")
        return np.asarray(base + place)

    pieces = [cells[(inner > 0) & (outer == 0)]]

    def emit(*nodes: IntArray) -> None:
        pieces.append(np.stack(nodes, axis=1))

    for n_inner, n_outer in ((1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1)):
        here = cells[(inner == n_inner) & (outer == n_outer)]
        if len(here) == 0:
            continue
        a, b, c, d = here.T
        if n_inner == 1:
            corner = {1: (b, c), 2: (b,), 3: ()}[n_outer]
            emit(a, *corner, *(cut(a, vertex) for vertex in (b, c, d)[3 - n_outer :]))
        elif n_inner == 2 and n_outer == 1:
            ad, bd = cut(a, d), cut(b, d)
            emit(c, a, b, bd)
            emit(c, a, bd, ad)
        elif n_inner == 2:
            nodes = np.concatenate([points, cuts])
            ac, ad, bc, bd = cut(a, c), cut(a, d), cut(b, c), cut(b, d)
            emit(a, b, bc, bd)
            # The quadrilateral on the surface belongs to this cell alone: take the shorter diagonal.
            first = _distance(nodes, ac, bd) <= _distance(nodes, ad, bc)
            emit(a, ac, np.where(first, bd, bc), ad)
            emit(a, bc, bd, np.where(first, ac, ad))
        else:
            ad, bd, cd = cut(a, d), cut(b, d), cut(c, d)
            emit(a, ad, bd, cd)
            emit(a, b, bd, cd)
            emit(a, b, c, cd)
    return np.concatenate([points, cuts]), np.concatenate(pieces)


def _distance(nodes: Array, a: IntArray, b: IntArray) -> Array:
    return np.asarray(np.linalg.norm(nodes[a] - nodes[b], axis=1))
