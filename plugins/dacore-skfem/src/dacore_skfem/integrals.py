"""scikit-fem on a dacore mesh: its integrals over cells and boundary pieces, in canonical node order."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import (
    BilinearForm,
    CellBasis,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    FacetBasis,
    MeshTet,
    MeshTri,
)

from dacore.core.arrays import Array, IntArray
from dacore.core.mesh import Mesh
from dacore.core.simplex import local_edges

_ELEMENTS = {(2, 1): ElementTriP1, (2, 2): ElementTriP2, (3, 1): ElementTetP1, (3, 2): ElementTetP2}

# scikit-fem holds every basis function at every quadrature point of the cells it integrates over.
# A few thousand cells at a time keep that in the processor's cache.
CHUNK = 4096


@dataclass(frozen=True, eq=False)
class CanonicalDofs:
    """Node numbers of scikit-fem's basis functions, given to it instead of its own numbering.

    Parameters
    ----------
    element_dofs : (n_local, c) int array
        In scikit-fem's local order.
    N : int
        Number of nodes.
    """

    element_dofs: IntArray
    N: int


def element(dim: int, order: int) -> Any:
    """Return scikit-fem's Lagrange element of order 1 or 2 on a `dim`-simplex."""
    return _ELEMENTS[dim, order]()


def local_order(dim: int, order: int) -> IntArray:
    """For each local node of scikit-fem, its local number in dacore's order.

    Read off the places of scikit-fem's nodes on the reference simplex, whose barycentric
    coordinates name the vertex or the edge they belong to.
    """
    where = np.asarray(element(dim, order).doflocs, dtype=np.float64)
    barycentric = np.column_stack([1.0 - where.sum(axis=1), where])
    names: list[tuple[int, ...]] = [(k,) for k in range(dim + 1)] + [*local_edges(dim)]
    return np.array([names.index(tuple(np.flatnonzero(row > 0.25).tolist())) for row in barycentric], dtype=np.int64)


def canonical_dofs(mesh: Mesh, order: int) -> CanonicalDofs:
    """Canonical node numbers of all cells, in scikit-fem's local order."""
    nodes = mesh.cell_nodes(order)[:, local_order(mesh.dim, order)]
    return CanonicalDofs(np.ascontiguousarray(nodes.T), len(mesh.nodes(order)))


def skfem_mesh(points: Array, cells: IntArray) -> Any:
    """scikit-fem's mesh of the same cells; it must not sort the vertices of a cell."""
    kind = MeshTri if points.shape[1] == 2 else MeshTet
    return kind(np.ascontiguousarray(points.T), np.ascontiguousarray(cells.T), sort_t=False)


class CellIntegrals:
    """Cell matrices of forms between two elements on one mesh.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._skfem = skfem_mesh(mesh.points, mesh.cells)
        self._mapping = self._skfem.mapping()
        self._dofs: dict[int, CanonicalDofs] = {}

    def dofs(self, order: int) -> CanonicalDofs:
        """Canonical node numbers of elements of `order`."""
        if order not in self._dofs:
            self._dofs[order] = canonical_dofs(self.mesh, order)
        return self._dofs[order]

    def chunks(
        self, forms: Sequence[BilinearForm], trial: int, test: int, degree: int, weight: Array | None = None
    ) -> Iterator[tuple[slice, list[Array]]]:
        """Cell matrices of several forms, some thousand cells at a time.

        Parameters
        ----------
        forms : sequence of BilinearForm
        trial, test : int
            Orders of the elements.
        degree : int
            Degree of the integrand's polynomial; the quadrature is exact for it.
        weight : (c,) array, optional
            Factor of each cell.

        Yields
        ------
        cells : slice
        matrices : list of (n_trial, n_test, cells) arrays
            In scikit-fem's local order.
        """
        total = len(self.mesh.cells)
        for start in range(0, total, CHUNK):
            part = slice(start, min(start + CHUNK, total))
            bases = {order: self._basis(order, part, degree) for order in {trial, test}}
            matrices = [_local(form, bases[trial], bases[test]) for form in forms]
            yield part, matrices if weight is None else [matrix * weight[part] for matrix in matrices]

    def _basis(self, order: int, part: slice, degree: int) -> CellBasis:
        return CellBasis(
            self._skfem,
            element(self.mesh.dim, order),
            mapping=self._mapping,
            intorder=max(degree, 1),
            elements=np.arange(part.start, part.stop),
            dofs=self.dofs(order),
            disable_doflocs=True,
        )


def _local(form: BilinearForm, trial: CellBasis, test: CellBasis) -> Array:
    data = form.coo_data(trial, test).data
    return np.asarray(data.reshape(trial.Nbfun, test.Nbfun, trial.nelems))


class FacetIntegrals:
    """Matrices of forms over the boundary facets of one role.

    Only the cells that touch the role enter scikit-fem's mesh, so the cost is that of the surface.

    Parameters
    ----------
    mesh : Mesh
    role : str
    """

    def __init__(self, mesh: Mesh, role: str) -> None:
        wanted = np.sort(mesh.boundary_facets(role), axis=1)
        touched = np.zeros(len(mesh.points), dtype=bool)
        touched[wanted] = True
        self._mesh = mesh
        self._cells = np.flatnonzero(touched[mesh.cells].sum(axis=1) >= mesh.dim)
        vertices, local = np.unique(mesh.cells[self._cells], return_inverse=True)
        self._skfem = skfem_mesh(mesh.points[vertices], local.reshape(-1, mesh.dim + 1))
        self._mapping = self._skfem.mapping()
        facets = np.sort(vertices[self._skfem.facets.T], axis=1)
        _, label = np.unique(np.concatenate([wanted, facets]), axis=0, return_inverse=True)
        self._facets = np.flatnonzero(np.isin(label.ravel()[len(wanted) :], label.ravel()[: len(wanted)]))

    def assemble(self, form: BilinearForm, trial: int, test: int, degree: int) -> Any:
        """Matrix (n_test, n_trial) of a form whose integrand has `degree`; ``w.n`` is the outward normal."""
        bases = {order: self._basis(order, degree) for order in {trial, test}}
        return form.assemble(bases[trial], bases[test])

    def _basis(self, order: int, degree: int) -> FacetBasis:
        dofs = canonical_dofs(self._mesh, order)
        return FacetBasis(
            self._skfem,
            element(self._mesh.dim, order),
            mapping=self._mapping,
            intorder=max(degree, 1),
            facets=self._facets,
            dofs=CanonicalDofs(dofs.element_dofs[:, self._cells], dofs.N),
            disable_doflocs=True,
        )
