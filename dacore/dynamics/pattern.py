"""Sums of sparse matrices with varying coefficients, on one sparsity pattern made once.

Adding sparse matrices merges their patterns anew each time; for many samples of a parameter this
costs more than the numbers. Here the union of the patterns is made once, and a sum is a sum of
value vectors.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.errors import ShapeError


class PatternSum:
    """Σ_i c_i · T_i for fixed matrices T_i of one shape.

    Parameters
    ----------
    matrices : sequence of (r, n) csr_array
    shape : (r, n)
    """

    def __init__(self, matrices: Sequence[Sparse], shape: tuple[int, int]) -> None:
        union = csr_array(shape, dtype=np.float64)
        clean = []
        for matrix in matrices:
            if matrix.shape != shape:
                raise ShapeError(f"matrices of a sum: got shape {matrix.shape}, expected {shape}")
            canonical = csr_array(matrix, copy=True)
            canonical.sum_duplicates()
            canonical.sort_indices()
            clean.append(canonical)
            ones = csr_array((np.ones(canonical.nnz), canonical.indices, canonical.indptr), shape=shape)
            union = csr_array(union + ones)
        union.sort_indices()
        keys = _keys(union)
        self._indices, self._indptr, self._shape = union.indices, union.indptr, shape
        self._values: list[Array] = [matrix.data for matrix in clean]
        self._places: list[IntArray] = [np.searchsorted(keys, _keys(matrix)) for matrix in clean]

    def combine(self, coefficients: Array) -> Sparse:
        """Return Σ_i c_i T_i (r, n) for coefficients (k,)."""
        data = np.zeros(len(self._indices))
        for coefficient, values, places in zip(coefficients, self._values, self._places, strict=True):
            data[places] += coefficient * values
        return csr_array((data, self._indices, self._indptr), shape=self._shape)


def _keys(matrix: Sparse) -> IntArray:
    """One number for each stored entry, increasing in canonical order."""
    rows = np.repeat(np.arange(matrix.shape[0], dtype=np.int64), np.diff(matrix.indptr))
    return np.asarray(rows * matrix.shape[1] + matrix.indices, dtype=np.int64)
