"""The grid of an image: boxes of equal size, in any place and orientation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dacore.core.arrays import Array, IntArray, as_array
from dacore.errors import ShapeError

Axis: TypeAlias = int | Literal["x", "y", "z"]

# Axes typed with fewer digits than this are mistyped rather than rounded.
_ORTHONORMAL = 1e-6


def axis_number(what: str, axis: Axis, dim: int = 3) -> int:
    """Number of an axis given as a number or a letter; ShapeError names `what` if there is no such axis."""
    letters = "xyz"[:dim]
    number = letters.find(axis) if isinstance(axis, str) and len(axis) == 1 else axis
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < dim:
        raise ShapeError(f"{what}: got {axis!r}, expected {', '.join(letters)} or 0 to {dim - 1}")
    return number


@dataclass(frozen=True, eq=False)
class Grid:
    """Boxes i = (i₀, i₁, …): corners at grid coordinates i and i + 1.

    Parameters
    ----------
    origin : (d,) array_like [cm]
        Corner of box 0, in the mesh's coordinates.
    axes : (d, d) array_like
        Rows are the unit vectors along the edges of the boxes; a reflection is allowed, as images
        have one now and then.
    size : (d,) array_like [cm]
        Lengths of the edges.

    Raises
    ------
    ShapeError
        If sizes are not positive or axes are not orthonormal.
    """

    origin: Array
    axes: Array
    size: Array

    def __init__(self, origin: ArrayLike, axes: ArrayLike, size: ArrayLike) -> None:
        lengths = as_array("voxel size", size, (None,))
        dim = len(lengths)
        corner = as_array("grid origin", origin, (dim,))
        rows = as_array("grid axes", axes, (dim, dim))
        if not (lengths > 0).all():
            raise ShapeError(f"voxel size: got {lengths.tolist()}, expected positive lengths [cm]")
        defect = float(np.abs(rows @ rows.T - np.eye(dim)).max())
        if defect > _ORTHONORMAL:
            raise ShapeError(
                f"grid axes: rows are orthonormal to {defect:.1e} only; expected perpendicular unit vectors, six digits"
            )
        if defect > 0:
            # The nearest rotation: boxes then have exactly the volume of their edges.
            left, _, right = np.linalg.svd(rows)
            rows = left @ right
        for name, value in (("origin", corner), ("axes", rows), ("size", lengths)):
            object.__setattr__(self, name, value)

    @classmethod
    def from_affine(cls, affine: ArrayLike) -> "Grid":
        """Grid of an image whose `affine` (d + 1, d + 1) takes voxel numbers to voxel centres [cm].

        Raises
        ------
        ShapeError
            If the affine shears, is singular, or its last row is not (0, …, 0, 1).
        """
        matrix = as_array("affine", affine, (None, None))
        dim = len(matrix) - 1
        matrix = as_array("affine", matrix, (dim + 1, dim + 1))
        if np.abs(matrix[dim] - np.eye(dim + 1)[dim]).max() > 0:
            raise ShapeError(f"affine: got the last row {matrix[dim].tolist()}, expected zeros and a 1")
        edges = matrix[:dim, :dim]
        size = np.linalg.norm(edges, axis=0)
        if not (size > 0).all():
            raise ShapeError("affine: a voxel edge has length 0; expected an invertible matrix")
        return cls(matrix[:dim, dim] - 0.5 * edges.sum(axis=1), (edges / size).T, size)

    @property
    def dim(self) -> int:
        """Dimension d of space."""
        return len(self.size)

    @property
    def volume(self) -> float:
        """Volume of a box [cm^d]."""
        return float(np.prod(self.size))

    def to_grid(self, points: Array) -> Array:
        """Grid coordinates (n, d) of points (n, d) [cm]."""
        return np.asarray((points - self.origin) @ self.axes.T / self.size)

    def to_space(self, coordinates: Array) -> Array:
        """Points (n, d) [cm] of grid coordinates (n, d)."""
        return np.asarray(self.origin + (coordinates * self.size) @ self.axes)

    def centres(self, numbers: IntArray) -> Array:
        """Centres (n, d) [cm] of boxes given by their numbers (n, d)."""
        return self.to_space(numbers.astype(np.float64) + 0.5)

    def range_over(self, points: Array) -> tuple[IntArray, IntArray]:
        """Boxes lower <= i < upper on each axis that hold all points (n, d) [cm]."""
        coordinates = self.to_grid(points)
        lower = np.floor(coordinates.min(axis=0) + 1e-9).astype(np.int64)
        upper = np.ceil(coordinates.max(axis=0) - 1e-9).astype(np.int64)
        return lower, np.maximum(upper, lower + 1)

    def centred(self, axis: int, position: float) -> "Grid":
        """Grid shifted along one axis so that its layer 0 is centred at the coordinate `position` [cm].

        The coordinate is that along the grid's axis, measured from the zero of the mesh: for a
        grid that is not rotated, the mesh's own x, y or z.
        """
        shift = position - 0.5 * self.size[axis] - self.axes[axis] @ self.origin
        return Grid(self.origin + shift * self.axes[axis], self.axes, self.size)


def box_numbers(lower: IntArray, upper: IntArray) -> IntArray:
    """Numbers (n, d) of all boxes lower <= i < upper, the last axis running fastest."""
    ranges: Sequence[IntArray] = [np.arange(a, b) for a, b in zip(lower, upper, strict=True)]
    return np.stack([part.ravel() for part in np.meshgrid(*ranges, indexing="ij")], axis=1)
