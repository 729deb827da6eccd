"""The nearest point of a mesh to points outside it: on which cell's boundary facet, and where in the cell.

Exact: the nearest facets by their centroids are tried, and more of them until none further away can be nearer.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from dacore.core.arrays import Array, IntArray, as_array, as_indices

# Facets tried first, and pairs of a point and a facet at once: about 100 MB of work space.
_FIRST = 16
_PAIRS = 1 << 19


class NearestPoint:
    """Finds the nearest point of a mesh's boundary.

    Parameters
    ----------
    points : (n, d) array [cm]
        Vertices, d = 2 or 3.
    cells : (c, d + 1) int array
        Simplices, none of them flat.
    """

    def __init__(self, points: ArrayLike, cells: ArrayLike) -> None:
        self.points = as_array("points of the mesh", points, (None, None))
        self.dim = self.points.shape[1]
        self.cells = as_indices("cells of the mesh", cells, (None, self.dim + 1), len(self.points))
        self._cell, self._opposite = _exterior(self.cells)
        local = np.array([[i for i in range(self.dim + 1) if i != k] for k in range(self.dim + 1)])
        self._local = local[self._opposite]
        self._corners = self.points[np.take_along_axis(self.cells[self._cell], self._local, axis=1)]
        centres = self._corners.mean(axis=1)
        self._radius = float(np.linalg.norm(self._corners - centres[:, None], axis=2).max())
        self._tree = cKDTree(centres)

    def find(self, x: ArrayLike) -> tuple[IntArray, Array, Array]:
        """Nearest points of the boundary.

        Parameters
        ----------
        x : (p, d) array [cm]

        Returns
        -------
        cell : (p,) int array
            The cell whose facet the nearest point is on.
        barycentric : (p, d + 1) array
            Coordinates of the nearest point in it, none negative.
        distance : (p,) array [cm]
        """
        where = as_array("points", x, (None, self.dim))
        facet = np.zeros(len(where), dtype=np.int64)
        weights, distance = np.zeros((len(where), self.dim)), np.full(len(where), np.inf)
        left, count = np.arange(len(where)), min(_FIRST, len(self._cell))
        while left.size:
            sure = np.zeros(len(left), dtype=bool)
            for start in range(0, len(left), max(_PAIRS // count, 1)):
                part = slice(start, start + max(_PAIRS // count, 1))
                of = left[part]
                away, tried = (a.reshape(len(of), count) for a in self._tree.query(where[of], k=count))
                at, gap = _nearest(where[of, None], self._corners[tried])
                best = gap.argmin(axis=1)
                row = np.arange(len(of))
                facet[of], weights[of], distance[of] = tried[row, best], at[row, best], gap[row, best]
                # No facet reaches further from its centroid than the radius.
                sure[part] = away[:, -1] - self._radius >= distance[of]
            if count == len(self._cell):
                break
            left, count = left[~sure], min(4 * count, len(self._cell))
        barycentric = np.zeros((len(where), self.dim + 1))
        np.put_along_axis(barycentric, self._local[facet], weights, axis=1)
        return self._cell[facet], barycentric, distance


def _exterior(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Cell and opposite corner, (f,) each, of every facet that belongs to one cell."""
    corners = cells.shape[1]
    facets = np.concatenate([np.delete(cells, k, axis=1) for k in range(corners)])
    facets.sort(axis=1)
    order = np.lexsort(facets.T)
    same = (facets[order[1:]] == facets[order[:-1]]).all(axis=1)
    single = order[~(np.append(same, False) | np.insert(same, 0, False))]
    opposite, cell = np.divmod(np.sort(single), len(cells))
    return cell, opposite


def _nearest(x: Array, corners: Array) -> tuple[Array, Array]:
    """Barycentric coordinates (..., d) of the nearest points of segments or triangles, and the distances (...).

    Parameters
    ----------
    x : (..., d) array
    corners : (..., d, d) array
    """
    if corners.shape[-2] == 2:
        return _on_segment(x, corners[..., 0, :], corners[..., 1, :])
    a, b, c = (corners[..., k, :] for k in range(3))
    weights, best = np.zeros(corners.shape[:-1]), np.full(corners.shape[:-2], np.inf)
    for i, j, one, other in ((0, 1, a, b), (0, 2, a, c), (1, 2, b, c)):
        at, gap = _on_segment(x, one, other)
        nearer = gap < best
        best = np.where(nearer, gap, best)
        edge = np.zeros_like(weights)
        edge[..., i], edge[..., j] = at[..., 0], at[..., 1]
        weights = np.where(nearer[..., None], edge, weights)
    # Where the foot of the perpendicular is in the triangle, it is nearer than any edge.
    u, v, w = b - a, c - a, x - a
    uu, uv, vv, wu, wv = (_dot(*pair) for pair in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    size = uu * vv - uv * uv
    second, third = (vv * wu - uv * wv) / size, (uu * wv - uv * wu) / size
    inside = (second >= 0) & (third >= 0) & (second + third <= 1)
    foot = np.stack([1 - second - third, second, third], axis=-1)
    across = np.linalg.norm(w - second[..., None] * u - third[..., None] * v, axis=-1)
    return np.where(inside[..., None], foot, weights), np.where(inside, across, best)


def _on_segment(x: Array, a: Array, b: Array) -> tuple[Array, Array]:
    along = np.clip(_dot(x - a, b - a) / _dot(b - a, b - a), 0.0, 1.0)
    gap = np.linalg.norm(x - a - along[..., None] * (b - a), axis=-1)
    return np.stack([1 - along, along], axis=-1), np.asarray(gap)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))
