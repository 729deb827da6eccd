"""Dynamic poroelasticity of the brain, as a scene asks for it."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from dacore.core.arrays import BoolArray
from dacore.core.discretization import Discretization
from dacore.core.model import AffineModel, Discretize, Load
from dacore.dynamics.profiles import Constant, Sine, SmoothRamp
from dacore.errors import ShapeError
from dacore_biot.tissue import Tissue


@dataclass(frozen=True)
class Biot(Tissue):
    """Displacement u [cm] and pressure p [dyn/cm²] of a fluid-filled elastic tissue, in cgs.

    The tissue is held at the neck, pulsates under a traction on its outside, and has given fluid
    pressures outside and in the ventricles. Without ranges of its own the model is that of the
    paper (section 4).

    Parameters
    ----------
    displacement_order : {1, 2}
        Elements of u; p has order 1. Order 2 gives Taylor–Hood elements.
    stabilization : {"none", "lumped", "projected"}
        Remedy of `dacore_biot.stabilization` for pressures that oscillate from node to node. "none" is the method of
        the paper, "projected" comes near Taylor–Hood elements, "lumped" keeps the bounds of slow consolidation
        and slows waves of compression.
    alpha, skempton, density, viscosity, p_csf : float
        Biot–Willis and Skempton coefficients, density of the tissue [g/cm³], viscosity of the fluid [P],
        pressure outside [dyn/cm²].
    xi, frequency, pulse_axis : float, float, int
        The traction ``xi sin(2π · frequency · t) s`` [dyn/cm²] on `mre` points along `pulse_axis`;
        s falls linearly from 1 at the lowest coordinate of the mesh (the back) to 0 at the highest.
    ramp : float
        Time [s] over which the boundary pressures and the neck's displacement rise, smoothly, from zero;
        0 lets them jump.
    pressure_on_neck : {"none", "csf"}
        No flux through the neck, or the outer pressure there.
    neck_displacement : float
        Displacement [cm] of the whole neck, constant in time: a wrong boundary condition to study.
    neck_direction : tuple of float
        Components of u at the neck for each cm of `neck_displacement`; empty: 1 for every component.
    inclusions : tuple of Inclusion
        Balls of another stiffness than the rest; where they overlap the last one counts.
    rollers : mapping of str to tuple of int
        Components of u that are zero on other roles, or on `mre`: a plane of symmetry or a smooth wall across
        an axis. On a role that is none of the three the flux is zero.
    neck, ventricles, mre : str
        Roles of the boundary. Empty `ventricles` is a domain without them; p_ventricles is then no parameter.
    ranges : mapping of str to (low, high)
        Ranges of parameters in place of the defaults; low = high fixes one. Parameters are kappa
        [cm²], E [dyn/cm²], nu, p_ventricles, p_csf and xi [dyn/cm²], density, alpha, skempton,
        viscosity and neck_displacement.
    log_uniform : tuple of str
        Parameters to sample uniformly in their logarithm.

    Raises
    ------
    ShapeError
        If a value or range is not physical, or a name is unknown.
    """

    ramp: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.ramp < np.inf:
            raise ShapeError(f"ramp: got {self.ramp}, expected 0 (a jump) or a positive number of seconds")
        super().__post_init__()

    def build(self, discretize: Discretize) -> AffineModel:
        """Assemble the matrices and the loads on a mesh.

        Raises
        ------
        MeshError
            If the mesh lacks a role, or has a boundary that is none of these.
        """
        return self.assemble(discretize)

    def _loads(self, discretization: Discretization, held: Mapping[str, BoolArray]) -> tuple[Load, ...]:
        none, rise = np.zeros(discretization.layout.n_dofs), SmoothRamp(self.ramp) if self.ramp else Constant()
        pulse = Load("pulse", itemgetter("xi"), Sine(self.frequency), self._traction(discretization), none)
        csf = Load("csf", itemgetter("p_csf"), rise, none, held["csf"].astype(np.float64))
        neck = Load("neck", itemgetter("neck_displacement"), rise, none, self._moved(discretization, held["neck"]))
        if not self.ventricles:
            return pulse, csf, neck
        ventricles = Load("ventricles", itemgetter("p_ventricles"), rise, none, held["ventricles"].astype(np.float64))
        return pulse, csf, ventricles, neck
