"""How loads vary in time: callables that can be compared, hashed and pickled."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

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
class Cosine:
    """cos(2π f t).

    Parameters
    ----------
    frequency : float [Hz]
    """

    frequency: float

    def __post_init__(self) -> None:
        _check_positive("frequency", self.frequency, "Hz")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        return np.asarray(np.cos(2 * np.pi * self.frequency * times))


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


@dataclass(frozen=True)
class Pulse:
    """The factor 1 until a time, 0 afterwards.

    Parameters
    ----------
    duration : float [s]
        Until when; at this very time the factor is 1.
    """

    duration: float

    def __post_init__(self) -> None:
        _check_positive("duration", self.duration, "seconds")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        # A grid's times are sums of steps: one that is meant to be the end may lie a rounding error behind it.
        return np.asarray(np.less_equal(times, self.duration * (1 + 1e-12)), dtype=np.float64)


@dataclass(frozen=True)
class ToneBurst:
    """A few cycles of a sine under a bell, sin(2π f t) sin²(π f t/n) for t up to n/f, and nothing afterwards.

    Value, rate and acceleration begin and end at zero.

    Parameters
    ----------
    frequency : float [Hz]
    cycles : float
        n.
    """

    frequency: float
    cycles: float = 3.0

    def __post_init__(self) -> None:
        _check_positive("frequency", self.frequency, "Hz")
        _check_positive("cycles", self.cycles, "cycles")

    def __call__(self, times: Array) -> Array:
        """Return factors (t,) at times (t,) [s]."""
        phase = self.frequency * np.asarray(times)
        bell = np.where(phase < self.cycles, np.sin(np.pi * phase / self.cycles) ** 2, 0.0)
        return np.asarray(bell * np.sin(2 * np.pi * phase))


@dataclass(frozen=True)
class Course:
    """How a load varies in time, as a table of a scene says it.

    Parameters
    ----------
    kind : {"constant", "ramp", "smooth_ramp", "pulse", "sine", "tone_burst"}
        One of the profiles of this module.
    duration : float [s]
        Of a rise or a pulse.
    frequency : float [Hz]
        Of a sine or a tone burst.
    cycles : float
        Of a tone burst.

    Raises
    ------
    ShapeError
        If a number that the kind needs is missing or not positive, or one is given that it has no use for.
    """

    kind: Literal["constant", "ramp", "smooth_ramp", "pulse", "sine", "tone_burst"] = "constant"
    duration: float | None = None
    frequency: float | None = None
    cycles: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in _COURSES:
            raise ShapeError(f"course: got {self.kind!r}, expected one of {', '.join(_COURSES)}")
        needed, allowed = _COURSES[self.kind][1], (*_COURSES[self.kind][1], *_COURSES[self.kind][2])
        for name in ("duration", "frequency", "cycles"):
            given = getattr(self, name) is not None
            if given and name not in allowed:
                raise ShapeError(f"course {self.kind}: got {name}, which it has no use for; leave it out")
            if not given and name in needed:
                raise ShapeError(f"course {self.kind}: {name} is missing; give a positive number")
        self.profile()

    def profile(self) -> Callable[[Array], Array]:
        """Return the profile: (t,) times [s] -> (t,) factors."""
        make, needed, optional = _COURSES[self.kind]
        given = {name: getattr(self, name) for name in (*needed, *optional)}
        made: Callable[[Array], Array] = make(**{name: value for name, value in given.items() if value is not None})
        return made


# What each kind of course makes, what it needs for that, and what it may be given.
_COURSES: dict[str, tuple[Callable[..., Any], tuple[str, ...], tuple[str, ...]]] = {
    "constant": (Constant, (), ()),
    "ramp": (Ramp, ("duration",), ()),
    "smooth_ramp": (SmoothRamp, ("duration",), ()),
    "pulse": (Pulse, ("duration",), ()),
    "sine": (Sine, ("frequency",), ()),
    "tone_burst": (ToneBurst, ("frequency",), ("cycles",)),
}


def _check_positive(name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ShapeError(f"{name}: got {value}, expected a positive number of {unit}")
