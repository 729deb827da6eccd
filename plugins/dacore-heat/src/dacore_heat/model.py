"""Transient heat conduction, as a scene asks for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np

from dacore.core.arrays import Array
from dacore.core.discretization import Discretization
from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, AffineTerm, Coefficient, Discretize, Load, Physics, Profile
from dacore.core.parameters import ParameterSpace
from dacore.dynamics.profiles import Constant, Course
from dacore.errors import MeshError, ShapeError
from dacore.geometry.balls import cell_factors
from dacore_heat.cautions import Undershoot
from dacore_heat.material import Product, bound
from dacore_heat.parts import Exchange, Inclusion, Source

TEMPERATURE = "T"

# Name, unit, default value or range: perfused soft tissue.
_TISSUE: dict[str, tuple[str, tuple[float, float]]] = {
    "conductivity": ("erg/(cm*s*K)", (4.0e4, 6.0e4)),
    "perfusion": ("1/s", (5e-4, 5e-3)),
    "capacity": ("erg/(cm^3*K)", (3.8e7, 3.8e7)),
    "blood_capacity": ("erg/(cm^3*K)", (3.9e7, 3.9e7)),
    "arterial": ("K", (0.0, 0.0)),
}
_FLUX, _TRANSFER, _POWER = "erg/(cm^2*s)", "erg/(cm^2*s*K)", "erg/s"


@dataclass(frozen=True)
class Heat(Physics):
    """The temperature T [K] of a body that conducts heat and is perfused, in cgs.

    ``capacity ∂T/∂t − ∇·(conductivity ∇T) + perfusion · blood_capacity (T − arterial) = sources``, Pennes' equation
    (J. Appl. Physiol. 1, 1948), with perfusion = 0 the equation of heat. It is linear, so that T may be measured from
    any temperature: by default from that of the arterial blood. A role of the boundary that is not named is insulated.

    Parameters
    ----------
    order : {1, 2}
        Elements of T.
    sources : mapping of str to Source
        Heated spots by name; the power of NAME is the parameter ``P_NAME`` [erg/s].
    held : mapping of str to float
        Temperature [K] on roles: the parameter ``T_ROLE``. Where two roles meet the first one named counts.
    fluxes : mapping of str to float
        Heat that enters through roles [erg/(cm² s)]: ``q_ROLE``.
    convection : mapping of str to Exchange
        Roles that exchange heat with surroundings: ``h_ROLE`` [erg/(cm² s K)] and ``ambient_ROLE`` [K].
    initial : float, optional
        Temperature [K] of the whole body at t = 0: the parameter ``initial``. Without it a march starts from T = 0,
        or from the steady temperature, and there is no such parameter.
    inclusions : tuple of Inclusion
        Balls of another material; where they overlap the last one counts.
    courses : mapping of str to Course
        How ``T_ROLE``, ``q_ROLE``, ``ambient_ROLE`` and ``P_NAME`` vary in time; constant by default.
    ranges : mapping of str to (low, high)
        Ranges of parameters in place of the defaults; low = high fixes one. Beside those above they are
        conductivity [erg/(cm s K)], perfusion [1/s], capacity and blood_capacity [erg/(cm³ K)] and arterial [K].
    log_uniform : tuple of str
        Parameters to sample uniformly in their logarithm.

    Raises
    ------
    ShapeError
        If a value or range is not physical, or a name is unknown.
    """

    order: int = 1
    sources: Mapping[str, Source] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    fluxes: Mapping[str, float] = field(default_factory=dict)
    convection: Mapping[str, Exchange] = field(default_factory=dict)
    initial: float | None = None
    inclusions: tuple[Inclusion, ...] = ()
    courses: Mapping[str, Course] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    log_uniform: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise ShapeError(f"order: got {self.order}, expected 1 or 2")
        for name in self.sources:
            if not name.isidentifier():
                raise ShapeError(f"sources: got the name {name!r}, expected letters, digits and _, a letter first")
        for role in self.held:
            for other in ("fluxes", "convection"):
                if role in getattr(self, other):
                    raise ShapeError(f"{other}: got {role}, whose temperature is held; leave it out of one of them")
        moving = self._moving()
        if unknown := [name for name in self.courses if name not in moving]:
            raise ShapeError(
                f"courses: got {', '.join(unknown)}, expected any of {', '.join(moving) or 'none, nothing acts here'}"
            )
        self.parameters  # noqa: B018  every range is checked as it is made

    def _moving(self) -> list[str]:
        """Names of the parameters that may have a course."""
        return [
            *(f"T_{role}" for role in self.held), *(f"q_{role}" for role in self.fluxes),
            *(f"ambient_{role}" for role in self.convection), *(f"P_{name}" for name in self.sources),
        ]  # fmt: skip

    @property
    def parameters(self) -> ParameterSpace:
        """Names, units and ranges of the parameters."""
        every = dict(_TISSUE)
        every |= {f"T_{role}": ("K", (value,) * 2) for role, value in self.held.items()}
        every |= {f"q_{role}": (_FLUX, (value,) * 2) for role, value in self.fluxes.items()}
        for role, wall in self.convection.items():
            every |= {f"h_{role}": (_TRANSFER, (wall.h,) * 2), f"ambient_{role}": ("K", (wall.ambient,) * 2)}
        every |= {f"P_{name}": (_POWER, (source.power,) * 2) for name, source in self.sources.items()}
        if self.initial is not None:
            every["initial"] = ("K", (self.initial,) * 2)
        return ParameterSpace.of(every, self.ranges, self.log_uniform, bound, "heat parameters")

    def build(self, discretize: Discretize) -> AffineModel:
        """Assemble the matrices and the loads on a mesh.

        Raises
        ------
        MeshError
            If the mesh lacks a role.
        ShapeError
            If a source or an inclusion does not fit the mesh.
        """
        disc = discretize((Field(TEMPERATURE, 1, self.order, "K"),))
        mesh = disc.mesh
        if lost := sorted({*self.held, *self.fluxes, *self.convection} - set(mesh.roles)):
            raise MeshError(f"heat: the mesh has no role {', '.join(lost)}; it has {', '.join(mesh.roles)}")
        conducting, storing, perfused = (
            cell_factors(mesh, self.inclusions, what) for what in ("conductivity", "capacity", "perfusion")
        )
        blood = disc.scalar_mass(TEMPERATURE, perfused)
        zeroth = [
            AffineTerm("conduction", disc.scalar_stiffness(TEMPERATURE, conducting), Product(("conductivity",))),
            AffineTerm("perfusion", blood, Product(("perfusion", "blood_capacity"))),
        ]
        walls = {role: disc.scalar_boundary_mass(TEMPERATURE, role) for role in (*self.convection, *self.fluxes)}
        zeroth += [AffineTerm(f"exchange {role}", walls[role], Product((f"h_{role}",))) for role in self.convection]
        ones = np.ones(disc.layout.n_dofs)
        forces: dict[str, tuple[Coefficient, Array]] = {
            "blood": (Product(("perfusion", "blood_capacity", "arterial")), blood @ ones),
            **{f"ambient_{role}": (Product((f"h_{role}", f"ambient_{role}")), walls[role] @ ones)
               for role in self.convection},
            **{f"q_{role}": (itemgetter(f"q_{role}"), walls[role] @ ones) for role in self.fluxes},
            **{f"P_{name}": (itemgetter(f"P_{name}"), self._heated(disc, name)) for name in self.sources},
        }  # fmt: skip
        held = self._held(mesh)
        loads = [Load(name, size, self._profile(name), force, 0 * ones) for name, (size, force) in forces.items()]
        loads += [Load(name, itemgetter(name), self._profile(name), 0 * ones, where) for name, where in held.items()]
        if self.initial is not None:
            loads.append(Load.at_start("initial", itemgetter("initial"), ones))
        return AffineModel(
            FiniteElementSpace(disc),
            self.parameters,
            (),
            (AffineTerm("storage", disc.scalar_mass(TEMPERATURE, storing), Product(("capacity",))),),
            tuple(zeroth),
            tuple(loads),
            constrained=np.any([where > 0 for where in held.values()], axis=0) if held else np.zeros(len(ones), bool),
            antisymmetric=np.zeros(len(ones), dtype=bool),
            cautions=self._cautions(mesh),
        )

    def _profile(self, name: str) -> Profile:
        return self.courses[name].profile() if name in self.courses else Constant()

    def _heated(self, disc: Discretization, name: str) -> Array:
        """Force (n_dofs,) of a source of 1 erg/s."""
        source, mass = self.sources[name], disc.scalar_mass(TEMPERATURE)
        bell = mass @ source.bell(disc.mesh.nodes(self.order))
        if not bell.sum() > 1e-300:
            raise ShapeError(
                f"source {name}: {list(source.centre)} is {source.width:g} cm wide and nowhere near the mesh; move it"
            )
        return np.asarray(bell / bell.sum())

    def _held(self, mesh: Mesh) -> dict[str, Array]:
        """Where each held role prescribes T: ones (n_dofs,) on its nodes; no node is in two of them."""
        out: dict[str, Array] = {}
        taken = np.zeros(len(mesh.nodes(self.order)), dtype=bool)
        for role in self.held:
            where = np.zeros(len(taken))
            where[mesh.boundary_nodes(role, self.order)] = 1.0
            where[taken] = 0.0
            taken |= where > 0
            out[f"T_{role}"] = where
        return out

    def _cautions(self, mesh: Mesh) -> tuple[Undershoot, ...]:
        walls = {f"T_{role}": float(self._profile(f"T_{role}")(np.zeros(1))[0]) for role in self.held}
        spread = [(1.0, 1.0), *((ball.conductivity, ball.capacity) for ball in self.inclusions)]
        slowest = min(conducts / stores for conducts, stores in spread)
        return (Undershoot.on(mesh, self.order, slowest, walls),)
