"""From DOLFINx's order of cells, nodes and facets to that of a dacore mesh."""

from collections.abc import Iterable
from functools import cached_property
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


def canonical_cells(mesh: Mesh, vertices: IntArray) -> IntArray:
    """Cell number (c,) in the mesh of each of DOLFINx's cells, given by their vertices (c, d + 1) in any order."""
    ours, theirs = (np.lexsort(np.sort(cells, axis=1).T) for cells in (mesh.cells, vertices))
    number = np.empty(len(ours), dtype=np.int64)
    number[theirs] = ours
    return number


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
        # A matrix that holds its own entry numbers tells where they stand once it is put in order.
        number = np.arange(len(indices), dtype=_index_type(len(indices)))
        entries = csr_array((number, indices, indptr), shape=(len(rows), len(columns)))[np.argsort(rows)]
        entries.sort_indices()
        self.nnz = len(indices)
        self.shape = (len(rows), len(columns))
        self._place, self._indices, self._indptr = entries.data, entries.indices, entries.indptr

    def canonical(self, values: Array) -> Array:
        """Values (nnz,) in canonical order, a copy; DOLFINx's go in."""
        return np.asarray(values[self._place])

    @cached_property
    def transposed(self) -> IntArray:
        """Place (nnz,) of each entry's mirror image, for equal rows and columns; canonical order."""
        number = np.arange(self.nnz, dtype=self._place.dtype)
        return np.asarray(csr_array((number, self._indices, self._indptr), shape=self.shape).T.tocsr().data)

    def matrix(self, rows: int, columns: int, blocks: Iterable[tuple[int, int, Array]]) -> Sparse:
        """Matrix of ``rows × columns`` blocks with this pattern.

        Parameters
        ----------
        rows, columns : int
        blocks : iterable of (a, b, values)
            The canonical values (nnz,) of each block; one at a time is in memory besides the result.
        """
        kind = _index_type(max(rows * columns * self.nnz, columns * self.shape[1]))
        length = np.diff(self._indptr).astype(kind)
        # In a row of blocks, row r starts behind all blocks' earlier rows, and block b behind b rows of its length.
        first = np.arange(self.nnz, dtype=kind) + np.repeat((columns - 1) * self._indptr[:-1].astype(kind), length)
        step = np.repeat(length, length)
        data = np.empty((rows, columns * self.nnz))
        for a, b, values in blocks:
            data[a, first + b * step] = values
        indices = np.empty((rows, columns * self.nnz), dtype=kind)
        for b in range(columns):
            indices[:, first + b * step] = self._indices + kind(b * self.shape[1])
        indptr = np.concatenate([np.zeros(1, dtype=kind), np.cumsum(np.tile(columns * length, rows), dtype=kind)])
        shape = (rows * self.shape[0], columns * self.shape[1])
        made = csr_array((data.ravel(), indices.ravel(), indptr), shape=shape)
        made.has_canonical_format = True
        return made


def _index_type(largest: int) -> type[np.signedinteger]:
    """Return int32 where it can hold `largest`, which halves the memory of indices."""
    return np.int32 if largest < 2**31 else np.int64
