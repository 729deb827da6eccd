"""What a check of a backend stands on: the backend, a mesh, and everything assembled there once."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.core.discretization import Assembler, Backend, Discretization
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.testing.compare import Side
from dacore.testing.reference import Reference
from dacore.testing.suite import require

ORDERS = (1, 2)
# Orders of a vector and of a scalar element.
PAIRS = ((1, 1), (2, 1), (1, 2), (2, 2))


def discretize(backend: Backend, mesh: Mesh) -> Discretization:
    """Put the vector fields u1, u2 and the scalar fields p1, p2 of orders 1 and 2 on a mesh."""
    vectors = [Field(f"u{order}", mesh.dim, order) for order in ORDERS]
    return backend.discretize(mesh, [*vectors, *(Field(f"p{order}", 1, order) for order in ORDERS)])


@dataclass(eq=False)
class Stand:
    """A backend on one mesh.

    Parameters
    ----------
    backend : Backend
    name : str
        Of the mesh, for messages: "bumpy 2-D mesh".
    make : callable
        Makes the mesh when it is first needed.
    """

    backend: Backend
    name: str
    make: Callable[[], Mesh] = field(repr=False)

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.make()

    @cached_property
    def discretization(self) -> Discretization:
        """The backend on the mesh with fields u1, u2, p1, p2; shared by all checks of the mesh."""
        made: object = self.assembler()
        good = isinstance(made, Assembler)
        require(good, f"backend {self.backend.name}: assembler(mesh) is a {type(made).__name__}, expected an Assembler")
        return discretize(self.backend, self.mesh)

    @cached_property
    def reference(self) -> Reference:
        """The independent computation of all forms."""
        return Reference(self.mesh)

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return self.mesh.dim

    def fresh(self) -> Discretization:
        """Return a new discretisation on which nothing is assembled yet."""
        return discretize(self.backend, self.mesh)

    def assembler(self) -> Assembler:
        """Return a new assembler on the mesh."""
        return self.backend.assembler(self.mesh)

    def side(self, order: int, vector: bool = False) -> Side:
        """Rows or columns of a field of `order`."""
        return Side(self.mesh.nodes(order), self.dim if vector else 1)

    def where(self, form: str, orders: str) -> str:
        """Form, orders and mesh for a message."""
        return f"backend {self.backend.name}: {form}, {orders}, on the {self.name}"


def every_form(disc: Discretization, reverse: bool = False) -> dict[str, Any]:
    """Every form of a discretisation of `discretize`, by a name that says which.

    Parameters
    ----------
    disc : Discretization
    reverse : bool
        Ask for the forms in the opposite order; they are returned in the same.
    """
    asked: dict[str, Callable[[], Any]] = {}
    for k in ORDERS:
        asked[f"mass, P{k}"] = partial(disc.scalar_mass, f"p{k}")
        asked[f"stiffness, P{k}"] = partial(disc.scalar_stiffness, f"p{k}")
        asked[f"strain, P{k}"] = partial(disc.strain, f"u{k}")
        asked[f"divergence, P{k}"] = partial(disc.divergence, f"u{k}")
    for v, s in PAIRS:
        orders = f"vector P{v}, scalar P{s}"
        asked[f"gradient_coupling, {orders}"] = partial(disc.gradient_coupling, f"p{s}", f"u{v}")
        asked[f"divergence_coupling, {orders}"] = partial(disc.divergence_coupling, f"u{v}", f"p{s}")
    for role in disc.mesh.roles:
        for k in ORDERS:
            asked[f"boundary_mass over {role!r}, P{k}"] = partial(disc.scalar_boundary_mass, f"p{k}", role)
        for v, s in PAIRS:
            name = f"boundary_coupling over {role!r}, vector P{v}, scalar P{s}"
            asked[name] = partial(disc.boundary_coupling, f"p{s}", f"u{v}", role)
    names = list(asked)
    made = {name: asked[name]() for name in (names[::-1] if reverse else names)}
    return {name: made[name] for name in names}


def sample_points(mesh: Mesh, count: int = 40, seed: int = 0) -> Array:
    """Points inside cells, on facets between cells, at the middles of edges and at vertices: (p, d) [cm]."""
    rng = np.random.default_rng(seed)
    cells = mesh.cells[rng.integers(len(mesh.cells), size=count)]
    weights = rng.dirichlet(np.ones(mesh.dim + 1), size=count)
    inside = np.einsum("pi,pid->pd", weights, mesh.points[cells])
    # Any d vertices of a cell are a facet of it.
    between = mesh.points[mesh.cells[:count, : mesh.dim]].mean(axis=1)
    edges = mesh.nodes(2)[len(mesh.points) :][:count]
    return np.concatenate([inside, between, edges, mesh.points[:count]])
