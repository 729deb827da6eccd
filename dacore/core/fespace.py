"""The state space of any discretisation."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse
from dacore.core.discretization import Discretization
from dacore.core.display import Card, count
from dacore.core.fields import Layout
from dacore.core.space import CellGeometry, Product, StateSpace
from dacore.errors import ShapeError


class FiniteElementSpace(StateSpace):
    """States of a `Discretization`: L² and H¹ products, evaluation, cells and boundary means.

    Parameters
    ----------
    discretization : Discretization
    """

    def __init__(self, discretization: Discretization) -> None:
        self.discretization = discretization
        self._products: dict[tuple[int, Product], Sparse] = {}

    def _card(self) -> Card:
        card, mesh = super()._card(), self.discretization.mesh
        library = type(self.discretization.backend).__name__
        about = ("mesh", f"{count(len(mesh.points), 'node')}, {count(len(mesh.cells), 'cell')}"), ("backend", library)
        return Card(card.title, (*card.facts, *about), card.tables)

    @cached_property
    def layout(self) -> Layout:
        """Fields and dof order."""
        return self.discretization.layout

    def scalar_product(self, field: str, kind: Product = "l2") -> Sparse:
        """∫ ab ("l2") or ∫ ab + ∇a·∇b ("h1", lengths in cm) of one component."""
        if kind not in ("l2", "h1"):
            raise ShapeError(f"inner product: got {kind!r}, expected 'l2' or 'h1'")
        key = (self.layout.field(field).order, kind)
        if key not in self._products:
            product = self.discretization.scalar_mass(field)
            if kind == "h1":
                product = csr_array(product + self.discretization.scalar_stiffness(field))
            self._products[key] = product
        return self._products[key]

    def evaluation(self, points: Array, field: str, derivative: int | None = None) -> Sparse:
        """Values or one derivative of `field` at points, (p · c, n_dofs)."""
        one = self.discretization.evaluation(points, field, derivative)
        return self.place(one, field, range(self.layout.field(field).components))

    def cells(self) -> CellGeometry:
        """Cells and local polynomials."""
        mesh = self.discretization.mesh
        return CellGeometry(
            mesh.points,
            mesh.cells,
            {field.name: mesh.cell_nodes(field.order) for field in self.fields},
            {field.name: field.order for field in self.fields},
        )

    def boundary_mean(self, role: str, field: str) -> Sparse:
        """Mean over the boundary `role`, ∫ a dΓ / ∫ dΓ, of each component: (c, n_dofs)."""
        mass = self.discretization.scalar_boundary_mass(field, role)
        row = np.asarray(mass.sum(axis=0)).reshape(1, -1)
        return self.place(csr_array(row / row.sum()), field, range(self.layout.field(field).components))
