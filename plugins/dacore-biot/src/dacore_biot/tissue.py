"""What is the same in every model of the brain: its settings, parameters, conditions and matrices."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.discretization import Discretization
from dacore.core.fespace import FiniteElementSpace
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, Caution, Discretize, Load, Physics
from dacore.core.parameters import ParameterSpace
from dacore.errors import MeshError, ShapeError
from dacore.geometry.balls import cell_factors
from dacore_biot import material
from dacore_biot.cautions import Oscillation, cell_sizes, locking
from dacore_biot.inclusions import Inclusion
from dacore_biot.operators import DISPLACEMENT, PRESSURE, Stabilization, biot_fields, biot_terms

NeckPressure = Literal["none", "csf"]
Ranges = Mapping[str, tuple[float, float]]

# Name, unit, default range: the table of the paper, section 4.
SAMPLED = {
    "kappa": ("cm^2", (1e-9, 1e-8)),
    "E": ("dyn/cm^2", (1e5, 1e6)),
    "nu": ("1", (0.40, 0.45)),
    "p_ventricles": ("dyn/cm^2", (1.0e4, 1.1e4)),
}
# Parameters whose default is a setting of the same name.
FIXED = {
    "p_csf": "dyn/cm^2",
    "xi": "dyn/cm^2",
    "density": "g/cm^3",
    "alpha": "1",
    "skempton": "1",
    "viscosity": "P",
    "neck_displacement": "cm",
}
# Parameters that a domain without ventricles has not.
OF_VENTRICLES = ("p_ventricles", "phase_ventricles")


@dataclass(frozen=True)
class Tissue(Physics):
    """A fluid-filled elastic tissue with boundary conditions of the brain; what drives it is a model's own.

    The settings are explained in `dacore_biot.model.Biot`.

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

    _sampled: ClassVar[Mapping[str, tuple[str, tuple[float, float]]]] = SAMPLED
    _fixed: ClassVar[Mapping[str, str]] = FIXED

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
        every = dict(self._sampled)
        every |= {name: (unit, (getattr(self, name),) * 2) for name, unit in self._fixed.items()}
        if not self.ventricles:
            every = {name: given for name, given in every.items() if name not in OF_VENTRICLES}
        return ParameterSpace.of(every, self.ranges, self.log_uniform, material.admissible, "Biot parameters")

    def assemble(self, discretize: Discretize) -> AffineModel:
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
        stiffness = cell_factors(mesh, self.inclusions, "stiffness")
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

    @abstractmethod
    def _loads(self, discretization: Discretization, held: Mapping[str, BoolArray]) -> tuple[Load, ...]:
        """What moves the tissue; `held` are the dofs of `_held`."""

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
    for name in set(material.bounded()) & set(space.names):
        material.check(name, space[name].low)
        material.check(name, space[name].high)
    if space["alpha"].high * space["skempton"].high >= 1 and space["kappa"].low == 0:
        raise ShapeError("kappa: got 0 with alpha · skempton = 1, expected kappa > 0 where the storage vanishes")
