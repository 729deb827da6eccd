"""From DOLFINx's order of cells, nodes and facets to that of a dacore mesh."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.mesh import Mesh
from dacore.core.simplex import local_edges
from dacore_dolfinx import compat


def local_order(dim: int, order: int) -> IntArray:
    """For each local node of Basix, its local number in dacore's order.

    Read off the places of the nodes on the reference simplex, whose barycentric coordinates name
    the vertex or the edge they belong to.
    """
    where = np.asarray(compat.element(dim, order).points, dtype=np.float64)
    barycentric = np.column_stack([1.0 - where.sum(axis=1), where])
    names: list[tuple[int, ...]] = [(k,) for k in range(dim + 1)] + [*local_edges(dim)]
    return np.array([names.index(tuple(np.flatnonzero(row > 0.25).tolist())) for row in barycentric], dtype=np.int64)


def canonical_nodes(mesh: Mesh, vertices: IntArray, order: int) -> IntArray:
    """Node numbers (c, n_local) of cells, in Basix's local order.

    Parameters
    ----------
    mesh : Mesh
    vertices : (c, d + 1) int array
        Cells of the mesh in any order, their vertices in any order.
    order : int
    """
    if order == 1:
        nodes = vertices
    else:
        pairs = np.sort(vertices[:, np.array(local_edges(mesh.dim))], axis=2)
        n = len(mesh.points)
        # The mesh lists its edges in lexicographic order.
        number = np.searchsorted(mesh.edges @ np.array([n, 1]), pairs @ np.array([n, 1]))
        nodes = np.concatenate([vertices, n + number], axis=1)
    return np.asarray(nodes[:, local_order(mesh.dim, order)])


def canonical_dofs(mesh: Mesh, vertices: IntArray, space: Any, order: int) -> IntArray:
    """Node number (n,) of each of DOLFINx's dofs."""
    dofs = np.empty(len(mesh.nodes(order)), dtype=np.int64)
    dofs[compat.cell_dofs(space)] = canonical_nodes(mesh, vertices, order)
    return dofs


def marked_facets(mesh: Mesh, vertices: IntArray, cell_facets: IntArray, role: str) -> IntArray:
    """DOLFINx's numbers of the facets that carry `role`, sorted.

    Parameters
    ----------
    mesh : Mesh
    vertices, cell_facets : (c, d + 1) int arrays
        Vertices and facet numbers of DOLFINx's cells.
    role : str
    """
    exterior = np.bincount(cell_facets.ravel()) == 1
    cell, opposite = np.nonzero(exterior[cell_facets])
    rest = np.array([[i for i in range(mesh.dim + 1) if i != k] for k in range(mesh.dim + 1)])
    have = np.sort(vertices[cell[:, None], rest[opposite]], axis=1)
    want = np.sort(mesh.boundary_facets(role), axis=1)
    _, label = np.unique(np.concatenate([want, have]), axis=0, return_inverse=True)
    found = np.isin(label.ravel()[len(want) :], label.ravel()[: len(want)])
    return np.sort(cell_facets[cell[found], opposite[found]])


class Places:
    """Where the entries of DOLFINx's matrix stand in the canonical one, found once for a sparsity pattern.

    Parameters
    ----------
    matrix : DOLFINx's MatrixCSR
    rows, columns : (n,) int arrays
        Canonical numbers of its rows and columns.
    """

    def __init__(self, matrix: Any, rows: IntArray, columns: IntArray) -> None:
        indptr, indices = np.array(matrix.indptr), columns.astype(np.int32)[np.asarray(matrix.indices)]
        number = np.arange(len(indices), dtype=np.int32 if len(indices) < 2**31 else np.int64)
        entries = csr_array((number, indices, indptr), shape=(len(rows), len(columns)))[np.argsort(rows)]
        entries.sort_indices()
        self._place = entries.data
        self._indices, self._indptr, self._shape = entries.indices, entries.indptr, entries.shape

    def __call__(self, values: Array) -> Sparse:
        """Canonical matrix of the values of DOLFINx's; several share the arrays of their pattern."""
        return csr_array((values[self._place], self._indices, self._indptr), shape=self._shape)
