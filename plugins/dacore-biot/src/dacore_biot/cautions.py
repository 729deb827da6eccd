"""What to beware of in a scene of poroelasticity, known before anything is solved.

The reasons and the measurements are in docs/hazards.md.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from dacore.core.arrays import Array
from dacore.core.mesh import Mesh
from dacore.core.parameters import ParameterSpace
from dacore.core.simplex import barycentric_gradients
from dacore_biot import material

_MATERIAL = ("E", "nu", "alpha", "skempton", "kappa", "viscosity")
LOCKING = 0.49
"""Poisson ratio from which errors of displacements of order 1 are more than four times those at 0.4."""


def cell_sizes(mesh: Mesh) -> Array:
    """Edge lengths h_K (c,) of regular simplices whose heights have the cells' sum of inverse squares."""
    gradients = barycentric_gradients(mesh.points, mesh.cells)[0]
    return np.asarray(np.sqrt(2 * mesh.dim / np.einsum("cki,cki->c", gradients, gradients)))


@dataclass(frozen=True)
class Oscillation:
    """Pressures oscillate from node to node on equal-order elements if too little fluid seeps in a step.

    Confined tissue holds ``α²/(λ + 2μ_s) ∫ Π₀ṗ Π₀q + S ∫ ṗ q + κ/μ_f ∫ ∇p·∇q`` (`dacore_biot.stabilization`). On a
    regular simplex of edge h the entries between two of its corners are not positive, so that a step keeps the
    bounds of its data, exactly if::

        (κ/μ_f)/c  ≥  h²/2 · (α²/(λ + 2μ_s)/(d + 1) + S/(d + 2))

    with c the factor of rates in the step, 1/τ for backward Euler; in one dimension without S it is the
    κτ/μ_f ≥ h²/(4(λ + 2μ_s)) of Rodrigo et al. 2016.

    Parameters
    ----------
    dim : int
    size : float [cm]
        The median of `cell_sizes`.
    stiffness : (float, float)
        The smallest and the largest factor of E anywhere.
    """

    dim: int
    size: float
    stiffness: tuple[float, float] = (1.0, 1.0)

    def ratio(self, theta: dict[str, float], lag: float) -> float:
        """Left side over right side at parameters θ, with `lag` = 1/c [s]."""
        swelling, storage = material.confined_swelling(theta), material.storage(theta)
        needed = 0.5 * self.size**2 * (swelling / (self.dim + 1) + storage / (self.dim + 2))
        return material.mobility(theta) * lag / needed

    def __call__(self, parameters: ParameterSpace, lag: float) -> str:
        """Return the warning for the ranges of `parameters`, or nothing."""
        ends = product(*({parameters[name].low, parameters[name].high} for name in _MATERIAL))
        at = [dict(zip(_MATERIAL, values, strict=True)) for values in ends]
        ratios = [self.ratio(theta | {"E": theta["E"] * s}, lag) for theta in at for s in set(self.stiffness)]
        if min(ratios) >= 1:
            return ""
        least, most = f"{min(ratios):.1g}", f"{max(ratios):.1g}"
        seeps = least if least == most else f"{least} to {most}"
        return (
            f"pressure may oscillate from node to node: u and p have order 1, and what seeps in a step is {seeps} of "
            f"what keeps it smooth on cells of {self.size:.2g} cm (expected 1 or more); set physics.stabilization, or "
            "physics.displacement_order = 2 (docs/hazards.md)"
        )


def locking(parameters: ParameterSpace, lag: float) -> str:
    """Return the warning for displacements of order 1 in nearly incompressible tissue, or nothing."""
    if parameters["nu"].high < LOCKING:
        return ""
    return (
        f"displacements are too small: they have order 1 and nu goes up to {parameters['nu'].high:g} (expected below "
        f"{LOCKING:g}); set physics.displacement_order = 2 (docs/hazards.md)"
    )
