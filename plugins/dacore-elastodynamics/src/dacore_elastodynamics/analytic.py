"""Motions by formula, to verify models with. Source: Graff, Wave Motion in Elastic Solids (1975), chapters 2 and 5."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError


@dataclass(frozen=True)
class StandingWave:
    """One mode of a layer that is held at x = 0 and free at x = L: of shear across, or of compression along x.

    ``u = sin(k x) exp(−d t) (cos ω_d t + d/ω_d sin ω_d t)`` with k = (m + ½) π/L, ω = k · speed, d = (a + b ω²)/2 and
    ω_d = √(ω² − d²); it starts from rest.

    Parameters
    ----------
    length, speed : float [cm], [cm/s]
    number : int
        m.
    mass_damping, stiffness_damping : float [1/s], [s]
        a and b of Rayleigh's damping.

    Raises
    ------
    ShapeError
        If the mode is damped so much that it does not swing.
    """

    length: float
    speed: float
    number: int = 0
    mass_damping: float = 0.0
    stiffness_damping: float = 0.0

    def __post_init__(self) -> None:
        if not self.damping < self.frequency:
            raise ShapeError(
                f"standing wave: damping {self.damping:g}/s is not below {self.frequency:g}/s; it cannot swing"
            )

    @property
    def wavenumber(self) -> float:
        """Wave number k [1/cm]."""
        return float((self.number + 0.5) * np.pi / self.length)

    @property
    def frequency(self) -> float:
        """Angular frequency ω [1/s], without damping."""
        return self.wavenumber * self.speed

    @property
    def damping(self) -> float:
        """Rate d [1/s] at which the amplitude falls."""
        return 0.5 * (self.mass_damping + self.stiffness_damping * self.frequency**2)

    @property
    def swing(self) -> float:
        """Angular frequency ω_d [1/s] with damping."""
        return float(np.sqrt(self.frequency**2 - self.damping**2))

    def shape(self, x: Array) -> Array:
        """Values (n,) at x (n,) [cm]."""
        return np.asarray(np.sin(self.wavenumber * np.asarray(x)))

    def course(self, times: Array) -> Array:
        """Factors (t,) at times (t,) [s], one at t = 0."""
        t = np.asarray(times)
        turn = np.cos(self.swing * t) + self.damping / self.swing * np.sin(self.swing * t)
        return np.asarray(np.exp(-self.damping * t) * turn)

    def displacement(self, x: Array, times: Array) -> Array:
        """Values (n, t) of the component that moves."""
        return np.outer(self.shape(x), self.course(times))


def stretched(traction: float, young: float, nu: float, dim: int) -> Array:
    """Strain (d, d) of a body that is pulled along its first axis by a traction, its sides free.

    In two dimensions the strain is plane.
    """
    along = (1 - nu**2 if dim == 2 else 1.0) * traction / young
    across = -(nu * (1 + nu) if dim == 2 else nu) * traction / young
    return np.diag([along, *[across] * (dim - 1)])
