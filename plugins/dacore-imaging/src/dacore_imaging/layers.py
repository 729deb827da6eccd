"""Which voxels of a grid a domain covers, and the integrals over them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.simplex import lagrange
from dacore.core.space import CellGeometry
from dacore.errors import ShapeError
from dacore.geometry.clip import box_integrals
from dacore.geometry.locate import PointLocator
from dacore_imaging.grid import Grid, box_numbers

# A voxel filled less than this holds round-off only; an average over it would be noise.
_SLIVER = 1e-9
_MAX_BOXES = 20_000_000
_POINTS = 1 << 18


@dataclass(frozen=True, eq=False)
class Layer:
    """A block of boxes of a grid.

    Parameters
    ----------
    grid : Grid
    lower, upper : (d,) int array
        Boxes that can meet the domain: lower <= i < upper on each axis.
    asked : (2, d) int array or None
        Boxes asked for, if that is more than those that meet the domain.
    """

    grid: Grid
    lower: IntArray
    upper: IntArray
    asked: IntArray | None

    @classmethod
    def over(cls, geometry: CellGeometry, grid: Grid, shape: Sequence[int] | None, axis: int | None) -> "Layer | None":
        """The boxes of a grid that can meet the domain, None if there are none.

        Parameters
        ----------
        geometry : CellGeometry
        grid : Grid
        shape : d ints, optional
            Number of boxes from the grid's origin on; None: as many as the domain needs.
        axis : int, optional
            Keep only layer 0 on this axis.

        Raises
        ------
        ShapeError
            If there are more than 20 million boxes.
        """
        lower, upper = grid.range_over(geometry.points)
        asked = None if shape is None else np.array([np.zeros(grid.dim), shape], dtype=np.int64)
        limits = [] if asked is None else [asked]
        if axis is not None:
            one = np.array([lower, upper])
            one[:, axis] = 0, 1
            limits.append(one)
            if asked is not None:
                asked[:, axis] = 0, 1
        for first, last in limits:
            lower, upper = np.maximum(lower, first), np.minimum(upper, last)
        if (upper <= lower).any():
            return None
        count = float(np.prod((upper - lower).astype(np.float64)))
        if count > _MAX_BOXES:
            raise ShapeError(
                f"voxels: the domain spans {count:.2g} of them, expected at most {_MAX_BOXES:.0g}; "
                "use larger voxels or slices"
            )
        return cls(grid, lower, upper, asked)

    def centres(self, rows: IntArray) -> Array:
        """Centres (n, d) [cm] of boxes given by their number in this block."""
        numbers = np.stack(np.unravel_index(rows, tuple((self.upper - self.lower).tolist())), axis=1)
        return self.grid.centres(numbers + self.lower)

    @property
    def unseen(self) -> int:
        """Number of boxes asked for beyond those that can meet the domain."""
        if self.asked is None:
            return 0
        return int(np.prod(self.asked[1] - self.asked[0]) - np.prod(self.upper - self.lower))

    def unseen_centres(self) -> Array:
        """Centres (n, d) [cm] of the boxes asked for that cannot meet the domain."""
        if self.asked is None:
            return np.empty((0, self.grid.dim))
        numbers = box_numbers(*self.asked)
        far = ((numbers < self.lower) | (numbers >= self.upper)).any(axis=1)
        return self.grid.centres(numbers[far])


@dataclass(frozen=True, eq=False)
class Covered:
    """Voxels that are covered enough, and those that are not.

    Parameters
    ----------
    centres : (n, d) array [cm]
    integrals : (n, n_nodes) csr_array
        Of the nodal basis, in units of a voxel's volume.
    dropped : (k, d) array [cm]
        Centres of asked voxels that are covered too little.
    unseen : int
        Number of asked voxels far from the domain.
    """

    centres: Array
    integrals: Sparse
    dropped: Array
    unseen: int


def cover(
    geometry: CellGeometry, field: str, layer: Layer, coverage: float, quadrature: Literal["exact"] | int
) -> Covered:
    """Integrals over the boxes of a layer of which the domain covers at least a fraction.

    Parameters
    ----------
    geometry : CellGeometry
    field : str
    layer : Layer
    coverage : float
        0 to 1.
    quadrature : "exact" or int
        Clip cells, or take this many midpoints a voxel axis.
    """
    if isinstance(quadrature, str):
        nodes, order = geometry.nodes[field], geometry.orders[field]
        points = layer.grid.to_grid(geometry.points)
        integrals = box_integrals(points, geometry.cells, nodes, order, layer.lower, layer.upper)
    else:
        integrals = _sampled(geometry, field, layer, quadrature)
    fill = np.asarray(integrals.sum(axis=1)).ravel()
    kept = fill >= max(coverage - _SLIVER, _SLIVER)
    asked = fill > _SLIVER if layer.asked is None else np.ones(len(fill), dtype=bool)
    rows = np.flatnonzero(kept)
    dropped = np.flatnonzero(asked & ~kept)
    return Covered(layer.centres(rows), csr_array(integrals[rows]), layer.centres(dropped), layer.unseen)


def _sampled(geometry: CellGeometry, field: str, layer: Layer, per_axis: int) -> Sparse:
    """Integrals of the nodal basis over boxes by the midpoint rule, (n_boxes, n_nodes)."""
    nodes, order = geometry.nodes[field], geometry.orders[field]
    locator = PointLocator(geometry.points, geometry.cells)
    dim = layer.grid.dim
    offsets = (box_numbers(np.zeros(dim, dtype=np.int64), np.full(dim, per_axis)) + 0.5) / per_axis
    boxes = box_numbers(layer.lower, layer.upper)
    total = csr_array((len(boxes), int(nodes.max()) + 1))
    step = max(1, _POINTS // len(offsets))
    for start in range(0, len(boxes), step):
        corners = boxes[start : start + step]
        points = layer.grid.to_space((corners[:, None] + offsets).reshape(-1, dim))
        cell, barycentric = locator.locate(points, outside="mark")
        inside = np.flatnonzero(cell >= 0)
        values = lagrange(order, barycentric[inside]) / len(offsets)
        rows = np.repeat(start + inside // len(offsets), values.shape[1])
        part = coo_array((values.ravel(), (rows, nodes[cell[inside]].ravel())), shape=total.shape)
        total = csr_array(total + part.tocsr())
    return total
