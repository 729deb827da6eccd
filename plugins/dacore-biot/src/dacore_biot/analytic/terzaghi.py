"""Consolidation of a column (Terzaghi 1923).

Wang, Theory of Linear Poroelasticity (2000), chapter 6; compressible constituents allowed.
"""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium
from dacore_biot.analytic.roots import terms


@dataclass(frozen=True)
class Terzaghi:
    """A column that cannot widen, loaded at t = 0 on its drained end; the other end is fixed and tight.

    Parameters
    ----------
    medium : Medium
    height : float [cm]
    load : float [dyn/cm²]
        Total compressive stress, from t = 0 on.
    more : int
        Multiplies the number of terms: to see that they are enough.

    Notes
    -----
    With depth z from the drained end, M = (2m + 1)π/2, p₀ = γ · load and D the drained uniaxial modulus::

        p = p₀ Σ (2/M) sin(M z/h) exp(−M² c t/h²)
        u = load (h − z)/D − (α p₀ h/D) Σ (2/M²) cos(M z/h) exp(−M² c t/h²)
    """

    medium: Medium
    height: float = 1.0
    load: float = 1.0e3
    more: int = 1

    def __post_init__(self) -> None:
        if not self.height > 0:
            raise ShapeError(f"column: got a height of {self.height} cm, expected a positive length")

    @property
    def time_scale(self) -> float:
        """h²/c [s]."""
        return self.height**2 / self.medium.diffusivity

    @property
    def initial_pressure(self) -> float:
        """p₀, the pressure at t = 0+ [dyn/cm²]."""
        return self.medium.loading_efficiency * self.load

    def pressure(self, depth: Array, time: float) -> Array:
        """Pressure [dyn/cm²] at depths (n,) [cm] below the drained end, time > 0 [s]."""
        m, decay = self._modes(time)
        return np.asarray(self.initial_pressure * np.sin(np.outer(depth, m) / self.height) @ (2 / m * decay))

    def displacement(self, depth: Array, time: float) -> Array:
        """Displacement [cm] away from the loaded end at depths (n,) [cm], time > 0 [s]."""
        m, decay = self._modes(time)
        held_back = np.cos(np.outer(depth, m) / self.height) @ (2 / m**2 * decay)
        drained = self.load * (self.height - np.asarray(depth))
        lifted = self.medium.alpha * self.initial_pressure * self.height * held_back
        return np.asarray((drained - lifted) / self.medium.uniaxial)

    def settlement(self, time: float) -> float:
        """Displacement of the loaded end [cm]."""
        return float(self.displacement(np.zeros(1), time)[0])

    def _modes(self, time: float) -> tuple[Array, Array]:
        rate = time / self.time_scale
        m = np.asarray((np.arange(self.more * terms(np.pi**2 * rate)) + 0.5) * np.pi, dtype=np.float64)
        return m, np.exp(-(m**2) * rate)
