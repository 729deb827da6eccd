"""Where the entries of cell matrices go in a CSR matrix, found once for each pair of elements."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse

# Cells looked up at once: bounds the work space at P2 on tetrahedra (100 entries a cell) to some tens of MB.
_CELLS = 16384


class Pattern:
    """Sparsity of the forms between two elements, and the place of every cell entry in it.

    A form on the pattern is an array (nnz,) of values, in the order of CSR with sorted columns.

    Parameters
    ----------
    trial : (n_trial, c) int array
        Column numbers of each cell.
    test : (n_test, c) int array
        Row numbers of each cell.
    shape : (int, int)
        Rows and columns of the matrix.
    """

    def __init__(self, trial: IntArray, test: IntArray, shape: tuple[int, int]) -> None:
        self.shape = shape
        graph = csr_array(_incidence(test, shape[0]).T.tocsr() @ _incidence(trial, shape[1]))
        graph.sort_indices()
        self.nnz = int(graph.nnz)
        self._indices, self._indptr = graph.indices, graph.indptr
        # A matrix that holds its own entry numbers answers where an entry (row, column) stands.
        number = self._matrix(np.arange(self.nnz, dtype=np.int64))
        self._place = np.empty((len(trial), len(test), trial.shape[1]), dtype=_index_type(self.nnz))
        for start in range(0, trial.shape[1], _CELLS):
            part = slice(start, start + _CELLS)
            rows, cols = np.broadcast_arrays(test[None, :, part], trial[:, None, part])
            self._place[:, :, part] = np.asarray(number[rows.ravel(), cols.ravel()]).reshape(rows.shape)

    def scatter(self, chunks: Iterable[tuple[slice, list[Array]]], n_forms: int) -> list[Array]:
        """Add up the cell matrices (n_trial, n_test, cells) of several forms to values (nnz,) each."""
        totals = [np.zeros(self.nnz) for _ in range(n_forms)]
        for part, matrices in chunks:
            place = self._place[:, :, part].ravel()
            for total, matrix in zip(totals, matrices, strict=True):
                np.add.at(total, place, matrix.ravel())
        return totals

    def transpose(self, values: Array) -> Array:
        """Values of the transposed form, for equal trial and test elements."""
        return np.asarray(self._matrix(values).T.tocsr().data)

    def block(self, rows: int, cols: int, values: Callable[[int, int], Array]) -> Sparse:
        """Matrix of `rows` × `cols` blocks of this pattern.

        Parameters
        ----------
        rows, cols : int
            Number of blocks.
        values : callable
            ``values(a, b)`` gives the values (nnz,) of block (a, b); asked once for each, so that
            one block at a time is in memory besides the result.
        """
        size = self.nnz * rows * cols
        kind = _index_type(max(size, rows * self.shape[0], cols * self.shape[1]))
        counts = np.diff(self._indptr).astype(kind)
        # Row r of the result is row r of each block in turn: entry k of the first block moves behind
        # the other blocks' earlier rows, and further by one row length for each block to the left.
        first = np.arange(self.nnz, dtype=kind) + np.repeat((cols - 1) * self._indptr[:-1].astype(kind), counts)
        length = np.repeat(counts, counts)
        data, indices = np.empty((rows, cols * self.nnz)), np.empty(cols * self.nnz, dtype=kind)
        for b in range(cols):
            place = first + b * length
            indices[place] = self._indices + kind(b * self.shape[1])
            for a in range(rows):
                data[a, place] = values(a, b)
        indptr = np.concatenate([np.zeros(1, dtype=kind), np.cumsum(np.tile(cols * counts, rows), dtype=kind)])
        matrix = csr_array(
            (data.ravel(), np.tile(indices, rows), indptr), shape=(rows * self.shape[0], cols * self.shape[1])
        )
        matrix.has_canonical_format = True
        return matrix

    def _matrix(self, values: NDArray[Any]) -> Sparse:
        """One block that shares this pattern's indices; for work inside this class only."""
        return csr_array((values, self._indices, self._indptr), shape=self.shape)


def _incidence(nodes: IntArray, n: int) -> Sparse:
    """Which cell has which node, (c, n), boolean so that no sum of entries can cancel or overflow."""
    start = np.arange(nodes.shape[1] + 1) * len(nodes)
    return csr_array((np.ones(nodes.size, dtype=bool), nodes.T.ravel(), start), shape=(nodes.shape[1], n))


def _index_type(largest: int) -> type[np.signedinteger]:
    """Return int32 where it can hold `largest`, which halves the memory of indices."""
    return np.int32 if largest < 2**31 else np.int64
