"""What estimation sees of a state: fields, inner products, evaluation. No PDE, no mesh library."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import block_diag, coo_array, csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.display import Card, Displayed
from dacore.core.fields import Field, Layout
from dacore.errors import CapabilityError, ShapeError

Product = Literal["l2", "h1"]


@dataclass(frozen=True, eq=False, repr=False)
class CellGeometry(Displayed):
    """The cells of a state's domain and the polynomials on them: what exact averages need.

    Parameters
    ----------
    points : (n, d) array [cm]
        Vertices.
    cells : (c, d + 1) int array
        Positively oriented simplices.
    nodes : mapping of str to (c, n_local) int array
        For each field, the node numbers of each cell in the local order of
        `dacore.core.simplex.lagrange`; a dof is ``component · n_nodes + node`` in the field's block.
    orders : mapping of str to int
        Polynomial order of each field.
    """

    points: Array
    cells: IntArray
    nodes: Mapping[str, IntArray]
    orders: Mapping[str, int]


class StateSpace(Displayed, ABC):
    """A finite-dimensional space of states with named fields.

    A state is a column (n_dofs,) in the order of `layout`. Inner products act component by
    component, so one scalar matrix for each field says everything about them.
    """

    def _card(self) -> Card:
        layout = self.layout._card()
        offers = ", ".join(sorted(self.capabilities)) or "none"
        return Card(type(self).__name__, (*layout.facts, ("capabilities", offers)), layout.tables)

    @property
    @abstractmethod
    def layout(self) -> Layout:
        """Fields and dof order."""

    @abstractmethod
    def scalar_product(self, field: str, kind: Product = "l2") -> Sparse:
        """Inner product (n_nodes, n_nodes) of one component of `field`, symmetric positive definite.

        Parameters
        ----------
        field : str
        kind : {"l2", "h1"}

        Returns
        -------
        (n_nodes, n_nodes) csr_array
        """

    def evaluation(self, points: Array, field: str, derivative: int | None = None) -> Sparse:
        """Values (or one partial derivative) of `field` at points (capability "points").

        Parameters
        ----------
        points : (p, d) array [cm]
        field : str
        derivative : int, optional
            Axis of the derivative; None evaluates the field itself.

        Returns
        -------
        (p · c, n_dofs) csr_array
            Row ``component · p + point``.

        Raises
        ------
        ShapeError
            If a point lies outside the domain; the message names the first.
        """
        raise CapabilityError(f"{type(self).__name__} has no points in space; observe something else of it")

    def cells(self) -> CellGeometry:
        """Cells and local polynomials (capability "cells").

        Returns
        -------
        CellGeometry
        """
        raise CapabilityError(f"{type(self).__name__} has no cells; use an observation that needs points only")

    def boundary_mean(self, role: str, field: str) -> Sparse:
        """Mean of each component of `field` over the boundary `role`, (c, n_dofs) (capability "boundary").

        Parameters
        ----------
        role, field : str

        Returns
        -------
        (c, n_dofs) csr_array
        """
        raise CapabilityError(f"{type(self).__name__} has no boundary; ask for a quantity of another kind")

    @property
    def capabilities(self) -> frozenset[str]:
        """Which optional capabilities the space has: "points", "cells", "boundary"."""
        methods = {"points": "evaluation", "cells": "cells", "boundary": "boundary_mean"}
        own, base = type(self), StateSpace
        return frozenset(name for name, method in methods.items() if getattr(own, method) is not getattr(base, method))

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of a state."""
        return self.layout.fields

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom."""
        return self.layout.n_dofs

    def place(self, scalar: Sparse, field: str, components: Sequence[int]) -> Sparse:
        """Put scalar functionals (p, n_nodes) on components of a field: (p · len(components), n_dofs).

        Parameters
        ----------
        scalar : (p, n_nodes) csr_array
        field : str
        components : sequence of int

        Returns
        -------
        (p · len(components), n_dofs) csr_array
        """
        block = coo_array(scalar)
        starts = [self.layout.component(field, c).start for c in components]
        rows = np.concatenate([block.row + k * scalar.shape[0] for k in range(len(starts))])
        cols = np.concatenate([block.col + start for start in starts])
        data = np.tile(block.data, len(starts))
        return csr_array((data, (rows, cols)), shape=(len(starts) * scalar.shape[0], self.n_dofs))

    def field_product(self, field: str, kind: Product = "l2") -> Sparse:
        """Inner product (n_field, n_field) of all components of `field`.

        Parameters
        ----------
        field : str
        kind : {"l2", "h1"}

        Returns
        -------
        (n_field, n_field) csr_array
        """
        blocks = [self.scalar_product(field, kind)] * self.layout.field(field).components
        return csr_array(block_diag(blocks, format="csr"))

    def inner_product(self, weights: Mapping[str, float], kind: Product = "l2") -> Sparse:
        """Weighted inner product Σ_f weights[f] ⟨·,·⟩_f.

        Parameters
        ----------
        weights : mapping of str to float
            A positive weight for each field: {"u": 1, "p": ζ}.
        kind : {"l2", "h1"}

        Returns
        -------
        (n_dofs, n_dofs) csr_array
        """
        blocks = []
        for field in self.fields:
            weight = weights.get(field.name, 0.0)
            if not weight > 0:
                raise ShapeError(f"weight of field {field.name}: got {weight}, expected a positive number")
            blocks.append(weight * self.field_product(field.name, kind))
        return csr_array(block_diag(blocks, format="csr"))
