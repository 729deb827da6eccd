"""The first waist: what a finite element backend gives, for any physics.

A backend implements `Backend` and `Assembler`, by element order alone. `Discretization` is what a
physics sees: fields by name, each form checked, brought to one order of dofs and kept.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse, as_array
from dacore.core.fields import Field, Layout
from dacore.core.mesh import Mesh
from dacore.errors import DacoreError, PluginError, ShapeError


class Assembler(ABC):
    """The standard forms of continuous Lagrange elements on one mesh, integrated by one library.

    Orders are 1 or 2, and may differ between the two elements of a form. Forms are exact: quadrature
    of sufficient order on affine cells. Rows belong to the test function. A dof of a vector element
    is ``component · n_nodes + node``, a node's number is its row in ``mesh.nodes(order)``, whatever
    numbering the library uses inside. Matrices may be of any sparse type, with any sparsity; entries
    given more than once are added. Each is asked for once: nothing needs to be kept for a second time.

    A `weight` (c,) multiplies the integrand on each cell, in the order of ``mesh.cells``: a coefficient that is
    constant on a cell, not negative. None is one everywhere.
    """

    @abstractmethod
    def mass(self, order: int, weight: Array | None = None) -> Any:
        """∫ a b: (n, n)."""

    @abstractmethod
    def stiffness(self, order: int, weight: Array | None = None) -> Any:
        """∫ ∇a·∇b: (n, n)."""

    @abstractmethod
    def strain(self, order: int, weight: Array | None = None) -> Any:
        """∫ ε(a):ε(b), ε the symmetric gradient of vectors: (d n, d n)."""

    @abstractmethod
    def divergence(self, order: int, weight: Array | None = None) -> Any:
        """∫ (∇·a)(∇·b) of vectors: (d n, d n)."""

    @abstractmethod
    def gradient_coupling(self, scalar: int, vector: int, weight: Array | None = None) -> Any:
        """∫ ∇p·v, v the test function of order `vector`, p of order `scalar`: (d n_vector, n_scalar)."""

    @abstractmethod
    def divergence_coupling(self, vector: int, scalar: int, weight: Array | None = None) -> Any:
        """∫ q ∇·u, q the test function of order `scalar`, u of order `vector`: (n_scalar, d n_vector)."""

    @abstractmethod
    def boundary_mass(self, order: int, role: str) -> Any:
        """∫ a b over the facets ``mesh.boundary_facets(role)``: (n, n)."""

    @abstractmethod
    def boundary_coupling(self, scalar: int, vector: int, role: str) -> Any:
        """∫ p v·n over the facets of `role`, n outward, v the test function: (d n_vector, n_scalar)."""

    @abstractmethod
    def evaluation(self, points: Array, order: int, derivative: int | None) -> Any:
        """Values of the basis functions at points (p, d) [cm], or their partial derivative along an axis: (p, n).

        On a facet between cells, where a derivative jumps, it is that of the cell with the lowest
        number. ShapeError if a point lies outside the mesh; `dacore.geometry.locate` does both.
        """


class Backend(ABC):
    """A finite element library. Its plugin class is constructed without arguments and holds no state.

    Its module should import the library when `assembler` is called and not before: a plan, or a process
    that only solves with matrices, then never loads it.
    """

    name: str

    @abstractmethod
    def assembler(self, mesh: Mesh) -> Assembler:
        """Put the library on a mesh; `Mesh` has checked it."""

    @abstractmethod
    def version(self) -> str:
        """Version of the library, from its installed metadata: no import."""

    @final
    def discretize(self, mesh: Mesh, fields: Sequence[Field]) -> "Discretization":
        """Put `fields` on `mesh`; forms are assembled when first asked for."""
        return Discretization(self, mesh, fields)


@final
class Discretization:
    """Fields on a mesh and the standard forms between them.

    Every form is a ``csr_array`` over the dofs of its fields alone, ordered component by
    component and node by node (nodes as in `Mesh.nodes`), with sorted indices. It is assembled when
    first asked for and kept until `release`; equal elements share it. Rows belong to the test function.
    Forms over cells take a `weight` (c,), one number a cell that multiplies the integrand: a material
    that is not the same everywhere. A form with a weight is not kept.

    Parameters
    ----------
    backend : Backend
    mesh : Mesh
    fields : sequence of Field

    Raises
    ------
    ShapeError
        If there is no field, two have one name, a form does not exist for the field asked for, or a weight
        is not one finite number for each cell, none negative.
    CapabilityError
        If there is no such field.
    MeshError
        If there is no such role.

    Notes
    -----
    A pickle holds the mesh and the fields; forms are assembled anew where they are asked for again.
    """

    def __init__(self, backend: Backend, mesh: Mesh, fields: Sequence[Field]) -> None:
        self.backend = backend
        self.mesh = mesh
        self.fields = tuple(fields)
        self.layout = Layout(self.fields, {field.name: len(mesh.nodes(field.order)) for field in self.fields})
        self._forms: dict[tuple[str | int, ...], Sparse] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Discretization, (self.backend, self.mesh, self.fields)

    def release(self) -> None:
        """Let go of the library and of every form kept; matrices handed out stay, what is asked for again costs again.

        Whoever has a model built calls it: a library keeps as much as the model's own matrices hold.
        """
        self._forms.clear()
        self.__dict__.pop("_assembler", None)

    @cached_property
    def _assembler(self) -> Assembler:
        with self._blame("could not be loaded and put on the mesh"):
            return self.backend.assembler(self.mesh)

    @contextmanager
    def _blame(self, what: str) -> Iterator[None]:
        """Turn whatever a library raises into one line that names the backend: one that is found may still not load."""
        try:
            yield
        except (DacoreError, MemoryError):
            raise
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            whose = "mend its installation" if "loaded" in what else "mend it"
            raise PluginError(
                f"backend {self.backend.name} {what} ({reason}); {whose} or choose another backend"
            ) from error

    def scalar_mass(self, field: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ a b for one component of `field`: (n_nodes, n_nodes)."""
        order = self._order(field)
        n = self._nodes(order)
        return self._over_cells(("mass", order), n, n, weight, lambda a, *w: a.mass(order, *w))

    def scalar_stiffness(self, field: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ ∇a·∇b for one component of `field`: (n_nodes, n_nodes)."""
        order = self._order(field)
        n = self._nodes(order)
        return self._over_cells(("stiffness", order), n, n, weight, lambda a, *w: a.stiffness(order, *w))

    def strain(self, field: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ ε(a):ε(b) of a vector field: (n_field, n_field)."""
        order = self._vector(field)
        n = self._dofs(order)
        return self._over_cells(("strain", order), n, n, weight, lambda a, *w: a.strain(order, *w))

    def divergence(self, field: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ (∇·a)(∇·b) of a vector field: (n_field, n_field)."""
        order = self._vector(field)
        n = self._dofs(order)
        return self._over_cells(("divergence", order), n, n, weight, lambda a, *w: a.divergence(order, *w))

    def gradient_coupling(self, scalar: str, vector: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ ∇p·v, v the test function: (n_vector, n_scalar)."""
        p, v = self._scalar(scalar), self._vector(vector)
        return self._over_cells(
            ("gradient coupling", p, v), self._dofs(v), self._nodes(p), weight,
            lambda a, *w: a.gradient_coupling(p, v, *w),
        )  # fmt: skip

    def divergence_coupling(self, vector: str, scalar: str, weight: ArrayLike | None = None) -> Sparse:
        """∫ q ∇·u, q the test function: (n_scalar, n_vector)."""
        u, q = self._vector(vector), self._scalar(scalar)
        return self._over_cells(
            ("divergence coupling", u, q), self._nodes(q), self._dofs(u), weight,
            lambda a, *w: a.divergence_coupling(u, q, *w),
        )  # fmt: skip

    def scalar_boundary_mass(self, field: str, role: str) -> Sparse:
        """∫ a b over the boundary `role` for one component: (n_nodes, n_nodes)."""
        order = self._order(field)
        self.mesh.boundary_facets(role)
        return self._once(
            ("boundary mass", order, role), self._nodes(order), self._nodes(order),
            lambda a: a.boundary_mass(order, role),
        )  # fmt: skip

    def boundary_coupling(self, scalar: str, vector: str, role: str) -> Sparse:
        """∫ p v·n over the boundary `role`, n outward, v the test function: (n_vector, n_scalar)."""
        p, v = self._scalar(scalar), self._vector(vector)
        self.mesh.boundary_facets(role)
        return self._once(
            ("boundary coupling", p, v, role), self._dofs(v), self._nodes(p),
            lambda a: a.boundary_coupling(p, v, role),
        )  # fmt: skip

    def evaluation(self, points: Array, field: str, derivative: int | None = None) -> Sparse:
        """Values or one partial derivative of one component of `field` at points.

        Parameters
        ----------
        points : (p, d) array [cm]
        field : str
        derivative : int, optional
            Axis of the derivative.

        Returns
        -------
        (p, n_nodes) csr_array

        Raises
        ------
        ShapeError
            If a point lies outside the mesh or there is no such axis.
        """
        order = self._order(field)
        if derivative is not None and not 0 <= derivative < self.mesh.dim:
            raise ShapeError(f"axis of the derivative: got {derivative}, expected 0 to {self.mesh.dim - 1}")
        where = as_array("evaluation points", points, (None, self.mesh.dim))
        assembler = self._assembler
        with self._blame("could not evaluate the basis functions"):
            made = assembler.evaluation(where, order, derivative)
        return self._canonical("evaluation", made, len(where), self._nodes(order))

    def _over_cells(
        self,
        key: tuple[str | int, ...],
        rows: int,
        columns: int,
        weight: ArrayLike | None,
        assemble: Callable[..., Any],
    ) -> Sparse:
        """Return a form whose integrand may be weighted; `assemble` takes an assembler and a weight if there is one."""
        if weight is None:
            return self._once(key, rows, columns, assemble)
        form = f"{key[0]} with a weight"
        given = as_array(f"weight of {key[0]}", weight, (len(self.mesh.cells),))
        negative = np.flatnonzero(given < 0)
        if negative.size:
            raise ShapeError(
                f"weight of {key[0]}: {negative.size} of {given.size} are negative (first: {given[negative[0]]:g} on "
                f"cell {negative[0]}), expected none below 0"
            )
        return self._assembled(form, rows, columns, lambda assembler: assemble(assembler, given))

    def _once(
        self, key: tuple[str | int, ...], rows: int, columns: int, assemble: Callable[[Assembler], Any]
    ) -> Sparse:
        if key not in self._forms:
            self._forms[key] = self._assembled(str(key[0]), rows, columns, assemble)
        return self._forms[key]

    def _assembled(self, form: str, rows: int, columns: int, assemble: Callable[[Assembler], Any]) -> Sparse:
        assembler = self._assembler
        with self._blame(f"could not assemble {form}"):
            made = assemble(assembler)
        return self._canonical(form, made, rows, columns)

    def _canonical(self, form: str, made: Any, rows: int, columns: int) -> Sparse:
        """Return what a backend made as a csr_array with sorted indices, no entry twice; PluginError if it is none."""
        with self._blame(f"gave {form} as {type(made).__name__}, expected a sparse matrix"):
            matrix = csr_array(made)
        if matrix.shape != (rows, columns):
            raise PluginError(
                f"backend {self.backend.name}: {form} has shape {matrix.shape}, expected {(rows, columns)}; "
                "run dacore.testing's checks on the backend"
            )
        if matrix.dtype != np.float64:
            matrix = matrix.astype(np.float64)
        if not np.isfinite(matrix.data).all():
            raise PluginError(f"backend {self.backend.name}: {form} holds NaN or infinite values")
        matrix.sum_duplicates()
        return matrix

    def _nodes(self, order: int) -> int:
        return len(self.mesh.nodes(order))

    def _dofs(self, order: int) -> int:
        return self.mesh.dim * self._nodes(order)

    def _order(self, field: str) -> int:
        return self.layout.field(field).order

    def _scalar(self, field: str) -> int:
        return self._checked(field, 1, "a scalar field (1 component)")

    def _vector(self, field: str) -> int:
        return self._checked(field, self.mesh.dim, f"a vector field ({self.mesh.dim} components)")

    def _checked(self, field: str, components: int, expected: str) -> int:
        has = self.layout.field(field).components
        if has != components:
            raise ShapeError(f"field {field}: this form is for {expected}, got {has}")
        return self._order(field)
