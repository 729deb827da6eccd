"""State spaces for tests: one without a mesh, and finite elements without a library."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.discretization import Assembler, Backend
from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field, Layout
from dacore.core.mesh import Mesh
from dacore.core.space import CellGeometry, Product, StateSpace
from dacore.geometry.interpolate import interpolation_matrix
from dacore.geometry.locate import PointLocator
from dacore.testing.meshes import shuffled_box, with_points
from dacore.testing.reference import Reference


class Chain(StateSpace):
    """A vector and a scalar field on the nodes of a chain, with a consistent mass matrix; no capabilities.

    Parameters
    ----------
    nodes : int
    components : int
        Of the field u.
    """

    def __init__(self, nodes: int, components: int = 2) -> None:
        self._layout = Layout(
            [Field("u", components, unit="cm"), Field("p", 1, unit="dyn/cm^2")], {"u": nodes, "p": nodes}
        )

    @property
    def layout(self) -> Layout:
        """Fields u and p."""
        return self._layout

    def scalar_product(self, field: str, kind: Product = "l2") -> Sparse:
        """Mass of linear elements, with the stiffness for "h1"."""
        n = self.layout.nodes[self.layout.field(field).name]
        mass = diags_array([np.full(n - 1, 1 / 6), np.full(n, 2 / 3), np.full(n - 1, 1 / 6)], offsets=[-1, 0, 1])
        if kind == "h1":
            mass = mass + diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1])
        return csr_array(mass)


class ReferenceAssembler(Assembler):
    """The forms of `Reference`, dense and slow: for meshes of some hundred cells.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self._forms = mesh, Reference(mesh)
        self._locator = PointLocator(mesh.points, mesh.cells)

    def _with(self, weight: Array | None) -> Reference:
        return self._forms if weight is None else Reference(self._mesh, weight)

    def mass(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ a b."""
        return csr_array(self._with(weight).mass(order).matrix)

    def stiffness(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ∇a·∇b."""
        return csr_array(self._with(weight).stiffness(order).matrix)

    def strain(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ε(a):ε(b)."""
        return csr_array(self._with(weight).strain(order).matrix)

    def divergence(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ (∇·a)(∇·b)."""
        return csr_array(self._with(weight).divergence(order).matrix)

    def gradient_coupling(self, scalar: int, vector: int, weight: Array | None = None) -> Sparse:
        """∫ ∇p·v."""
        return csr_array(self._with(weight).gradient_coupling(scalar, vector).matrix)

    def divergence_coupling(self, vector: int, scalar: int, weight: Array | None = None) -> Sparse:
        """∫ q ∇·u."""
        return csr_array(self._with(weight).divergence_coupling(vector, scalar).matrix)

    def boundary_mass(self, order: int, role: str) -> Sparse:
        """∫ a b over a role."""
        return csr_array(self._forms.boundary_mass(order, role).matrix)

    def boundary_coupling(self, scalar: int, vector: int, role: str) -> Sparse:
        """∫ p v·n over a role."""
        return csr_array(self._forms.boundary_coupling(scalar, vector, role).matrix)

    def evaluation(self, points: Array, order: int, derivative: int | None) -> Sparse:
        """Values or a derivative at points."""
        return interpolation_matrix(self._mesh, self._locator, points, order, derivative)


class ReferenceBackend(Backend):
    """Finite elements in plain numpy, so that whatever stands on a state space can be tested without a library."""

    name = "reference"

    def assembler(self, mesh: Mesh) -> Assembler:
        """Put the reference on a mesh."""
        return ReferenceAssembler(mesh)

    def version(self) -> str:
        """Version of numpy."""
        return np.__version__


def box_space(
    dim: int = 3, length: float = 3.0, n: int = 3, order: int = 1, seed: int = 0, hole: bool = False
) -> FiniteElementSpace:
    """Return u (vector of `order`, cm), p (scalar, dyn/cm^2) and c (two components, neither) on a box [0, length].

    Roles as in `shuffled_box`: "left", "right", "side", and "hole" if there is one.
    """
    box = shuffled_box(dim, n, seed, hole=hole)
    fields = [Field("u", dim, order, "cm"), Field("p", 1, 1, "dyn/cm^2")]
    if dim == 3:
        fields.append(Field("c", 2, 1, "1"))
    return FiniteElementSpace(ReferenceBackend().discretize(with_points(box, length * box.points), fields))


def interpolate(space: StateSpace, field: str, function: Callable[[Array], Array]) -> Array:
    """State (n_dofs,) whose `field` takes the values of a function of points (n, d) -> (n, c), zero elsewhere.

    The places of nodes come from the space's cells.
    """
    x = node_points(space.cells(), field)
    state = np.zeros(space.n_dofs)
    components = space.layout.field(field).components
    state[space.layout.block(field)] = np.broadcast_to(function(x), (len(x), components)).T.ravel()
    return state


def node_points(geometry: CellGeometry, field: str) -> Array:
    """Places (n_nodes, d) of a field's nodes: the vertices, then the middles of edges for order 2."""
    nodes, cells = geometry.nodes[field], geometry.cells
    out = np.full((int(nodes.max()) + 1, geometry.points.shape[1]), np.nan)
    corners = geometry.points[cells]
    places = [corners]
    if geometry.orders[field] == 2:
        pairs = np.array([(i, j) for i in range(cells.shape[1]) for j in range(i + 1, cells.shape[1])])
        places.append(corners[:, pairs].mean(axis=2))
    out[nodes] = np.concatenate(places, axis=1)
    return out


def without(space: StateSpace, capability: str) -> StateSpace:
    """Return `space` without one of its capabilities "points", "cells" or "boundary"."""
    methods = {"points": "evaluation", "cells": "cells", "boundary": "boundary_mean"}
    shown = {methods[name] for name in space.capabilities - {capability}}
    return _view(space, shown, {})


def renumbered(space: StateSpace, seed: int = 0) -> tuple[StateSpace, IntArray]:
    """Return `space` with the nodes of every field in another order, and where each dof went (n_dofs,)."""
    rng = np.random.default_rng(seed)
    layout = space.layout
    place = {field.name: rng.permutation(layout.nodes[field.name]) for field in layout.fields}
    dofs = np.concatenate(
        [
            layout.component(field.name, c).start + place[field.name]
            for field in layout.fields
            for c in range(field.components)
        ]
    )
    columns = np.argsort(dofs)

    def product(self: StateSpace, field: str, kind: Product = "l2") -> Sparse:
        order = np.argsort(place[field])
        return csr_array(csr_array(space.scalar_product(field, kind))[order][:, order])

    def evaluation(self: StateSpace, points: Array, field: str, derivative: int | None = None) -> Sparse:
        return csr_array(csr_array(space.evaluation(points, field, derivative))[:, columns])

    def boundary_mean(self: StateSpace, role: str, field: str) -> Sparse:
        return csr_array(csr_array(space.boundary_mean(role, field))[:, columns])

    def cells(self: StateSpace) -> CellGeometry:
        old = space.cells()
        vertex = rng.permutation(len(old.points))
        return CellGeometry(
            old.points[np.argsort(vertex)],
            vertex[old.cells],
            {name: place[name][nodes] for name, nodes in old.nodes.items()},
            old.orders,
        )

    own = {"evaluation": evaluation, "cells": cells, "boundary_mean": boundary_mean}
    methods = {"points": "evaluation", "cells": "cells", "boundary": "boundary_mean"}
    shown = {methods[name] for name in space.capabilities}
    view = _view(space, shown, {"scalar_product": product} | {name: own[name] for name in shown})
    return view, dofs


def _view(space: StateSpace, shown: set[str], own: dict[str, Any]) -> StateSpace:
    """A space that answers as `space` does, with some methods of its own and some left out."""

    def passed_on(name: str) -> Any:
        def method(self: StateSpace, *arguments: Any, **named: Any) -> Any:
            return getattr(space, name)(*arguments, **named)

        return method

    members = {name: passed_on(name) for name in ("scalar_product", *shown)} | own
    members["layout"] = property(lambda self: space.layout)
    made: StateSpace = type("View", (StateSpace,), members)()
    return made
