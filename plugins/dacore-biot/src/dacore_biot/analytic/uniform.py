"""Undrained and drained bodies under a uniform stress or their own weight.

Rice & Cleary, Rev. Geophys. 14 (1976); Wang, Theory of Linear Poroelasticity (2000), chapters 2 and 3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dacore.core.arrays import Array, as_array
from dacore.errors import ShapeError
from dacore_biot.analytic.medium import Medium


@dataclass(frozen=True, eq=False)
class Uniform:
    """A uniform state.

    Parameters
    ----------
    strain : (d, d) array
    pressure : float [dyn/cm²]
    """

    strain: Array
    pressure: float

    def displacement(self, points: Array) -> Array:
        """Displacement (n, d) [cm] at points (n, d) [cm], zero at the origin and without rotation."""
        return np.asarray(points @ self.strain)


def undrained(medium: Medium, stress: ArrayLike) -> Uniform:
    """Return the state at once after a total stress (d, d) [dyn/cm²] was put on: p = −B σ_kk/3.

    For d = 2 the strain is plane, and the stress across the plane is ν_u (σ_xx + σ_yy).
    """
    tensor = _tensor(stress)
    strain, total = _hooke(tensor, medium.shear, medium.undrained_nu)
    return Uniform(strain, -medium.skempton * total / 3)


def drained(medium: Medium, stress: ArrayLike) -> Uniform:
    """Return the state long after a total stress (d, d) [dyn/cm²] was put on, where p has gone."""
    return Uniform(_hooke(_tensor(stress), medium.shear, medium.nu)[0], 0.0)


@dataclass(frozen=True)
class SunkColumn:
    """A column that cannot widen, on a fixed and tight ground, whose weight comes at t = 0; before anything seeps.

    Parameters
    ----------
    medium : Medium
        With αB < 1.
    height : float [cm]
    gravity : float [cm/s²]
    """

    medium: Medium
    height: float = 1.0
    gravity: float = 981.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.medium.undrained_bulk):
            raise ShapeError(
                "column: got alpha · skempton = 1, expected a compressible medium, which can sink undrained"
            )

    def pressure(self, x: Array) -> Array:
        """Pressure γ ρ g (h − x) [dyn/cm²] at heights x (n,) [cm]."""
        weight = self.medium.density * self.gravity * (self.height - np.asarray(x))
        return np.asarray(self.medium.loading_efficiency * weight)

    def displacement(self, x: Array) -> Array:
        """Displacement u = −ρ g x (h − x/2)/(K_u + 4G/3) [cm], upwards, at heights x (n,) [cm]."""
        x = np.asarray(x)
        lever = x * (self.height - x / 2)
        return np.asarray(-self.medium.density * self.gravity * lever / self.medium.undrained_uniaxial)


def _tensor(stress: ArrayLike) -> Array:
    tensor = as_array("stress", stress, (None, None))
    if tensor.shape not in ((2, 2), (3, 3)) or not np.array_equal(tensor, tensor.T):
        raise ShapeError(f"stress: got shape {tensor.shape}, expected a symmetric (2, 2) or (3, 3) array")
    return tensor


def _hooke(stress: Array, shear: float, nu: float) -> tuple[Array, float]:
    """Strain of a stress, and the trace of the stress in all three directions."""
    dim = len(stress)
    total = float(np.trace(stress)) * (1 + nu if dim == 2 else 1)
    return (stress - nu / (1 + nu) * total * np.eye(dim)) / (2 * shear), total
