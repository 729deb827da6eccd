"""The first waist: what a finite element backend gives, for any physics."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from dacore.core.arrays import Array, Sparse
from dacore.core.fields import Field, Layout
from dacore.core.mesh import Mesh


class Discretization(ABC):
    """Fields on a mesh and the standard forms between them.

    Every form is a ``csr_array`` over the dofs of its fields alone, ordered component by
    component and node by node (nodes as in `Mesh.nodes`). Rows belong to the test function.
    `fields` and `mesh` are what the backend was asked for.
    """

    mesh: Mesh
    fields: tuple[Field, ...]

    @property
    def layout(self) -> Layout:
        """Canonical dof order of the whole state."""
        orders = {field.order for field in self.fields}
        count = {order: len(self.mesh.nodes(order)) for order in orders}
        return Layout(self.fields, {field.name: count[field.order] for field in self.fields})

    @abstractmethod
    def scalar_mass(self, field: str) -> Sparse:
        """∫ a b for one component of `field`: (n_nodes, n_nodes)."""

    @abstractmethod
    def scalar_stiffness(self, field: str) -> Sparse:
        """∫ ∇a·∇b for one component of `field`: (n_nodes, n_nodes)."""

    @abstractmethod
    def strain(self, field: str) -> Sparse:
        """∫ ε(a):ε(b) of a vector field: (n_field, n_field)."""

    @abstractmethod
    def divergence(self, field: str) -> Sparse:
        """∫ (∇·a)(∇·b) of a vector field: (n_field, n_field)."""

    @abstractmethod
    def gradient_coupling(self, scalar: str, vector: str) -> Sparse:
        """∫ ∇p·v, v the test function: (n_vector, n_scalar)."""

    @abstractmethod
    def divergence_coupling(self, vector: str, scalar: str) -> Sparse:
        """∫ q ∇·u, q the test function: (n_scalar, n_vector)."""

    @abstractmethod
    def scalar_boundary_mass(self, field: str, role: str) -> Sparse:
        """∫ a b over the boundary `role` for one component: (n_nodes, n_nodes)."""

    @abstractmethod
    def boundary_coupling(self, scalar: str, vector: str, role: str) -> Sparse:
        """∫ p v·n over the boundary `role`, n outward, v the test function: (n_vector, n_scalar)."""

    @abstractmethod
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
            If a point lies outside the mesh.
        """


class Backend(ABC):
    """A finite element library. Its plugin class is constructed without arguments."""

    name: str

    @abstractmethod
    def discretize(self, mesh: Mesh, fields: Sequence[Field]) -> Discretization:
        """Put `fields` on `mesh`; forms are assembled when first asked for."""

    def version(self) -> str:
        """Version of the library."""
        return "unknown"
