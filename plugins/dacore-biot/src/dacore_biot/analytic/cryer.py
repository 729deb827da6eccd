"""A ball under pressure on its drained surface, whose centre's pressure rises before it falls (Cryer 1963).

Cryer, Quart. J. Mech. Appl. Math. 16 (1963), for incompressible constituents; here for all, from the
Laplace transform.
"""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium
from dacore_biot.analytic.roots import roots, terms


@dataclass(frozen=True)
class Cryer:
    """A ball pressed from all sides from t = 0 on, with p = 0 on its surface.

    Parameters
    ----------
    medium : Medium
    radius : float [cm]
    load : float [dyn/cm²]
        P, the total pressure on the surface.
    more : int
        Multiplies the number of terms: to see that they are enough.

    Notes
    -----
    D and G are the drained uniaxial and the shear modulus, K = D − 4G/3. The balance of forces gives
    D ∇·u = α p + f(t), that of mass p_t − c Δp = −g f_t with g = α c/(k D), k the mobility. With x = a √(s/c)
    and φ(x) = 1/3 − coth(x)/x + 1/x² the transforms are::

        f = −(P D/s)/(K + 4Gαg φ),        p = −g f [1 − a sinh(x r/a)/(r sinh x)]

    whose poles are s = 0 and s = −c r²/a² at the roots of (N + 1/3) r² + r cot r = 1, N = K/(4Gαg).
    """

    medium: Medium
    radius: float = 1.0
    load: float = 1.0e3
    more: int = 1

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise ShapeError(f"ball: got a radius of {self.radius} cm, expected a positive length")

    @property
    def time_scale(self) -> float:
        """a²/c [s]."""
        return self.radius**2 / self.medium.diffusivity

    @property
    def initial_pressure(self) -> float:
        """B · load, the pressure at t = 0+ [dyn/cm²]."""
        return self.medium.skempton * self.load

    def pressure(self, distance: Array, time: float) -> Array:
        """Pressure [dyn/cm²] at distances (n,) [cm] from the centre, time > 0 [s]."""
        r, weight = self._modes(time)
        # a sin(r d/a)/(d sin r), and r/sin r at the centre.
        ratio = np.sinc(np.outer(distance, r) / (np.pi * self.radius)) * (r / np.sin(r))
        scale = self.load * self.medium.uniaxial / (4 * self.medium.shear * self.medium.alpha)
        return np.asarray(scale * (1 - ratio) @ weight)

    def displacement(self, distance: Array, time: float) -> Array:
        """Radial displacement [cm] at distances (n,) [cm] from the centre, time > 0 [s]."""
        medium, a = self.medium, self.radius
        r, weight = self._modes(time)
        d = np.asarray(distance, dtype=np.float64)[:, None]
        z = d * r / a
        # ∫₀ᵈ (1 − a sin(rs/a)/(s sin r)) s² ds / d², by its limit d/3 · (1 − r/sin r) near the centre.
        small = z < 1e-3
        safe = np.where(small, 1.0, z)
        bulge = np.where(small, 1 / 3 - z**2 / 30, (np.sin(safe) - safe * np.cos(safe)) / safe**3)
        swelling = d * (1 / 3 - (r / np.sin(r)) * bulge)
        pressed = self.load * medium.uniaxial / (4 * medium.shear) * swelling @ weight
        common = -self.load * medium.uniaxial * (1 / medium.bulk + np.sum(weight) / (4 * medium.shear * self._drive))
        return np.asarray((pressed + common * d[:, 0] / 3) / medium.uniaxial)

    def settlement(self, time: float) -> float:
        """Radial displacement of the surface [cm]."""
        return float(self.displacement(np.full(1, self.radius), time)[0])

    @property
    def _drive(self) -> float:
        """αg = α²/(D S + α²), by way of the diffusivity."""
        medium = self.medium
        # c/k = 1/(S + α²/D); the ratio does not need k, which may be zero.
        nu, undrained = medium.nu, medium.undrained_nu
        capacity = (medium.alpha * (1 - 2 * nu)) ** 2 * (1 - undrained)
        capacity /= 2 * medium.shear * (1 - nu) * (undrained - nu)
        return medium.alpha**2 / (medium.uniaxial * capacity)

    def _modes(self, time: float) -> tuple[Array, Array]:
        """Roots r (n,) and 2 exp(−r² c t/a²)/(r φ'(r)), the derivative along the imaginary axis."""
        rate = time / self.time_scale
        n = self.medium.bulk / (4 * self.medium.shear * self._drive) + 1 / 3
        start = np.asarray(np.pi * np.arange(1, 1 + self.more * terms(np.pi**2 * rate)), dtype=np.float64)
        # One root in each (nπ, (n + 1)π), n = 0, 1, …; r = 0 is none, as 1/3 < N + 1/3.
        shift = 1e-4
        r = roots(lambda x: (n * x**2 - 1) * np.sin(x) + x * np.cos(x), start - np.pi + shift, start)
        slope = -1 / (r * np.sin(r) ** 2) - np.cos(r) / (r**2 * np.sin(r)) + 2 / r**3
        return r, 2 / (r * slope) * np.exp(-(r**2) * rate)
