"""How loads vary in time: callables that can be compared, hashed and pickled."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError


@dataclass(frozen=True)
class Constant:
    """The factor 1 at all times."""

    def __call__(self, times: Array) -> Array:
        """Return ones (t,) for times (t,) [s]."""
        return np.ones(len(times))


@dataclass(frozen=True)
class Sine:
    """sin(2π f t).

    Parameters
    ----------
    frequency : float [Hz]
    """

    frequency: float

    def __post_init__(self) -> None:
        _check_positive("frequency", self.frequency, "Hz")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        return np.asarray(np.sin(2 * np.pi * self.frequency * times))


@dataclass(frozen=True)
class Ramp:
    """A linear rise from 0 at t = 0 to 1, which it keeps.

    Parameters
    ----------
    duration : float [s]
        Length of the rise.
    """

    duration: float

    def __post_init__(self) -> None:
        _check_positive("duration", self.duration, "seconds")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        return np.clip(times / self.duration, 0.0, 1.0)


@dataclass(frozen=True)
class SmoothRamp:
    """A rise x³ (10 − 15 x + 6 x²) of x = t/duration from 0 at t = 0 to 1, which it keeps.

    Its first and second derivatives are continuous, so that a motion begins at rest and without a jolt.

    Parameters
    ----------
    duration : float [s]
        Length of the rise.
    """

    duration: float

    def __post_init__(self) -> None:
        _check_positive("duration", self.duration, "seconds")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        x = np.clip(times / self.duration, 0.0, 1.0)
        return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def _check_positive(name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ShapeError(f"{name}: got {value}, expected a positive number of {unit}")
