"""From MFEM's numbering to dacore's, and matrices of blocks that share a sparsity pattern."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse


def renumbered(matrix: Sparse, rows: IntArray, columns: IntArray) -> Sparse:
    """Move entry (i, j) to (rows[i], columns[j]); both are permutations. Indices come out sorted."""
    indices = columns.astype(matrix.indices.dtype)[matrix.indices]
    moved = csr_array((matrix.data, indices, matrix.indptr), shape=matrix.shape)
    if not np.array_equal(rows, np.arange(len(rows))):
        moved = moved[np.argsort(rows)]
    moved.sort_indices()
    return moved


class Pattern:
    """Sparsity of the forms between equal elements, and where MFEM's entries go in it.

    A form on the pattern is an array (nnz,) of values, in the order of CSR with sorted columns.

    Parameters
    ----------
    matrix : (n, n) csr_array
        Any form in MFEM's numbering that holds every entry of the pattern, zeros too.
    nodes : (n,) int array
        Canonical node of each of MFEM's dofs.
    """

    def __init__(self, matrix: Sparse, nodes: IntArray) -> None:
        self.n = len(nodes)
        self.nnz = int(matrix.nnz)
        # A matrix that holds its own entry numbers tells where they go.
        number = csr_array((np.arange(self.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
        canonical = renumbered(number, nodes, nodes)
        self._take: NDArray[np.int64] = canonical.data
        self._indices, self._indptr = canonical.indices, canonical.indptr

    def values(self, matrix: Sparse) -> Array:
        """Values (nnz,) of a form in MFEM's numbering and pattern."""
        return np.asarray(matrix.data[self._take])

    def transpose(self, values: Array) -> Array:
        """Values of the transposed form."""
        return np.asarray(self._matrix(values).T.tocsr().data)

    def block(self, d: int, values: Callable[[int, int], Array]) -> Sparse:
        """Matrix of `d` × `d` blocks of this pattern.

        Parameters
        ----------
        d : int
        values : callable
            ``values(a, b)`` gives the values (nnz,) of block (a, b); asked once for each.
        """
        kind = np.int32 if d * d * self.nnz < 2**31 else np.int64
        length = np.diff(self._indptr).astype(kind)
        # Row r of a row of blocks is row r of each block in turn: entry k of the first moves behind all that
        # the other blocks have in earlier rows; the same entry of the next comes one row length after it.
        place = np.arange(self.nnz, dtype=kind) + np.repeat((d - 1) * self._indptr[:-1].astype(kind), length)
        stride = np.repeat(length, length)
        data, indices = np.empty((d, d * self.nnz)), np.empty(d * self.nnz, dtype=kind)
        for b in range(d):
            indices[place] = self._indices + kind(b * self.n)
            for a in range(d):
                data[a, place] = values(a, b)
            place += stride
        indptr = np.concatenate([np.zeros(1, dtype=kind), np.cumsum(np.tile(d * length, d), dtype=kind)])
        return csr_array((data.ravel(), np.tile(indices, d), indptr), shape=(d * self.n, d * self.n))

    def _matrix(self, values: Array) -> Sparse:
        """One block that shares this pattern's indices; for work inside this class only."""
        return csr_array((values, self._indices, self._indptr), shape=(self.n, self.n))
