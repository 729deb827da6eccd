"""A block between rigid plates, whose pressure rises before it falls (Mandel 1953).

Abousleiman, Cheng, Cui, Detournay & Roegiers, "Mandel's problem revisited", Géotechnique 46 (1996);
Cheng & Detournay, Int. J. Numer. Anal. Methods Geomech. 12 (1988).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium
from dacore_biot.analytic.roots import roots, terms


@dataclass(frozen=True)
class Mandel:
    """A long block |x| < a, |y| < b in plane strain, squeezed along y by plates without friction.

    The sides x = ±a are drained and free; the plates at y = ±b are rigid and tight. The origin is the centre.

    Parameters
    ----------
    medium : Medium
    half_width, half_height : float [cm]
        a and b.
    force : float [dyn/cm]
        F, from t = 0 on: half of what each plate is pressed with, per length of the block.
    more : int
        Multiplies the number of terms: to see that they are enough.

    Notes
    -----
    Sums are over the positive roots of tan r = r (1 − ν)/(ν_u − ν), with D = r − sin r cos r and e = exp(−r² c t/a²)::

        p   = (2FB(1 + ν_u)/(3a)) Σ (sin r/D) (cos(r x/a) − cos r) e
        u_x = (F/(Ga)) [ν/2 − ν_u Σ (sin r cos r/D) e] x + (F/G) Σ (cos r/D) sin(r x/a) e
        u_y = (F/(Ga)) [−(1 − ν)/2 + (1 − ν_u) Σ (sin r cos r/D) e] y
    """

    medium: Medium
    half_width: float = 1.0
    half_height: float = 1.0
    force: float = 1.0e3
    more: int = 1

    def __post_init__(self) -> None:
        if not (self.half_width > 0 and self.half_height > 0):
            raise ShapeError(
                f"block: got half widths of {self.half_width} and {self.half_height} cm, expected positive lengths"
            )
        if not self.medium.undrained_nu > self.medium.nu:
            raise ShapeError("block: the undrained Poisson ratio is the drained one; expected alpha · skempton > 0")

    @property
    def time_scale(self) -> float:
        """a²/c [s]."""
        return self.half_width**2 / self.medium.diffusivity

    @property
    def initial_pressure(self) -> float:
        """FB(1 + ν_u)/(3a), the pressure at t = 0+ [dyn/cm²]."""
        medium = self.medium
        return self.force * medium.skempton * (1 + medium.undrained_nu) / (3 * self.half_width)

    def pressure(self, x: Array, time: float) -> Array:
        """Pressure [dyn/cm²] at x (n,) [cm], time > 0 [s]; the same for all y."""
        r, weight = self._modes(time)
        shape = np.cos(np.outer(x, r) / self.half_width) - np.cos(r)
        return np.asarray(2 * self.initial_pressure * shape @ (np.sin(r) * weight))

    def displacement(self, x: Array, y: Array, time: float) -> Array:
        """Displacement (n, 2) [cm] at x (n,) and y (n,) [cm], time > 0 [s]."""
        medium, a = self.medium, self.half_width
        r, weight = self._modes(time)
        mean = np.sum(np.sin(r) * np.cos(r) * weight)
        along = (medium.nu / 2 - medium.undrained_nu * mean) / a * np.asarray(x)
        along = along + np.sin(np.outer(x, r) / a) @ (np.cos(r) * weight)
        across = (-(1 - medium.nu) / 2 + (1 - medium.undrained_nu) * mean) / a * np.asarray(y)
        return np.asarray(self.force / medium.shear * np.stack([along, across], axis=1))

    def plate(self, time: float) -> float:
        """Displacement u_y of the plate at y = b [cm], time > 0 [s]."""
        return float(self.displacement(np.zeros(1), np.full(1, self.half_height), time)[0, 1])

    def stress(self, x: Array, time: float) -> Array:
        """Total stress σ_yy [dyn/cm²] under the plates at x (n,) [cm], time > 0 [s]; its mean is −F/a."""
        medium, a = self.medium, self.half_width
        r, weight = self._modes(time)
        ratio = (medium.undrained_nu - medium.nu) / (1 - medium.nu)
        wavy = np.cos(np.outer(x, r) / a) @ (np.sin(r) * weight)
        return np.asarray(self.force / a * (-1 - 2 * ratio * wavy + 2 * np.sum(np.sin(r) * np.cos(r) * weight)))

    @cached_property
    def _ratio(self) -> float:
        return (1 - self.medium.nu) / (self.medium.undrained_nu - self.medium.nu)

    def _modes(self, time: float) -> tuple[Array, Array]:
        """Roots r (n,) and exp(−r² c t/a²)/(r − sin r cos r)."""
        rate = time / self.time_scale
        start = np.asarray(np.pi * np.arange(self.more * terms(np.pi**2 * rate)), dtype=np.float64)
        # Between nπ and (n + 1/2)π; the first one is not the root r = 0.
        low = start + np.where(start == 0, 1e-9, 0.0)
        r = roots(lambda x: np.cos(x - start) * self._ratio * x - np.sin(x - start), low, start + np.pi / 2)
        return r, np.exp(-(r**2) * rate) / (r - np.sin(r) * np.cos(r))
