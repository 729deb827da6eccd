"""Which cell holds a point, and where in it.

A tree of boxes over the cells answers it exactly: a cell that holds a point has a box that does,
and so has every ancestor of that box. No point inside the mesh is ever reported outside, however
the mesh is graded. The tree is implicit: cells sorted along a Morton curve, eight children a node.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dacore.core.arrays import Array, IntArray, as_array, as_indices
from dacore.core.simplex import barycentric_gradients
from dacore.errors import ShapeError

# Children of a node of the tree, and pairs (point, node) tested at once: about 100 MB of work space.
_BRANCH = 8
_PAIRS = 1 << 18


class PointLocator:
    """Finds the cells that hold points.

    Parameters
    ----------
    points : (n, d) array [cm]
        Vertices, d = 2 or 3.
    cells : (c, d + 1) int array
        Simplices, none of them flat.
    tolerance : float
        A point belongs to a cell if no barycentric coordinate is below minus this number.
    """

    def __init__(self, points: ArrayLike, cells: ArrayLike, tolerance: float = 1e-9) -> None:
        self.points = as_array("points of the locator", points, (None, None))
        self.dim = self.points.shape[1]
        if self.dim not in (2, 3):
            raise ShapeError(f"points of the locator: got {self.dim} coordinates a point, expected 2 or 3")
        self.cells = as_indices("cells of the locator", cells, (None, self.dim + 1), len(self.points))
        if not len(self.cells):
            raise ShapeError("cells of the locator: got none, expected at least one")
        if not 0 <= tolerance < 1:
            raise ShapeError(f"tolerance of the locator: got {tolerance}, expected a number from 0 to below 1")
        self.tolerance = float(tolerance)
        low, high = self._boxes()
        self._order = np.argsort(morton_codes((low + high) / 2), kind="stable")
        self._levels = _tree(low[self._order], high[self._order])

    def locate(self, x: ArrayLike, outside: Literal["raise", "mark"] = "raise") -> tuple[IntArray, Array]:
        """Cells that hold points, and the points' barycentric coordinates in them.

        Parameters
        ----------
        x : (p, d) array [cm]
        outside : {"raise", "mark"}
            What to do with points in no cell: raise an error, or mark them by the cell −1.

        Returns
        -------
        cell : (p,) int array
            The lowest number of the cells that hold the point.
        barycentric : (p, d + 1) array
            Not clipped: values down to −tolerance occur. NaN where the cell is −1.

        Raises
        ------
        ShapeError
            If a point is in no cell and `outside` is "raise"; the message names the first.
        """
        if outside not in ("raise", "mark"):
            raise ShapeError(f"outside: got {outside!r}, expected 'raise' or 'mark'")
        where = as_array("points to locate", x, (None, self.dim))
        found = np.full(len(where), len(self.cells), dtype=np.int64)
        self._descend(where, found, len(self._levels) - 1, np.arange(len(where)), np.zeros(len(where), dtype=np.int64))
        missing = np.flatnonzero(found == len(self.cells))
        if len(missing) and outside == "raise":
            first = ", ".join(f"{value:.6g}" for value in where[missing[0]])
            raise ShapeError(
                f"point {missing[0]} at ({first}) lies outside the mesh ({len(missing)} of {len(where)} points do); "
                "expected points inside: move or drop those outside"
            )
        found[missing] = -1
        barycentric = np.full((len(where), self.dim + 1), np.nan)
        inside = np.flatnonzero(found >= 0)
        for part in _slices(len(inside)):
            barycentric[inside[part]] = self._barycentric(where[inside[part]], found[inside[part]])
        return found, barycentric

    def _descend(self, x: Array, found: IntArray, level: int, point: IntArray, node: IntArray) -> None:
        """Follow pairs of a point and a node of the tree down to the cells; keep the lowest cell number."""
        low, high = self._levels[level]
        for part in _slices(len(point)):
            p, k = point[part], node[part]
            keep = np.ones(len(p), dtype=bool)
            for axis in range(self.dim):
                value = x[p, axis]
                keep &= (low[axis][k] <= value) & (value <= high[axis][k])
            p, k = p[keep], k[keep]
            if level == 0:
                cell = self._order[k]
                inside = self._barycentric(x[p], cell).min(axis=1) >= -self.tolerance
                np.minimum.at(found, p[inside], cell[inside])
            else:
                children = (k[:, None] * _BRANCH + np.arange(_BRANCH)).ravel()
                self._descend(x, found, level - 1, np.repeat(p, _BRANCH), children)

    def _barycentric(self, x: Array, cell: IntArray) -> Array:
        """Barycentric coordinates (p, d + 1) of points (p, d), each in its own cell (p,)."""
        # The coordinates of x relative to the first vertex are those of its offset; the first is what is left of one.
        gradients, _ = barycentric_gradients(self.points, self.cells[cell])
        offset = x - self.points[self.cells[cell, 0]]
        rest = np.einsum("pid,pd->pi", gradients[:, 1:], offset)
        return np.concatenate([1.0 - rest.sum(axis=1, keepdims=True), rest], axis=1)

    def _boxes(self) -> tuple[Array, Array]:
        """Boxes (c, d) that hold every point within the tolerance of its cell."""
        vertices = self.points[self.cells]
        low, high = vertices.min(axis=1), vertices.max(axis=1)
        # Σ λ = 1 and λ ≥ −tol put x at most (d + 1) tol extents outside; the rest is for round-off.
        pad = 2 * (self.dim + 1) * self.tolerance * (high - low) + 1e-14 * np.abs(self.points).max()
        return low - pad, high + pad


def morton_codes(points: Array) -> IntArray:
    """Places (n,) along a space-filling curve of points (n, d): near in number is near in space."""
    dim = points.shape[1]
    bits = 62 // dim
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    # Exact in floating point up to 2^31, so the cast never overflows.
    cells = np.floor((points - points.min(axis=0)) / extent * (2**bits - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(bits):
        for axis in range(dim):
            code |= ((cells[:, axis] >> bit) & 1) << (dim * bit + axis)
    return code


def _tree(low: Array, high: Array) -> list[tuple[Array, Array]]:
    """Boxes of every level, leaves first, stored axis by axis (d, n); missing children are empty boxes."""
    levels = []
    lows, highs = low.T, high.T
    while True:
        lack = -lows.shape[1] % _BRANCH if lows.shape[1] > 1 else 0
        lows = np.pad(lows, ((0, 0), (0, lack)), constant_values=np.inf)
        highs = np.pad(highs, ((0, 0), (0, lack)), constant_values=-np.inf)
        levels.append((np.ascontiguousarray(lows), np.ascontiguousarray(highs)))
        if lows.shape[1] == 1:
            return levels
        shape = (len(lows), -1, _BRANCH)
        lows, highs = lows.reshape(shape).min(axis=2), highs.reshape(shape).max(axis=2)


def _slices(n: int) -> list[slice]:
    """Parts of range(n) small enough to work on at once."""
    return [slice(start, min(start + _PAIRS, n)) for start in range(0, n, _PAIRS)]
