"""Poroelastic bodies with conditions of any kind: rollers, drained sides, total tractions, weights, rigid plates.

`dacore_biot.model.Biot` is the brain of a scene. This is the same physics, the same matrices, for whatever
else one wants to compute from Python, such as the problems of `dacore_biot.analytic`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse, check_shape
from dacore.core.discretization import Discretization
from dacore.core.fespace import FiniteElementSpace
from dacore.core.model import AffineModel, AffineTerm, Load
from dacore.core.parameters import Parameter, Parameters, ParameterSpace
from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.operators import DISPLACEMENT, PRESSURE, Stabilization, biot_terms

_UNITS = {
    "E": "dyn/cm^2",
    "nu": "1",
    "kappa": "cm^2",
    "density": "g/cm^3",
    "viscosity": "P",
    "alpha": "1",
    "skempton": "1",
}


@dataclass(frozen=True)
class Conditions:
    """What is prescribed where; everywhere else the traction is total and given (zero without a load), the flux zero.

    Parameters
    ----------
    held : mapping of str to tuple of int
        Components of u that are prescribed on the boundary of each role: (0, 1, 2) clamps it, (0,) puts it on rollers.
    drained : tuple of str
        Roles where p is prescribed.
    """

    held: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    drained: tuple[str, ...] = ()

    def dofs(self, discretization: Discretization) -> BoolArray:
        """Prescribed dofs as a (n_dofs,) bool array; MeshError or ShapeError if a role or component does not exist."""
        mesh, layout = discretization.mesh, discretization.layout
        out = np.zeros(layout.n_dofs, dtype=bool)
        order = layout.field(DISPLACEMENT).order
        for role, components in self.held.items():
            nodes = mesh.boundary_nodes(role, order)
            for axis in components:
                if not 0 <= axis < mesh.dim:
                    raise ShapeError(f"held on {role}: got component {axis}, expected 0 to {mesh.dim - 1}")
                out[layout.component(DISPLACEMENT, axis).start + nodes] = True
        for role in self.drained:
            out[layout.block(PRESSURE).start + mesh.boundary_nodes(role)] = True
        return out


def fixed_parameters(values: Parameters) -> ParameterSpace:
    """A space of one point: the material's parameters, and any others that loads may need.

    Raises
    ------
    ShapeError
        If one of the material's is missing, or not physical.
    """
    if missing := [name for name in _UNITS if name not in values]:
        raise ShapeError(f"parameters: {', '.join(missing)} missing; expected {', '.join(_UNITS)}")
    for name in _UNITS:
        material.check(name, values[name])
    return ParameterSpace(tuple(Parameter(name, _UNITS.get(name, "1"), value, value) for name, value in values.items()))


def poroelastic(
    discretization: Discretization,
    parameters: ParameterSpace,
    conditions: Conditions,
    loads: Sequence[Load],
    inertia: bool = True,
    stabilization: Stabilization = "none",
    stiffness: Array | None = None,
) -> AffineModel:
    """Build the model of a body under conditions of any kind.

    The matrices of `biot_terms` take tractions as effective ones. Here they are total: what the pressure
    presses on the boundary is added to the balance of momentum, −α ∫ p v·n, which also keeps
    the step symmetric where neither u nor p is prescribed.

    Parameters
    ----------
    discretization : Discretization
        Of the fields of `biot_fields`.
    parameters : ParameterSpace
    conditions : Conditions
    loads : sequence of Load
        Made with `normal_force`, `surface_force`, `body_force`, or any others.
    inertia : bool
        Without it the motion is quasi-static: a sequence of equilibria, as classical consolidation has it.
    stabilization : {"none", "lumped", "projected"}
        A remedy of `dacore_biot.stabilization`.
    stiffness : (c,) array, optional
        Factor of E on each cell.

    Returns
    -------
    AffineModel
    """
    terms = biot_terms(discretization, stabilization, stiffness)
    n, mesh = discretization.layout.n_dofs, discretization.mesh
    u, p = discretization.layout.block(DISPLACEMENT), discretization.layout.block(PRESSURE)
    pressed = coo_array(sum(discretization.boundary_coupling(PRESSURE, DISPLACEMENT, role) for role in mesh.roles))
    rows, columns = pressed.coords
    surface = csr_array((-pressed.data, (rows + u.start, columns + p.start)), shape=(n, n))
    return AffineModel(
        FiniteElementSpace(discretization),
        parameters,
        terms.second_order if inertia else (),
        terms.first_order,
        (*terms.zeroth_order, AffineTerm("pressure on the boundary", surface, material.alpha)),
        tuple(loads),
        conditions.dofs(discretization),
        terms.flow,
    )


def normal_force(discretization: Discretization, role: str) -> Array:
    """∫ v·n over the boundary `role` (n_dofs,), n outward: the force of a unit total pull."""
    coupling = discretization.boundary_coupling(PRESSURE, DISPLACEMENT, role)
    force = np.zeros(discretization.layout.n_dofs)
    force[discretization.layout.block(DISPLACEMENT)] = coupling @ np.ones(coupling.shape[1])
    return force


def surface_force(discretization: Discretization, role: str, traction: ArrayLike) -> Array:
    """∫ t·v over the boundary `role` (n_dofs,) of a total traction t.

    Parameters
    ----------
    discretization : Discretization
    role : str
    traction : (d,) or (n_nodes, d) array [dyn/cm²]
        One vector, or one for each node of u.
    """
    mass = discretization.scalar_boundary_mass(DISPLACEMENT, role)
    return _weighted(discretization, mass, traction)


def body_force(discretization: Discretization, force: ArrayLike) -> Array:
    """∫ f·v (n_dofs,) of a force f per volume, (d,) or (n_nodes, d) [dyn/cm³]."""
    return _weighted(discretization, discretization.scalar_mass(DISPLACEMENT), force)


def _weighted(discretization: Discretization, mass: Sparse, values: ArrayLike) -> Array:
    layout, dim = discretization.layout, discretization.mesh.dim
    given = np.asarray(values, dtype=np.float64)
    if given.ndim == 1:
        given = np.broadcast_to(given, (mass.shape[0], given.shape[0]))
    check_shape("force", given, (mass.shape[0], dim))
    out = np.zeros(layout.n_dofs)
    for axis in range(dim):
        out[layout.component(DISPLACEMENT, axis)] = mass @ given[:, axis]
    return out


@dataclass(frozen=True, eq=False)
class Rigid:
    """A model in which some dofs move as one.

    Parameters
    ----------
    model : AffineModel
        In it the first of the dofs stands for all; the others are zero.
    lift : (n_dofs, n_dofs) csr_array
        Times a state of `model`: the state with all of them in place.
    """

    model: AffineModel
    lift: Sparse


def tied(model: AffineModel, dofs: IntArray) -> Rigid:
    """Tie dofs (k,) to each other: a rigid plate without friction, moved by what the loads' forces on them add up to.

    Raises
    ------
    ShapeError
        If there are none, one is prescribed, or they are of rows of different kind.
    """
    dofs = np.unique(dofs)
    if not dofs.size or model.constrained[dofs].any() or np.unique(model.antisymmetric[dofs]).size > 1:
        raise ShapeError(f"tied dofs: got {dofs.size}, expected at least one, free and all of the same balance")
    n, first, others = model.space.n_dofs, dofs[0], dofs[1:]
    columns = np.arange(n)
    columns[others] = first
    lift = csr_array((np.ones(n), (np.arange(n), columns)), shape=(n, n))

    def reduced(terms: Sequence[AffineTerm]) -> tuple[AffineTerm, ...]:
        return tuple(replace(term, matrix=csr_array(lift.T @ term.matrix @ lift)) for term in terms)

    constrained = model.constrained.copy()
    constrained[others] = True
    small = replace(
        model,
        second_order=reduced(model.second_order),
        first_order=reduced(model.first_order),
        zeroth_order=reduced(model.zeroth_order),
        loads=tuple(replace(load, force=lift.T @ load.force) for load in model.loads),
        constrained=constrained,
    )
    return Rigid(small, lift)
