"""A column shaken at one frequency, with inertia, seepage and compressible constituents.

The one-dimensional problem of Zienkiewicz, Chang & Bettess, Géotechnique 30 (1980), in their u–p form: the
fluid's inertia relative to the solid is left out, as in the model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium


@dataclass(frozen=True)
class Column:
    """A column that cannot widen, fixed and tight at x = 0, drained and pulled by load · cos(ωt) at x = height.

    Parameters
    ----------
    medium : Medium
        With αB < 1 and kappa > 0.
    frequency : float [Hz]
    height : float [cm]
    load : float [dyn/cm²]
    loss : float
        Loss factor η of the drained skeleton.

    Notes
    -----
    With u = Re(û e^{iωt}), D the drained uniaxial modulus times 1 + iη and k the mobility::

        −ρω² û − D û'' + α p̂' = 0,        iω S p̂ + iω α û' − k p̂'' = 0

    is solved by û = Σ A sinh(m x), p̂ = Σ A (ρω² + D m²)/(α m) cosh(m x) over the two m², of which
    D k m⁴ + (ρω² k − iω(DS + α²)) m² − iω³ρS = 0: the fast wave and the slow one, which diffuses.
    """

    medium: Medium
    frequency: float
    height: float = 1.0
    load: float = 1.0e3
    loss: float = 0.0

    def __post_init__(self) -> None:
        medium = self.medium
        if not (self.frequency > 0 and self.height > 0):
            raise ShapeError(f"column: got {self.frequency} Hz and {self.height} cm, expected positive numbers")
        if not 0 <= self.loss < np.inf:
            raise ShapeError(f"column: got the loss {self.loss}, expected a number, zero or more")
        if not (np.isfinite(medium.undrained_bulk) and medium.kappa > 0):
            raise ShapeError("column: expected alpha · skempton < 1 and kappa > 0, or there are no two waves")

    @property
    def omega(self) -> float:
        """ω = 2πf [1/s]."""
        return 2 * np.pi * self.frequency

    @property
    def modulus(self) -> complex:
        """D [dyn/cm²]: uniaxial, drained, complex where there is a loss."""
        return complex(self.medium.uniaxial * (1 + 1j * self.loss))

    @property
    def wave_numbers(self) -> NDArray[np.complex128]:
        """Wave numbers m (2,) [1/cm] of the fast and the slow wave, with positive real parts."""
        medium, omega = self.medium, self.omega
        stiff, k, inertia = self.modulus, medium.mobility, medium.density * self.omega**2
        storage = medium.alpha**2 / (medium.undrained_bulk - medium.bulk)
        middle = inertia * k - 1j * omega * (stiff * storage + medium.alpha**2)
        squares = np.roots([stiff * k, middle, -1j * omega * inertia * storage])
        m = np.sqrt(squares[np.argsort(np.abs(squares))].astype(np.complex128))
        return np.asarray(np.where(m.real < 0, -m, m))

    def displacement(self, x: Array) -> NDArray[np.complex128]:
        """Complex amplitude û [cm] at x (n,) [cm]."""
        return np.asarray(self._shapes(x, -1.0) @ self._weights)

    def pressure(self, x: Array) -> NDArray[np.complex128]:
        """Complex amplitude p̂ [dyn/cm²] at x (n,) [cm]."""
        return np.asarray(self._shapes(x, 1.0) @ (self._weights * self._ratios))

    @property
    def _ratios(self) -> NDArray[np.complex128]:
        m, medium = self.wave_numbers, self.medium
        return np.asarray((medium.density * self.omega**2 + self.modulus * m**2) / (medium.alpha * m))

    @property
    def _weights(self) -> NDArray[np.complex128]:
        """A (2,): p̂ = 0 and D û' = load at x = height, the shapes being scaled to cosh(m height)."""
        return np.asarray(np.linalg.solve(np.stack([self._ratios, self.modulus * self.wave_numbers]), [0.0, self.load]))

    def _shapes(self, x: Array, sign: float) -> NDArray[np.complex128]:
        """Return cosh(m x)/cosh(m height) for sign = 1, sinh(m x)/cosh(m height) for −1, without overflow: (n, 2)."""
        m, x = self.wave_numbers, np.asarray(x)[:, None]
        grown = np.exp(m * (x - self.height)) * (1 + sign * np.exp(-2 * m * x))
        return np.asarray(grown / (1 + np.exp(-2 * m * self.height)))
