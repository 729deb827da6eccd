"""A pulse that runs through a bar, is thrown back at its ends, and runs on (d'Alembert 1747)."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import Profile
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium


@dataclass(frozen=True)
class Pulse:
    """The traction load · sin⁴(π t/duration), over at t = duration; three times differentiable.

    Parameters
    ----------
    load : float [dyn/cm²]
        Pull at the peak.
    duration : float [s]
    """

    load: float
    duration: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.load) and self.duration > 0):
            raise ShapeError(f"pulse: got {self.load} for {self.duration} s, expected numbers, the latter positive")

    def __call__(self, times: Array) -> Array:
        """Traction [dyn/cm²] at times (t,) [s]."""
        angle = np.pi * np.clip(np.asarray(times) / self.duration, 0.0, 1.0)
        return np.asarray(self.load * np.sin(angle) ** 4)

    def impulse(self, times: Array) -> Array:
        """∫ traction [dyn s/cm²] up to times (t,) [s]."""
        angle = np.pi * np.clip(np.asarray(times) / self.duration, 0.0, 1.0)
        integral = 3 * angle / 8 - np.sin(2 * angle) / 4 + np.sin(4 * angle) / 32
        return np.asarray(self.load * self.duration / np.pi * integral)


@dataclass(frozen=True)
class Wave:
    """A bar that cannot widen, pulled at x = length by a pulse; fixed or free at x = 0.

    Drained (p = 0 everywhere: a dry bar) it carries waves of speed √((λ + 2μ)/ρ). Where no fluid seeps it is
    stiffer by α²/S, and p = −(α/S) ∂u/∂x: the fast wave of Biot (1956) in the limit of low frequency.

    Parameters
    ----------
    medium : Medium
    pulse : Pulse
    length : float [cm]
    undrained : bool
    fixed : bool
        Whether u = 0 at x = 0; free of traction there otherwise.
    """

    medium: Medium
    pulse: Pulse
    length: float = 1.0
    undrained: bool = False
    fixed: bool = True

    def __post_init__(self) -> None:
        if not self.length > 0:
            raise ShapeError(f"bar: got a length of {self.length} cm, expected a positive length")
        if not np.isfinite(self.modulus):
            raise ShapeError("bar: got alpha · skempton = 1 undrained, expected a compressible medium")

    @property
    def modulus(self) -> float:
        """Uniaxial modulus [dyn/cm²]."""
        return self.medium.undrained_uniaxial if self.undrained else self.medium.uniaxial

    @property
    def speed(self) -> float:
        """Speed c [cm/s] of the wave."""
        return float(np.sqrt(self.modulus / self.medium.density))

    def displacement(self, x: Array, time: float) -> Array:
        """Displacement [cm] at x (n,) [cm]."""
        return np.asarray(self._sum(x, time, self.pulse.impulse, False) * self.speed / self.modulus)

    def velocity(self, x: Array, time: float) -> Array:
        """Velocity [cm/s] at x (n,) [cm]."""
        return np.asarray(self._sum(x, time, self.pulse, False) * self.speed / self.modulus)

    def strain(self, x: Array, time: float) -> Array:
        """∂u/∂x at x (n,) [cm]."""
        return np.asarray(self._sum(x, time, self.pulse, True) / self.modulus)

    def pressure(self, x: Array, time: float) -> Array:
        """Pressure −(α/S) ∂u/∂x [dyn/cm²] at x (n,) [cm], undrained; zero otherwise."""
        if not self.undrained:
            return np.zeros(len(x))
        medium = self.medium
        return np.asarray(-(medium.undrained_bulk - medium.bulk) / medium.alpha * self.strain(x, time))

    def _sum(self, x: Array, time: float, shape: Profile, slope: bool) -> Array:
        """Sum the wave from x = length and all its images: each end throws it back, the fixed one turned over."""
        x, total, n = np.asarray(x, dtype=np.float64), np.zeros(len(x)), 0
        turned = -1.0 if self.fixed else 1.0
        while time - (2 * n * self.length) / self.speed > 0:
            far = (2 * n + 1) * self.length
            down, up = shape(time - (far - x) / self.speed), shape(time - (far + x) / self.speed)
            total = total + turned**n * (down + (-turned if slope else turned) * up)
            n += 1
        return total
