"""Parts of a heated body, as tables of a scene give them: sources, walls that exchange heat, balls of another kind."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.geometry.balls import Ball


@dataclass(frozen=True)
class Source:
    """A heated spot: its power is spread like a Gaussian bell, cut at the walls and as much in all.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    width : float [cm]
        Standard deviation of the bell.
    power : float [erg/s]
        1 W is 1e7 erg/s; in two dimensions for each cm of depth. Negative cools.
    """

    centre: tuple[float, ...]
    width: float
    power: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.centre).all():
            raise ShapeError(f"source: got the centre {list(self.centre)}, expected finite coordinates")
        if not 0 < self.width < np.inf:
            raise ShapeError(f"source: got width {self.width}, expected a positive number of cm")
        if not np.isfinite(self.power):
            raise ShapeError(f"source: got power {self.power}, expected a finite number of erg/s")

    def bell(self, points: Array) -> Array:
        """Values (n,) at points (n, d) [cm], 1 at the centre."""
        if len(self.centre) != points.shape[1]:
            raise ShapeError(f"source: got a centre of {len(self.centre)} coordinates, expected {points.shape[1]}")
        away = ((points - np.array(self.centre)) ** 2).sum(axis=1)
        return np.asarray(np.exp(-0.5 * away / self.width**2))


@dataclass(frozen=True)
class Exchange:
    """A wall that exchanges heat with its surroundings: flux into the body h (ambient − T).

    Parameters
    ----------
    h : float [erg/(cm² s K)]
        Coefficient of heat transfer; 1 W/(m² K) is 1e3 erg/(cm² s K).
    ambient : float [K]
    """

    h: float
    ambient: float

    def __post_init__(self) -> None:
        if not 0 <= self.h < np.inf:
            raise ShapeError(f"convection: got h {self.h}, expected a number of erg/(cm^2 s K) of at least 0")
        if not np.isfinite(self.ambient):
            raise ShapeError(f"convection: got ambient {self.ambient}, expected a finite temperature")


@dataclass(frozen=True)
class Inclusion(Ball):
    """A ball of another material: the cells whose centroids lie in it.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    radius : float [cm]
    conductivity, capacity, perfusion : float
        Relative to the rest: 2 is twice as much.
    """

    conductivity: float = 1.0
    capacity: float = 1.0
    perfusion: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("conductivity", "capacity")
        if not 0 <= self.perfusion < np.inf:
            raise ShapeError(f"inclusion: got perfusion {self.perfusion}, expected a number of at least 0")
