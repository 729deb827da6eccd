"""The coefficients of a poroelastic medium, by way of its undrained Poisson ratio.

Detournay & Cheng, "Fundamentals of poroelasticity", in Comprehensive Rock Engineering II (1993);
Wang, Theory of Linear Poroelasticity (2000), chapters 2 and 3.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from dacore.errors import ShapeError


@dataclass(frozen=True)
class Medium:
    """A homogeneous, isotropic poroelastic medium.

    Parameters
    ----------
    E : float [dyn/cm²]
        Young's modulus of the drained skeleton.
    nu : float
        Its Poisson ratio.
    alpha, skempton : float
        Coefficients of Biot–Willis (α) and Skempton (B), with αB <= 1.
    kappa : float [cm²]
    viscosity : float [P]
    density : float [g/cm³]

    Raises
    ------
    ShapeError
        If a value is not physical.
    """

    E: float = 1.0e5
    nu: float = 0.2
    alpha: float = 0.8
    skempton: float = 0.7
    kappa: float = 1.0e-7
    viscosity: float = 1.0e-2
    density: float = 1.0

    def __post_init__(self) -> None:
        if not np.isfinite(list(asdict(self).values())).all():
            raise ShapeError(f"medium: got {self}, expected finite numbers")
        positive = {name: getattr(self, name) for name in ("E", "alpha", "skempton", "viscosity", "density")}
        if wrong := [f"{name} = {value:g}" for name, value in positive.items() if value <= 0]:
            raise ShapeError(f"medium: got {', '.join(wrong)}, expected positive numbers")
        if not (-1 < self.nu < 0.5 and max(self.alpha, self.skempton) <= 1 and self.kappa >= 0):
            raise ShapeError(
                f"medium: got nu = {self.nu:g}, alpha = {self.alpha:g}, skempton = {self.skempton:g}, kappa = "
                f"{self.kappa:g}, expected -1 < nu < 1/2, alpha and skempton up to 1, kappa >= 0"
            )

    @property
    def parameters(self) -> Mapping[str, float]:
        """The values by the names the model knows them by."""
        return asdict(self)

    @property
    def shear(self) -> float:
        """G [dyn/cm²]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def bulk(self) -> float:
        """K of the drained skeleton [dyn/cm²]."""
        return self.E / (3 * (1 - 2 * self.nu))

    @property
    def undrained_bulk(self) -> float:
        """K_u = K/(1 − αB) [dyn/cm²]; infinite if nothing is compressible."""
        rest = 1 - self.alpha * self.skempton
        return self.bulk / rest if rest else float("inf")

    @property
    def undrained_nu(self) -> float:
        """ν_u = (3ν + αB(1 − 2ν))/(3 − αB(1 − 2ν))."""
        part = self.alpha * self.skempton * (1 - 2 * self.nu)
        return (3 * self.nu + part) / (3 - part)

    @property
    def uniaxial(self) -> float:
        """K + 4G/3 [dyn/cm²]: the drained modulus of a column that cannot widen."""
        return self.bulk + 4 * self.shear / 3

    @property
    def undrained_uniaxial(self) -> float:
        """K_u + 4G/3 [dyn/cm²]; infinite if nothing is compressible."""
        return self.undrained_bulk + 4 * self.shear / 3

    @property
    def loading_efficiency(self) -> float:
        """Loading efficiency γ = B(1 + ν_u)/(3(1 − ν_u)): pressure per total stress on a column that cannot widen."""
        return self.skempton * (1 + self.undrained_nu) / (3 * (1 - self.undrained_nu))

    @property
    def mobility(self) -> float:
        """κ/μ_f [cm⁴/(dyn s)]."""
        return self.kappa / self.viscosity

    @property
    def diffusivity(self) -> float:
        """Diffusivity c = (κ/μ_f) 2G(1 − ν)(ν_u − ν)/(α²(1 − 2ν)²(1 − ν_u)) [cm²/s]."""
        nu, undrained = self.nu, self.undrained_nu
        stiffness = 2 * self.shear * (1 - nu) * (undrained - nu)
        return self.mobility * stiffness / ((self.alpha * (1 - 2 * nu)) ** 2 * (1 - undrained))
