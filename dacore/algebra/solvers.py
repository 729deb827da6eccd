"""Solvers of the symmetric quasi-definite systems that implicit time steps lead to."""

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import bicgstab, splu

from dacore.core.arrays import Array, BoolArray, Sparse, check_shape
from dacore.errors import ConvergenceError, ShapeError

Method = Literal["auto", "direct", "krylov"]


class LinearSolver(ABC):
    """One matrix, many right-hand sides.

    The residual is measured in the norm of the system scaled to unit diagonal, so that equations
    in different units count alike: ‖D(b − Ax)‖ ≤ tolerance ‖Db‖ with D = |diag A|^(−1/2).
    """

    @abstractmethod
    def _solve_scaled(self, rhs: Array, guess: Array) -> Array:
        """Solve the scaled system for (n, k) columns, starting from (n, k) guesses."""

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        n = matrix.shape[0]
        check_shape("matrix", np.empty(matrix.shape, dtype=np.bool_) if n == 0 else matrix, (n, n))  # type: ignore[arg-type]
        diagonal = matrix.diagonal()
        wrong = int((np.where(definite, diagonal, -diagonal) <= 0.0).sum())
        if wrong:
            raise ShapeError(
                f"matrix: {wrong} of {n} diagonal entries have the wrong sign or vanish; expected positive where "
                "definite and negative elsewhere: check the constrained dofs and the signs of the flow rows"
            )
        self._scale = 1.0 / np.sqrt(np.abs(diagonal))
        scaled = matrix.tocoo()
        data = scaled.data * self._scale[scaled.row] * self._scale[scaled.col]
        self._matrix: Sparse = csr_array((data, (scaled.row, scaled.col)), shape=matrix.shape)
        self._tolerance = tolerance

    def solve(self, rhs: Array, guess: Array | None = None) -> Array:
        """Solve A x = b for every column of `rhs`.

        Parameters
        ----------
        rhs : (n,) or (n, k) array
        guess : array of the same shape, optional
            Start of an iteration; zero by default.

        Returns
        -------
        array of the shape of `rhs`

        Raises
        ------
        ConvergenceError
            If a column misses the tolerance.
        """
        n = self._matrix.shape[0]
        columns = rhs.reshape(n, -1) * self._scale[:, None]
        start = np.zeros_like(columns) if guess is None else guess.reshape(n, -1) / self._scale[:, None]
        solution = self._solve_scaled(columns, start)
        residual = np.linalg.norm(columns - self._matrix @ solution, axis=0)
        wanted = self._tolerance * np.linalg.norm(columns, axis=0)
        if not (residual <= wanted).all():
            worst = float((residual / np.maximum(wanted, 1e-300)).max())
            raise ConvergenceError(f"{type(self).__name__}: residual {worst:.1e} times the tolerance")
        return np.asarray((solution * self._scale[:, None]).reshape(rhs.shape))


class DirectSolver(LinearSolver):
    """Sparse factorisation."""

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        super().__init__(matrix, definite, tolerance)
        self._factor = splu(
            csc_array(self._matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )

    def _solve_scaled(self, rhs: Array, guess: Array) -> Array:
        solution = self._factor.solve(rhs)
        return np.asarray(solution + self._factor.solve(rhs - self._matrix @ solution))


class KrylovSolver(LinearSolver):
    """BiCGSTAB on the scaled system."""

    def _solve_scaled(self, rhs: Array, guess: Array) -> Array:
        solution = np.empty_like(rhs)
        for column in range(rhs.shape[1]):
            solution[:, column], _ = bicgstab(
                self._matrix, rhs[:, column], x0=guess[:, column], rtol=0.5 * self._tolerance, atol=0.0, maxiter=5000
            )
        return solution


def make_solver(
    matrix: Sparse, definite: BoolArray, method: Method = "auto", tolerance: float = 1e-10
) -> LinearSolver:
    """Prepare a solver of A x = b for one symmetric quasi-definite matrix.

    Parameters
    ----------
    matrix : (n, n) csr_array
        [[A, Bᵀ], [B, −C]] in any order of rows, with A and C positive (semi)definite.
    definite : (n,) bool array
        True on the rows of A.
    method : {"auto", "direct", "krylov"}
    tolerance : float
        Bound on the relative residual of the scaled system.
    """
    if method == "krylov" or (method == "auto" and matrix.shape[0] > 40_000):
        return KrylovSolver(matrix, definite, tolerance)
    return DirectSolver(matrix, definite, tolerance)
