"""Elastodynamics, as a scene asks for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np
from scipy.sparse import block_diag, csr_array

from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.core.discretization import Discretization
from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel, AffineTerm, Caution, Discretize, Load, Physics, Profile
from dacore.core.parameters import ParameterSpace
from dacore.dynamics.profiles import Constant, Course
from dacore.errors import MeshError, ShapeError
from dacore.geometry.balls import cell_factors
from dacore_elastodynamics import material
from dacore_elastodynamics.cautions import Waves, locking, spacing
from dacore_elastodynamics.parts import BodyForce, Inclusion, Motion, Traction, unit

DISPLACEMENT = "u"

# Name, unit, default value or range: a soft gel that is shaken.
_SOLID: dict[str, tuple[str, tuple[float, float]]] = {
    "E": ("dyn/cm^2", (1e5, 4e5)),
    "nu": ("1", (0.30, 0.45)),
    "density": ("g/cm^3", (1.0, 1.0)),
    "mass_damping": ("1/s", (0.0, 0.0)),
    "stiffness_damping": ("s", (2e-4, 2e-4)),
}


@dataclass(frozen=True)
class Elastodynamics(Physics):
    """The displacement u [cm] of a damped elastic solid, in cgs.

    ``ρ ü + a ρ u̇ − ∇·(σ(u) + b σ(u̇)) = f`` with Hooke's ``σ = 2μ ε + λ (∇·u) I``: Rayleigh damping, of which b, a
    time, is the viscosity of Kelvin and Voigt and a that of a drag. In two dimensions the strain is plane. A role of
    the boundary that is not named is free of traction, and so are the components that are not held.

    Parameters
    ----------
    order : {1, 2}
        Elements of u.
    held : mapping of str to tuple of int
        Components of u that are zero on roles: ``{"base": (0, 1, 2)}`` clamps it, ``{"side": (0,)}`` is a roller.
    moved : mapping of str to Motion
        Displacement of roles along an axis: the parameter ``u_ROLE`` [cm].
    tractions : mapping of str to Traction
        Forces per area on roles [dyn/cm²]: ``t_ROLE``.
    body_force : BodyForce, optional
        Force per volume [dyn/cm³]: ``f``.
    courses : mapping of str to Course
        How ``u_ROLE``, ``t_ROLE`` and ``f`` vary in time; constant by default.
    inclusions : tuple of Inclusion
        Balls of another material; where they overlap the last one counts.
    ranges : mapping of str to (low, high)
        Ranges of parameters in place of the defaults; low = high fixes one. Beside those above they are E [dyn/cm²],
        nu, density [g/cm³], mass_damping a [1/s] and stiffness_damping b [s].
    log_uniform : tuple of str
        Parameters to sample uniformly in their logarithm.

    Raises
    ------
    ShapeError
        If a value or range is not physical, or a name is unknown.
    """

    order: int = 1
    held: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    moved: Mapping[str, Motion] = field(default_factory=dict)
    tractions: Mapping[str, Traction] = field(default_factory=dict)
    body_force: BodyForce | None = None
    courses: Mapping[str, Course] = field(default_factory=dict)
    inclusions: tuple[Inclusion, ...] = ()
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    log_uniform: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise ShapeError(f"order: got {self.order}, expected 1 or 2")
        for role, axes in self.held.items():
            if not axes or len(set(axes)) != len(axes) or not set(axes) <= {0, 1, 2}:
                raise ShapeError(f"held: got {list(axes)} on {role}, expected different axes, for example [0, 1, 2]")
        for role, motion in self.moved.items():
            if motion.axis in self.held.get(role, ()):
                raise ShapeError(f"moved: axis {motion.axis} of {role} is held; leave it out of held")
        sizes = self._sizes()
        if not sizes:
            raise ShapeError("loads: got none, expected something that moves the solid: moved, tractions or body_force")
        if unknown := [name for name in self.courses if name not in sizes]:
            raise ShapeError(f"courses: got {', '.join(unknown)}, expected any of {', '.join(sizes)}")
        self.parameters  # noqa: B018  every range is checked as it is made

    def _sizes(self) -> dict[str, tuple[str, float]]:
        """Unit and value of the parameters of all loads."""
        sizes = {f"u_{role}": ("cm", motion.by) for role, motion in self.moved.items()}
        sizes |= {f"t_{role}": ("dyn/cm^2", traction.size) for role, traction in self.tractions.items()}
        return sizes if self.body_force is None else sizes | {"f": ("dyn/cm^3", self.body_force.size)}

    @property
    def parameters(self) -> ParameterSpace:
        """Names, units and ranges of the parameters."""
        every = _SOLID | {name: (of, (size, size)) for name, (of, size) in self._sizes().items()}
        return ParameterSpace.of(every, self.ranges, self.log_uniform, material.bound, "elastic parameters")

    def build(self, discretize: Discretize) -> AffineModel:
        """Assemble the matrices and the loads on a mesh.

        Raises
        ------
        MeshError
            If the mesh lacks a role.
        ShapeError
            If an axis, a direction or an inclusion does not fit the mesh.
        """
        # The scalar field is for the normals of pressures alone.
        dim = discretize((Field("n", 1, self.order),)).mesh.dim
        disc = discretize((Field(DISPLACEMENT, dim, self.order, "cm"),))
        mesh = disc.mesh
        if lost := sorted({*self.held, *self.moved, *self.tractions} - set(mesh.roles)):
            raise MeshError(f"elastodynamics: the mesh has no role {', '.join(lost)}; it has {', '.join(mesh.roles)}")
        stiffness, density = (cell_factors(mesh, self.inclusions, what) for what in ("stiffness", "density"))
        shear, dilation = disc.strain(DISPLACEMENT, stiffness), disc.divergence(DISPLACEMENT, stiffness)
        mass = _each_component(disc.scalar_mass(DISPLACEMENT, density), dim)
        zero = self._zero(disc)
        moved = self._moved(disc, zero)
        none = np.zeros(disc.layout.n_dofs)
        loads = [Load(name, itemgetter(name), self._profile(name), none, where) for name, where in moved.items()]
        for role, traction in self.tractions.items():
            name = f"t_{role}"
            force = self._pushed(disc, discretize, role, traction)
            loads.append(Load(name, itemgetter(name), self._profile(name), force, none))
        if self.body_force is not None:
            scalar = disc.scalar_mass(DISPLACEMENT)
            force = np.kron(unit(self.body_force.direction, dim, "body_force"), scalar @ np.ones(scalar.shape[0]))
            loads.append(Load("f", itemgetter("f"), self._profile("f"), force, none))
        return AffineModel(
            FiniteElementSpace(disc),
            self.parameters,
            (AffineTerm("inertia", mass, material.density),),
            (
                AffineTerm("drag", mass, material.drag),
                AffineTerm("viscous shear", shear, material.shear_viscosity),
                AffineTerm("viscous dilation", dilation, material.volume_viscosity),
            ),
            (
                AffineTerm("shear", shear, material.twice_shear),
                AffineTerm("dilation", dilation, material.lame),
            ),
            tuple(loads),
            constrained=np.logical_or.reduce([zero, *(where != 0 for where in moved.values())]),
            antisymmetric=np.zeros(len(none), dtype=bool),
            cautions=self._cautions(mesh),
        )

    def _profile(self, name: str) -> Profile:
        return self.courses[name].profile() if name in self.courses else Constant()

    def _zero(self, disc: Discretization) -> BoolArray:
        """Dofs (n_dofs,) that are held at zero."""
        out = np.zeros(disc.layout.n_dofs, dtype=bool)
        for role, axes in self.held.items():
            for axis in axes:
                out[_on(disc, role, axis, self.order, "held")] = True
        return out

    def _moved(self, disc: Discretization, zero: BoolArray) -> dict[str, Array]:
        """Where each moved role prescribes u: ones (n_dofs,); no dof is in two of them, or held."""
        out: dict[str, Array] = {}
        taken = zero.copy()
        for role, motion in self.moved.items():
            where = np.zeros(len(taken))
            where[_on(disc, role, motion.axis, self.order, "moved")] = 1.0
            where[taken] = 0.0
            taken |= where > 0
            if not where.any():
                raise ShapeError(f"moved: every node of {role} is held or moved by another role; leave one out")
            out[f"u_{role}"] = where
        return out

    def _pushed(self, disc: Discretization, discretize: Discretize, role: str, traction: Traction) -> Array:
        """Force (n_dofs,) of a traction of 1 dyn/cm²."""
        mesh = disc.mesh
        if traction.direction:
            wall = disc.scalar_boundary_mass(DISPLACEMENT, role)
            return np.kron(unit(traction.direction, mesh.dim, f"traction on {role}"), wall @ np.ones(wall.shape[0]))
        both = discretize((Field(DISPLACEMENT, mesh.dim, self.order, "cm"), Field("n", 1, self.order)))
        coupling = both.boundary_coupling("n", DISPLACEMENT, role)
        return np.asarray(-(coupling @ np.ones(coupling.shape[1])))

    def _cautions(self, mesh: Mesh) -> tuple[Caution, ...]:
        frequencies = [course.frequency for course in self.courses.values() if course.frequency]
        speeds = [1.0, *((ball.stiffness / ball.density) ** 0.5 for ball in self.inclusions)]
        out: list[Caution] = [locking] if self.order == 1 else []
        if frequencies:
            out.append(Waves(spacing(mesh, self.order), max(frequencies), min(speeds)))
        return tuple(out)


def _on(disc: Discretization, role: str, axis: int, order: int, what: str) -> Array:
    """Dofs (k,) of one component of u on a role."""
    if axis >= disc.mesh.dim:
        raise ShapeError(f"{what}: got axis {axis} on {role}, expected 0 to {disc.mesh.dim - 1}")
    return np.asarray(disc.layout.component(DISPLACEMENT, axis).start + disc.mesh.boundary_nodes(role, order))


def _each_component(scalar: Sparse, dim: int) -> Sparse:
    """A form of one component (n, n) on all of them (d n, d n)."""
    return csr_array(block_diag([scalar] * dim, format="csr"))
