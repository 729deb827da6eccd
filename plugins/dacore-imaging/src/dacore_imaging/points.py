"""Sensors at points."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse, as_array
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.space import StateSpace
from dacore.errors import ShapeError
from dacore_imaging.grid import Axis, axis_number
from dacore_imaging.kernel import kernel_means
from dacore_imaging.measured import measured, place, stack_sites, unit_directions


@dataclass(frozen=True)
class PointSensors(ObservationOperator):
    """Values, or one derivative, of a field at points, sharp or smeared by a Gaussian.

    Parameters
    ----------
    positions : sequence of d floats [cm]
    field : str
    components : sequence of int or letter
        Components of the field; empty: all of them.
    directions : sequence of d floats
        Unit vectors, instead of `components`.
    derivative : int or letter, optional
        Axis of the derivative; by default the value itself.
    width : float [cm]
        Standard deviation of a Gaussian that the field is averaged with, normalised over the domain
        and ending at 5 standard deviations; 0 is the point itself. Needs a space with cells.
    outside : {"error", "drop"}
        What to do with points outside the domain: refuse and name them, or leave them out and count
        them in `Functionals.dropped`. A smeared sensor must lie inside too.

    Raises
    ------
    ShapeError
        If settings are out of range.
    """

    needs: ClassVar[frozenset[str]] = frozenset()

    positions: tuple[tuple[float, ...], ...]
    field: str = "u"
    components: tuple[Axis, ...] = ()
    directions: tuple[tuple[float, ...], ...] = ()
    derivative: Axis | None = None
    width: float = 0.0
    outside: Literal["error", "drop"] = "error"

    def __post_init__(self) -> None:
        points = as_array("sensor positions", self.positions, (None, None))
        dim = points.shape[1]
        if dim not in (2, 3):
            raise ShapeError(f"sensor positions: got {dim} coordinates, expected 2 or 3")
        object.__setattr__(self, "positions", tuple(map(tuple, points.tolist())))
        object.__setattr__(self, "components", tuple(self.components))
        object.__setattr__(self, "directions", unit_directions(self.directions))
        if not len(points):
            raise ShapeError("sensor positions: got none, expected at least one")
        if len(set(self.positions)) < len(self.positions):
            twice = next(one for one in self.positions if self.positions.count(one) > 1)
            raise ShapeError(f"sensor positions: got {twice} twice, expected each once")
        if self.components and self.directions:
            raise ShapeError("sensors: got both components and directions; give one")
        if self.derivative is not None:
            axis_number("sensor derivative", self.derivative, dim)
        if not (np.isfinite(self.width) and self.width >= 0):
            raise ShapeError(f"sensor width: got {self.width}, expected 0 or a positive length [cm]")
        if self.outside not in ("error", "drop"):
            raise ShapeError(f"sensors outside: got {self.outside!r}, expected 'error' or 'drop'")

    def functionals(self, space: StateSpace) -> Functionals:
        """Return one functional for each component (outer) and each sensor kept (inner).

        Raises
        ------
        ShapeError
            If sensors lie outside the domain and `outside` is "error", or all do.
        CapabilityError
            If the space has no such field, or `width` needs cells that it lacks.
        """
        self.check(space)
        points = np.array(self.positions)
        what = measured(space, self.field, self.components, self.directions, points.shape[1])
        axis = None if self.derivative is None else axis_number("sensor derivative", self.derivative, points.shape[1])
        try:
            space.evaluation(points[:0], self.field)
        except ShapeError as error:  # no point is outside here: their coordinates are too few or too many
            raise ShapeError(
                f"sensor positions: got {points.shape[1]} coordinates each, expected as many as the domain has axes"
            ) from error
        lost = _outside(space, self.field, points)
        if lost.size and (self.outside == "error" or lost.size == len(points)):
            places = "; ".join("(" + ", ".join(f"{value:.6g}" for value in points[k]) + ")" for k in lost[:5])
            more = f" and {lost.size - 5} more" if lost.size > 5 else ""
            raise ShapeError(
                f"sensors: {lost.size} of {len(points)} lie outside the domain: {places}{more} cm; "
                "move them, or set outside = 'drop' to keep the others"
            )
        kept = np.setdiff1d(np.arange(len(points)), lost)
        if self.width:
            scalar = kernel_means(space.cells(), self.field, points[kept], self.width, axis)
        else:
            scalar = _values(space, self.field, points[kept], axis)
        labels, centres, directions = stack_sites(what, points[kept])
        unit = space.layout.field(self.field).unit
        slope = "" if axis is None else f"d/d{'xyz'[axis]} "
        return Functionals(
            matrix=place(space, scalar, self.field, what),
            labels=tuple(slope + label for label in labels),
            unit=unit if axis is None else f"{unit}/cm",
            centres=centres,
            directions=directions,
            sites=np.tile(kept, len(what)),
            dropped=int(lost.size),
        )


def _values(space: StateSpace, field: str, points: Array, derivative: int | None) -> Sparse:
    """Scalar functionals (p, n_nodes): those of the first component."""
    block = space.layout.component(field, 0)
    every = space.evaluation(points, field, derivative)
    return csr_array(every[: len(points), block])


def _outside(space: StateSpace, field: str, points: Array) -> IntArray:
    """Numbers of the points outside the domain, by halving: a space only says that one of them is."""

    def search(numbers: IntArray) -> list[int]:
        try:
            space.evaluation(points[numbers], field)
        except ShapeError:
            if len(numbers) == 1:
                return [int(numbers[0])]
            half = len(numbers) // 2
            return search(numbers[:half]) + search(numbers[half:])
        return []

    found: Sequence[int] = search(np.arange(len(points)))
    return np.array(found, dtype=np.int64)
