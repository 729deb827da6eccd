"""Symmetric Gauss–Seidel: two triangular solves in place of the inverse of a positive definite matrix."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from dacore.core.arrays import BoolArray, Sparse

Single = NDArray[np.float32]


class GaussSeidel:
    """x = (D + L)⁻ᵀ D (D + L)⁻¹ b for a positive definite A = L + D + Lᵀ, in single precision.

    One sweep forward and one backward from zero. It takes the time of a product with A: scipy's SuperLU makes the
    triangular solves, whose factors of a triangle in its own order are the triangle itself.

    Parameters
    ----------
    matrix : (n, m) csr_array
        A in its first n columns, with no entry twice; the others are not looked at.
    """

    def __init__(self, matrix: Sparse) -> None:
        n = matrix.shape[0]
        self._diagonal: Single = matrix.diagonal().astype(np.float32)
        rows = np.repeat(np.arange(n, dtype=matrix.indices.dtype), np.diff(matrix.indptr))
        self._below = csr_array(_chosen(matrix, matrix.indices < rows), shape=(n, n))
        # The rows of the upper triangle are the columns of the lower one.
        lower = csc_array(_chosen(matrix, (matrix.indices >= rows) & (matrix.indices < n)), shape=(n, n))
        del rows
        self._triangle = splu(
            lower,
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,  # the pivots are on the diagonal
            relax=1,
            panel_size=1,
            options={"Equil": False, "SymmetricMode": True},
        )

    def __call__(self, load: Single) -> Single:
        """Return x for a load b (n,)."""
        return np.asarray(self._triangle.solve(self._forward(load), trans="T"))

    def with_image(self, load: Single) -> tuple[Single, Single]:
        """Return x and A x.

        With z = D (D + L)⁻¹ b, A x = L x + (D + L)ᵀ x = L x + z costs half a product (Eisenstat, SIAM J. Sci. Stat.
        Comput. 2, 1981).
        """
        forward = self._forward(load)
        solution = np.asarray(self._triangle.solve(forward, trans="T"))
        forward += self._below @ solution
        return solution, forward

    def _forward(self, load: Single) -> Single:
        half = np.asarray(self._triangle.solve(load))
        half *= self._diagonal
        return half


def _chosen(matrix: Sparse, chosen: BoolArray) -> tuple[Single, NDArray[Any], NDArray[Any]]:
    """Values in single precision, indices and row starts of some of the entries."""
    ends = np.concatenate([[0], np.cumsum(chosen, dtype=np.int64)])[matrix.indptr]
    return matrix.data[chosen].astype(np.float32), matrix.indices[chosen], ends.astype(matrix.indptr.dtype)
