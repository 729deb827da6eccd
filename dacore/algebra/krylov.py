"""Krylov iterations on several right-hand sides at a time, each with its own space, all with one product.

Multiplying k columns by a sparse matrix costs much less than k products, so the columns advance
together; a column that has converged rides along until the slowest has.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from dacore.core.arrays import Array

Operator = Callable[[Array], Array]  # (n, k) -> (n, k)


def flexible_gmres(
    matrix: Operator, precondition: Operator, residual: Array, goal: Array, iterations: int
) -> tuple[Array, int]:
    """One cycle of right-preconditioned flexible GMRES from zero (Saad, SIAM J. Sci. Comput. 14, 1993).

    Parameters
    ----------
    matrix, precondition : callable
        (n, k) -> (n, k); the preconditioner may be inexact, nonlinear and in lower precision.
    residual : (n, k) array
    goal : (k,) array
        Stop when every column's residual norm is below its goal.
    iterations : int
        Longest cycle; 2 (iterations + 1) vectors of length n are kept for each column.

    Returns
    -------
    correction : (n, k) array
    used : int
        Iterations made.
    """
    n, k = residual.shape
    start = np.linalg.norm(residual, axis=0)
    bases = [np.empty((iterations + 1, n)) for _ in range(k)]
    searches = [np.empty((iterations, n), dtype=np.float64) for _ in range(k)]
    hessenbergs = [_LeastSquares(iterations, float(size)) for size in start]
    vectors = residual / start
    for basis, vector in zip(bases, vectors.T, strict=True):
        basis[0] = vector
    used = 0
    for j in range(iterations):
        search = precondition(vectors)
        image = matrix(search)
        used = j + 1
        for c in range(k):
            searches[c][j] = search[:, c]
            vectors[:, c] = _orthogonalise(bases[c], image[:, c], j, hessenbergs[c])
        if all(h.residual <= limit or h.broken for h, limit in zip(hessenbergs, goal, strict=True)):
            break
    correction = np.empty((n, k))
    for c in range(k):
        correction[:, c] = searches[c][:used].T @ hessenbergs[c].solution()
    return correction, used


def _orthogonalise(basis: Array, image: Array, j: int, system: "_LeastSquares") -> Array:
    """Add the (j+1)-th basis vector, by classical Gram–Schmidt applied twice."""
    known = basis[: j + 1]
    weights = known @ image
    vector = image - weights @ known
    again = known @ vector
    vector -= again @ known
    size = float(np.linalg.norm(vector))
    system.append(weights + again, size)
    if size > 0.0:
        vector /= size
    basis[j + 1] = vector
    return vector


class _LeastSquares:
    """min ‖β e₁ − H y‖ for a growing Hessenberg matrix, by Givens rotations."""

    def __init__(self, iterations: int, beta: float) -> None:
        self._triangle = np.zeros((iterations, iterations))
        self._right = np.zeros(iterations + 1)
        self._right[0] = beta
        self._rotations: list[tuple[float, float]] = []
        self._count = 0
        self.broken = False

    @property
    def residual(self) -> float:
        return abs(float(self._right[self._count]))

    def append(self, column: Array, below: float) -> None:
        if self.broken:
            return
        j = self._count
        column = column.copy()
        for i, (cosine, sine) in enumerate(self._rotations):
            column[i], column[i + 1] = (
                cosine * column[i] + sine * column[i + 1],
                cosine * column[i + 1] - sine * column[i],
            )
        radius = float(np.hypot(column[j], below))
        # A vanishing or undefined column: the space is exhausted.
        if not radius > 0.0 or not np.isfinite(radius):
            self.broken = True
            return
        cosine, sine = float(column[j]) / radius, below / radius
        self._rotations.append((cosine, sine))
        column[j] = radius
        self._triangle[: j + 1, j] = column
        self._right[j], self._right[j + 1] = cosine * self._right[j], -sine * self._right[j]
        self._count = j + 1
        self.broken = below <= 1e-15 * radius

    def solution(self) -> Array:
        y = np.zeros(len(self._rotations))
        if self._count:
            y = solve_triangular(self._triangle[: self._count, : self._count], self._right[: self._count])
        return np.asarray(y)


def conjugate_gradients(matrix: Operator, residual: Array, goal: Array, iterations: int) -> tuple[Array, int]:
    """Conjugate gradients from zero for a positive definite matrix scaled to unit diagonal.

    Parameters and returns as for `flexible_gmres`.
    """
    correction = np.zeros_like(residual)
    residual = residual.copy()
    search = residual.copy()
    square = np.einsum("ij,ij->j", residual, residual)
    used = 0
    for _ in range(iterations):
        if (square <= goal**2).all():
            break
        image = matrix(search)
        used += 1
        curvature = np.einsum("ij,ij->j", search, image)
        going = (square > goal**2) & (curvature > 0.0)
        if not going.any():
            break
        step = np.where(going, square, 0.0) / np.where(going, curvature, 1.0)
        correction += step * search
        residual -= step * image
        new = np.einsum("ij,ij->j", residual, residual)
        search = residual + np.where(going, new, 0.0) / np.where(square > 0.0, square, 1.0) * search
        square = new
    return correction, used
