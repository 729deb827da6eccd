"""Parts of a moving solid, as tables of a scene give them: what pushes it, what moves it, balls of another kind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.geometry.balls import Ball


@dataclass(frozen=True)
class Traction:
    """A force per area on a role of the boundary.

    Parameters
    ----------
    size : float [dyn/cm²]
        Along `direction`, or a pressure, which pushes inwards where it is positive.
    direction : tuple of float
        One number a dimension, scaled to length one; empty: a pressure.
    """

    size: float
    direction: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check_size("traction", self.size, "dyn/cm^2")
        if self.direction:
            _check_direction("traction", self.direction)


@dataclass(frozen=True)
class BodyForce:
    """A force per volume on the whole body.

    Parameters
    ----------
    size : float [dyn/cm³]
    direction : tuple of float
        One number a dimension, scaled to length one.
    """

    size: float
    direction: tuple[float, ...]

    def __post_init__(self) -> None:
        _check_size("body_force", self.size, "dyn/cm^3")
        _check_direction("body_force", self.direction)


@dataclass(frozen=True)
class Motion:
    """A displacement that is prescribed on a role: a plate that is shaken along one axis.

    Parameters
    ----------
    by : float [cm]
    axis : int
        The component that is prescribed; the others are free unless they are held.
    """

    by: float
    axis: int

    def __post_init__(self) -> None:
        _check_size("moved", self.by, "cm")
        if self.axis not in (0, 1, 2):
            raise ShapeError(f"moved: got axis {self.axis}, expected 0, 1 or 2")


@dataclass(frozen=True)
class Inclusion(Ball):
    """A ball of another material: the cells whose centroids lie in it.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    radius : float [cm]
    stiffness, density : float
        Relative to the rest: 2 is twice as much.
    """

    stiffness: float = 1.0
    density: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("stiffness", "density")


def unit(direction: Sequence[float], dim: int, what: str) -> Array:
    """Return a direction (d,) of length one; ShapeError if it has another dimension than the mesh."""
    if len(direction) != dim:
        raise ShapeError(f"{what}: got a direction of {len(direction)} numbers, expected {dim}")
    vector = np.array(direction, dtype=np.float64)
    return np.asarray(vector / np.linalg.norm(vector))


def _check_size(what: str, size: float, of: str) -> None:
    if not np.isfinite(size):
        raise ShapeError(f"{what}: got {size}, expected a finite number of {of}")


def _check_direction(what: str, direction: Sequence[float]) -> None:
    if not (np.isfinite(direction).all() and any(direction)):
        raise ShapeError(f"{what}: got the direction {list(direction)}, expected one number an axis, not all zero")
