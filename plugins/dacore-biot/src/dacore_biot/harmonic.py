"""Poroelasticity of the brain at one frequency: amplitudes and phases, as elastography measures them."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.discretization import Discretization
from dacore.core.model import Discretize, Load
from dacore.core.parameters import Parameters
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.profiles import Cosine, Sine
from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.tissue import FIXED, SAMPLED, Tissue

# What is elastic, and loses energy where the tissue has a loss factor.
_ELASTIC = ("shear", "dilation")
_PHASES = {"phase_xi": "rad", "phase_csf": "rad", "phase_ventricles": "rad"}


@dataclass(frozen=True)
class BiotHarmonic(Tissue):
    """Displacement and pressure of a fluid-filled tissue that vibrates at one frequency, with damping.

    u(t) = Re(û e^{iωt}), and the same for p: what is left of the motion of `dacore_biot.model.Biot` once it repeats
    itself, less all that does not move. The trajectory has two states, Re ŷ at t = 0 and −Im ŷ at a quarter of the
    period (`dacore.dynamics.harmonic`). A load of amplitude a and phase φ [rad] is a cos(ωt + φ): positive phases are
    early. The equations are linear, so static pressures change nothing, and all pressures here are amplitudes.

    Parameters
    ----------
    displacement_order, stabilization, alpha, skempton, density, viscosity, pulse_axis
        As in `dacore_biot.model.Biot`.
    pressure_on_neck, neck_direction, inclusions, rollers, neck, ventricles, mre
        As there.
    frequency : float [Hz]
    xi, phase_xi : float
        Amplitude [dyn/cm²] and phase of the traction on `mre`.
    p_csf, phase_csf : float
        Amplitude [dyn/cm²] and phase of the outer pressure.
    phase_ventricles : float
        Phase of the ventricular pressure.
    neck_displacement : float
        Amplitude [cm] of the whole neck's motion, in phase 0.
    tolerance : float
        Relative residual of every solve.
    ranges : mapping of str to (low, high)
        Ranges of parameters in place of the defaults; low = high fixes one. Parameters are those of `Biot`, the
        pressures, the traction and the neck's displacement being amplitudes, and the phases [rad] and `loss`, the
        factor η of E(1 + iη). p_ventricles is sampled in [0, 500] dyn/cm², the size of the traction, and loss in
        [0.2, 0.6]; 0 is a tissue that loses energy by seepage only.
    log_uniform : tuple of str
        Parameters to sample uniformly in their logarithm.

    Raises
    ------
    ShapeError
        If a value or range is not physical, or a name is unknown.
    """

    p_csf: float = 0.0
    phase_xi: float = 0.0
    phase_csf: float = 0.0
    phase_ventricles: float = 0.0
    tolerance: float = 1e-10

    _sampled: ClassVar[Mapping[str, tuple[str, tuple[float, float]]]] = SAMPLED | {
        "p_ventricles": ("dyn/cm^2", (0.0, 500.0)),
        "loss": ("1", (0.2, 0.6)),
    }
    _fixed: ClassVar[Mapping[str, str]] = FIXED | _PHASES

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise ShapeError(f"tolerance: got {self.tolerance}, expected a number between 0 and 1, such as 1e-10")
        super().__post_init__()

    def build(self, discretize: Discretize) -> HarmonicModel:
        """Assemble the matrices and the loads on a mesh.

        Raises
        ------
        MeshError
            If the mesh lacks a role, or has a boundary that is none of these.
        """
        losses = dict.fromkeys(_ELASTIC, material.loss)
        return HarmonicModel(self.assemble(discretize), self.frequency, losses, tolerance=self.tolerance)

    def _loads(self, discretization: Discretization, held: Mapping[str, BoolArray]) -> tuple[Load, ...]:
        none = np.zeros(discretization.layout.n_dofs)
        loads = [
            *self._oscillating("pulse", "xi", "phase_xi", self._traction(discretization), none),
            *self._oscillating("csf", "p_csf", "phase_csf", none, held["csf"].astype(np.float64)),
        ]
        if self.ventricles:
            inside = held["ventricles"].astype(np.float64)
            loads += self._oscillating("ventricles", "p_ventricles", "phase_ventricles", none, inside)
        moved = self._moved(discretization, held["neck"])
        return *loads, Load("neck", itemgetter("neck_displacement"), Cosine(self.frequency), none, moved)

    def _oscillating(self, name: str, size: str, phase: str, force: Array, prescribed: Array) -> list[Load]:
        """Return what pushes as a cos(ωt + φ), as the parts that go with cos ωt and with sin ωt."""
        return [
            Load(f"{name} cos", Part(size, phase, "cos"), Cosine(self.frequency), force, prescribed),
            Load(f"{name} sin", Part(size, phase, "sin"), Sine(self.frequency), force, prescribed),
        ]


@dataclass(frozen=True)
class Part:
    """The factor of cos ωt or of sin ωt in a cos(ωt + φ), of parameters a and φ [rad].

    Parameters
    ----------
    size, phase : str
        Names of the parameters.
    part : {"cos", "sin"}
    """

    size: str
    phase: str
    part: Literal["cos", "sin"]

    def __call__(self, parameters: Parameters) -> float:
        """Return a cos φ or −a sin φ."""
        size, phase = parameters[self.size], parameters[self.phase]
        return float(size * np.cos(phase)) if self.part == "cos" else float(-size * np.sin(phase))
