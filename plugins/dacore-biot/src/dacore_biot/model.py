"""Dynamic poroelasticity of the brain, as a scene asks for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from typing import Literal

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.discretization import Discretization
from dacore.core.fespace import FiniteElementSpace
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, Caution, Discretize, Load, Physics
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.dynamics.profiles import Constant, Sine, SmoothRamp
from dacore.errors import MeshError, ShapeError
from dacore_biot import material
from dacore_biot.cautions import Oscillation, cell_sizes, locking
from dacore_biot.inclusions import Inclusion, stiffness_factors
from dacore_biot.operators import DISPLACEMENT, PRESSURE, Stabilization, biot_fields, biot_terms

NeckPressure = Literal["none", "csf"]
Ranges = Mapping[str, tuple[float, float]]

# Name, unit, default value or range: the table of the paper, section 4.
_SAMPLED = {
    "kappa": ("cm^2", (1e-9, 1e-8)),
    "E": ("dyn/cm^2", (1e5, 1e6)),
    "nu": ("1", (0.40, 0.45)),
    "p_ventricles": ("dyn/cm^2", (1.0e4, 1.1e4)),
}
_FIXED = {
    "p_csf": "dyn/cm^2",
    "xi": "dyn/cm^2",
    "density": "g/cm^3",
    "alpha": "1",
    "skempton": "1",
    "viscosity": "P",
    "neck_displacement": "cm",
}


@dataclass(frozen=True)
class Biot(Physics):
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

    displacement_order: int = 1
    stabilization: Stabilization = "none"
    alpha: float = 1.0
    skempton: float = 0.99
    density: float = 1.0
    viscosity: float = 1e-2
    p_csf: float = 1e4
    xi: float = -500.0
    frequency: float = 50.0
    pulse_axis: int = 1
    ramp: float = 0.0
    pressure_on_neck: NeckPressure = "none"
    neck_displacement: float = 0.0
    neck_direction: tuple[float, ...] = ()
    inclusions: tuple[Inclusion, ...] = ()
    rollers: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    neck: str = "neck"
    ventricles: str = "ventricles"
    mre: str = "mre"
    ranges: Ranges = field(default_factory=dict)
    log_uniform: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.displacement_order not in (1, 2):
            raise ShapeError(f"displacement_order: got {self.displacement_order}, expected 1 or 2")
        if self.stabilization not in ("none", "lumped", "projected"):
            raise ShapeError(f"stabilization: got {self.stabilization!r}, expected 'none', 'lumped' or 'projected'")
        if self.stabilization == "projected" and self.displacement_order == 2:
            raise ShapeError(
                "stabilization: got 'projected' with displacement_order 2, which needs none; leave one out"
            )
        if self.pressure_on_neck not in ("none", "csf"):
            raise ShapeError(f"pressure_on_neck: got {self.pressure_on_neck!r}, expected 'none' or 'csf'")
        if not (np.isfinite(self.frequency) and self.frequency > 0):
            raise ShapeError(f"frequency: got {self.frequency}, expected a positive number of Hz")
        if not 0 <= self.ramp < np.inf:
            raise ShapeError(f"ramp: got {self.ramp}, expected 0 (a jump) or a positive number of seconds")
        if len({self.neck, self.ventricles, self.mre}) != 3:
            raise ShapeError(f"roles: got {self.neck}, {self.ventricles}, {self.mre}, expected three different names")
        if self.neck_direction and not (np.isfinite(self.neck_direction).all() and any(self.neck_direction)):
            raise ShapeError(
                f"neck_direction: got {list(self.neck_direction)}, expected one number a component, not all zero"
            )
        self._check_rollers()
        _check_ranges(self.parameters)

    def _check_rollers(self) -> None:
        if self.neck in self.rollers:
            raise ShapeError(f"rollers: got {self.neck}, where every component is held already; leave it out")
        for role, axes in self.rollers.items():
            if not axes or len(set(axes)) != len(axes) or min(axes) < 0:
                raise ShapeError(
                    f"rollers: got {list(axes)} on {role}, expected different components of u, for example [0]"
                )
        if self.pulse_axis in self.rollers.get(self.mre, ()):
            raise ShapeError(
                f"rollers: component {self.pulse_axis} on {self.mre} is the one that the traction pulls; change "
                "pulse_axis, or give rollers to a role of their own"
            )

    @property
    def parameters(self) -> ParameterSpace:
        """Names, units and ranges of the parameters."""
        every = {name: (unit, bounds) for name, (unit, bounds) in _SAMPLED.items()}
        every |= {name: (unit, (getattr(self, name),) * 2) for name, unit in _FIXED.items()}
        if not self.ventricles:
            del every["p_ventricles"]
        unknown = [name for name in (*self.ranges, *self.log_uniform) if name not in every]
        if unknown:
            raise ShapeError(f"Biot parameters: got {', '.join(unknown)}, expected any of {', '.join(every)}")
        out = []
        for name, (unit, bounds) in every.items():
            kind: Literal["uniform", "log_uniform"] = "log_uniform" if name in self.log_uniform else "uniform"
            admissible = partial(material.check, name) if name in material.bounded() else None
            out.append(Parameter(name, unit, *self.ranges.get(name, bounds), kind, admissible))
        return ParameterSpace(tuple(out))

    def build(self, discretize: Discretize) -> AffineModel:
        """Assemble the matrices and the loads on a mesh.

        Raises
        ------
        MeshError
            If the mesh lacks a role, or has a boundary that is none of these.
        """
        mesh = discretize((biot_fields(1)[1],)).mesh
        self._check_roles(mesh)
        if not 0 <= self.pulse_axis < mesh.dim:
            raise ShapeError(f"pulse_axis: got {self.pulse_axis}, expected 0 to {mesh.dim - 1}")
        if self.neck_direction and len(self.neck_direction) != mesh.dim:
            raise ShapeError(f"neck_direction: got {len(self.neck_direction)} numbers, expected {mesh.dim}")
        discretization = discretize(biot_fields(mesh.dim, self.displacement_order))
        stiffness = stiffness_factors(mesh, self.inclusions)
        terms = biot_terms(discretization, self.stabilization, stiffness)
        held = self._held(discretization)
        constrained = np.logical_or.reduce([*held.values(), self._on_rollers(discretization)])
        return AffineModel(
            FiniteElementSpace(discretization),
            self.parameters,
            terms.second_order,
            terms.first_order,
            terms.zeroth_order,
            self._loads(discretization, held),
            constrained=constrained,
            antisymmetric=terms.flow,
            cautions=self._cautions(mesh, stiffness),
        )

    def _cautions(self, mesh: Mesh, stiffness: Array | None) -> tuple[Caution, ...]:
        if self.displacement_order == 2:
            return ()
        extremes = (1.0, 1.0) if stiffness is None else (float(stiffness.min()), float(stiffness.max()))
        oscillation = Oscillation(mesh.dim, float(np.median(cell_sizes(mesh))), extremes)
        return (oscillation, locking) if self.stabilization == "none" else (locking,)

    def _check_roles(self, mesh: Mesh) -> None:
        expected = {role for role in (self.neck, self.ventricles, self.mre, *self.rollers) if role}
        if missing := expected - set(mesh.roles):
            raise MeshError(f"Biot: the mesh has no role {', '.join(sorted(missing))}; it has {', '.join(mesh.roles)}")
        if loose := set(mesh.roles) - expected:
            raise MeshError(
                f"Biot: nothing is held on the boundary {', '.join(sorted(loose))}; "
                f"expected the roles {', '.join(sorted(expected))} only"
            )

    def _held(self, discretization: Discretization) -> dict[str, BoolArray]:
        """Dofs (n_dofs,) with prescribed values, by the load that prescribes them; no dof is in two of them."""
        mesh, layout = discretization.mesh, discretization.layout
        held = {name: np.zeros(layout.n_dofs, dtype=bool) for name in ("neck", "csf", "ventricles")}
        nodes = mesh.boundary_nodes(self.neck, self.displacement_order)
        for axis in range(mesh.dim):
            held["neck"][layout.component(DISPLACEMENT, axis).start + nodes] = True
        start = layout.block(PRESSURE).start
        held["csf"][start + mesh.boundary_nodes(self.mre)] = True
        if self.ventricles:
            held["ventricles"][start + mesh.boundary_nodes(self.ventricles)] = True
            held["ventricles"] &= ~held["csf"]
        if self.pressure_on_neck == "csf":
            held["csf"][start + mesh.boundary_nodes(self.neck)] = True
            held["csf"] &= ~held["ventricles"]
        return held

    def _on_rollers(self, discretization: Discretization) -> BoolArray:
        """Dofs (n_dofs,) that rollers hold at zero, those of the neck among them where they meet."""
        mesh, layout = discretization.mesh, discretization.layout
        out = np.zeros(layout.n_dofs, dtype=bool)
        for role, axes in self.rollers.items():
            if max(axes) >= mesh.dim:
                raise ShapeError(f"rollers: got component {max(axes)} on {role}, expected 0 to {mesh.dim - 1}")
            nodes = mesh.boundary_nodes(role, self.displacement_order)
            for axis in axes:
                out[layout.component(DISPLACEMENT, axis).start + nodes] = True
        return out

    def _loads(self, discretization: Discretization, held: Mapping[str, BoolArray]) -> tuple[Load, ...]:
        none, rise = np.zeros(discretization.layout.n_dofs), SmoothRamp(self.ramp) if self.ramp else Constant()
        pulse = Load("pulse", itemgetter("xi"), Sine(self.frequency), self._traction(discretization), none)
        csf = Load("csf", itemgetter("p_csf"), rise, none, held["csf"].astype(np.float64))
        neck = Load("neck", itemgetter("neck_displacement"), rise, none, self._moved(discretization, held["neck"]))
        if not self.ventricles:
            return pulse, csf, neck
        ventricles = Load("ventricles", itemgetter("p_ventricles"), rise, none, held["ventricles"].astype(np.float64))
        return pulse, csf, ventricles, neck

    def _moved(self, discretization: Discretization, held: BoolArray) -> Array:
        """Values (n_dofs,) of the neck's dofs for each cm of its displacement."""
        moved = held.astype(np.float64)
        for axis, factor in enumerate(self.neck_direction):
            moved[discretization.layout.component(DISPLACEMENT, axis)] *= factor
        return moved

    def _traction(self, discretization: Discretization) -> Array:
        """∫ s v_y over `mre` (n_dofs,), with s linear between the mesh's ends."""
        mesh = discretization.mesh
        low, high = mesh.points[:, self.pulse_axis].min(), mesh.points[:, self.pulse_axis].max()
        strength = (high - mesh.nodes(self.displacement_order)[:, self.pulse_axis]) / (high - low)
        force = np.zeros(discretization.layout.n_dofs)
        rows = discretization.layout.component(DISPLACEMENT, self.pulse_axis)
        force[rows] = discretization.scalar_boundary_mass(DISPLACEMENT, self.mre) @ strength
        return force


def _check_ranges(space: ParameterSpace) -> None:
    """ShapeError unless every parameter vector of the space is physical."""
    for name in material.bounded():
        material.check(name, space[name].low)
        material.check(name, space[name].high)
    if space["alpha"].high * space["skempton"].high >= 1 and space["kappa"].low == 0:
        raise ShapeError("kappa: got 0 with alpha · skempton = 1, expected kappa > 0 where the storage vanishes")
