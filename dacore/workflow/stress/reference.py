"""Linear algebra in extended precision: references that share no code with what they check.

`numpy.longdouble` has 64 bits of mantissa or more on every platform dacore supports, 2048 times finer than
double. Where even that is too coarse, cases use mpmath.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, onenormest, splu

from dacore.core.arrays import Array, Sparse
from dacore.errors import CapabilityError, ConvergenceError

Long: TypeAlias = NDArray[np.longdouble]
EPS = float(np.finfo(np.float64).eps)

_ROUNDS = 60


def check_precision() -> None:
    """CapabilityError where `numpy.longdouble` is no longer than double."""
    if np.finfo(np.longdouble).eps > 1e-3 * EPS:
        raise CapabilityError(
            "stress: numpy.longdouble has double precision only on this machine, so there is no reference; "
            "run it on Linux x86-64 or aarch64"
        )


def long(values: Any) -> Long:
    """Values in extended precision."""
    return np.asarray(values, dtype=np.longdouble)


class Extended:
    """Solves K x = b in extended precision: SuperLU in double, residuals in extended, as often as it takes.

    Parameters
    ----------
    matrix : (n, n) sparse array, double or extended

    Attributes
    ----------
    condition : float
        1-norm condition number, estimated, of the matrix with rows and columns scaled to size one.
    columns : (n,) array
        Scale of the columns: the unknowns of the scaled system are x / columns.

    Raises
    ------
    ConvergenceError
        If the matrix is singular to working precision.
    """

    def __init__(self, matrix: Any) -> None:
        self.matrix = csr_array(matrix, dtype=np.longdouble)
        self.rows, self.columns = _equilibrate(csr_array(abs(self.matrix), dtype=np.float64))
        scaled = diags_array(self.rows) @ csr_array(self.matrix, dtype=np.float64) @ diags_array(self.columns)
        scaled = csc_array(scaled)
        try:
            self._factor = splu(scaled)
        except RuntimeError as error:
            raise ConvergenceError(f"reference: {error}; the matrix is singular") from error
        inverse = LinearOperator(
            scaled.shape, matvec=self._factor.solve, rmatvec=lambda x: self._factor.solve(x, trans="T"),
            dtype=np.float64,
        )  # fmt: skip
        self.condition = float(abs(scaled).sum(axis=0).max() * onenormest(inverse))

    def solve(self, right: Any) -> Long:
        """Solve for every column of `right` (n,) or (n, k).

        Raises
        ------
        ConvergenceError
            If the corrections do not settle below 1e-12 of the solution.
        """
        target = long(right)
        columns = target.reshape(len(target), -1)
        out = np.zeros_like(columns)
        for k in range(columns.shape[1]):
            out[:, k] = self._one(columns[:, k])
        return out.reshape(target.shape)

    def _one(self, right: Long) -> Long:
        solution: Long = np.zeros_like(right)
        before = np.inf
        for _ in range(_ROUNDS):
            residual: Long = self.rows * (right - self.matrix @ solution)
            size = np.abs(residual).max(initial=0.0)
            if size == 0:
                return solution
            # Scaled to size one, since double has the narrower range.
            step = self.columns * long(self._factor.solve(np.asarray(residual / size, dtype=np.float64))) * size
            solution = solution + step
            change = float(np.abs(step / self.columns).max() / np.abs(solution / self.columns).max())
            # What is left are the roundings of the residual, times the condition number.
            if change <= 1e-19 or (change < 1e-12 and change > 0.25 * before):
                return solution
            before = change
        raise ConvergenceError("reference: corrections in extended precision do not settle; the matrix is singular")


def _equilibrate(size: Sparse) -> tuple[Array, Array]:
    """Powers of two that bring the largest entry of each row and column near one (Ruiz, 2001)."""
    rows, columns = np.ones(size.shape[0]), np.ones(size.shape[1])
    for _ in range(12):
        scaled = csr_array(diags_array(rows) @ size @ diags_array(columns))
        tall, wide = (np.asarray(scaled.max(axis=axis).todense()).ravel() for axis in (1, 0))
        rows *= 2.0 ** -np.round(0.5 * np.log2(np.where(tall > 0, tall, 1.0)))
        columns *= 2.0 ** -np.round(0.5 * np.log2(np.where(wide > 0, wide, 1.0)))
    return rows, columns


def dense_solve(matrix: Any, right: Any) -> Long:
    """Solve a dense system by elimination with row pivoting in extended precision.

    Parameters
    ----------
    matrix : (n, n) array
    right : (n, k) array

    Raises
    ------
    ConvergenceError
        If a pivot vanishes.
    """
    work = np.concatenate([long(matrix), long(right)], axis=1)
    n = len(work)
    with np.errstate(divide="ignore", invalid="ignore"):
        work = work / np.abs(work[:, :n]).max(axis=1, keepdims=True)
    for k in range(n):
        pivot = k + int(np.argmax(np.abs(work[k:, k])))
        if not np.abs(work[pivot, k]) > 0:
            raise ConvergenceError("reference: the dense system is singular")
        work[[k, pivot]] = work[[pivot, k]]
        work[k] = work[k] / work[k, k]
        work[k + 1 :] -= work[k + 1 :, k : k + 1] * work[k]
    for k in range(n - 1, 0, -1):
        work[:k, n:] -= work[:k, k : k + 1] * work[k, n:]
    return np.asarray(work[:, n:])


def least_squares(matrix: Any, right: Any) -> Long:
    """Least-squares solution of full column rank by Householder reflections in extended precision.

    Parameters
    ----------
    matrix : (m, n) array, m >= n
    right : (m, k) array
    """
    work, target = long(matrix).copy(), long(right).copy()
    n = work.shape[1]
    for k in range(n):
        vector = work[k:, k].copy()
        vector[0] += np.copysign(np.sqrt((vector**2).sum()), vector[0])
        square = (vector**2).sum()
        if square > 0:
            work[k:, k:] -= np.outer(2 * vector / square, vector @ work[k:, k:])
            target[k:] -= np.outer(2 * vector / square, vector @ target[k:])
    return dense_solve(np.triu(work[:n]), target[:n])
