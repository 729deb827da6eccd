"""How loads vary in time: callables that can be compared, hashed and pickled."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array


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

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        return np.clip(times / self.duration, 0.0, 1.0)
