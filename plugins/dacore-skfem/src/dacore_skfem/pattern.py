"""Where the entries of cell matrices go in a CSR matrix, found once for each pair of elements."""

from collections.abc import Iterable

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse


class Pattern:
    """Sparsity of the forms between two elements, and the place of every cell entry in it.

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
        rows = np.broadcast_to(test[None, :, :], (len(trial), *test.shape))
        cols = np.broadcast_to(trial[:, None, :], rows.shape)
        code = (rows * shape[1] + cols).ravel()
        order = np.argsort(code, kind="stable")
        code = code[order]
        first = np.concatenate([[True], code[1:] != code[:-1]])
        place = np.empty(len(code), dtype=np.int32)
        place[order] = np.cumsum(first) - 1
        self._place = place.reshape(rows.shape)
        unique = code[first]
        self._indices = (unique % shape[1]).astype(np.int32)
        counts = np.bincount(unique // shape[1], minlength=shape[0])
        self._indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def scatter(self, chunks: Iterable[tuple[slice, list[Array]]], n_forms: int) -> list[Sparse]:
        """Add up the cell matrices (n_trial, n_test, cells) of several forms."""
        nnz = len(self._indices)
        data = [np.zeros(nnz) for _ in range(n_forms)]
        for part, matrices in chunks:
            place = self._place[:, :, part].ravel()
            for total, matrix in zip(data, matrices, strict=True):
                total += np.bincount(place, matrix.ravel(), minlength=nnz)
        return [csr_array((values, self._indices, self._indptr), shape=self.shape) for values in data]
