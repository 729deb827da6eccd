"""Krylov iterations with a preconditioner.

GMRES works in single precision: memory and traffic are half as large, and what that leaves of the residual, about
1e-6 of what a run started from, is left to the next run.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from dacore.core.arrays import Array

Single = NDArray[np.float32]
Operator = Callable[[Array], Array]  # (n,) -> (n,)
SingleOperator = Callable[[Single], Single]  # (n,) -> (n,)

_LEAST_LEFT = 1e-6  # of the norm of the residual at the start: no run in single precision gains more


def gmres(
    operator: SingleOperator, precondition: SingleOperator, residual: Array, goal: float, iterations: int
) -> tuple[Array, int]:
    """One cycle of right-preconditioned GMRES from zero (Saad and Schultz, SIAM J. Sci. Stat. Comput. 7, 1986).

    Parameters
    ----------
    operator : callable
        r (n,) -> K P r (n,): the preconditioner and then the matrix.
    precondition : callable
        r (n,) -> P r (n,); linear up to rounding.
    residual : (n,) array
    goal : float
        Stop when the norm of the residual is below it.
    iterations : int
        Longest cycle; as many vectors of length n are kept, in single precision.

    Returns
    -------
    correction : (n,) array
    used : int
        Iterations made.
    """
    start = float(np.linalg.norm(residual))
    goal = max(goal / start, _LEAST_LEFT)
    # Pages that are never written take no memory.
    basis = np.empty((iterations + 1, len(residual)), dtype=np.float32)
    basis[0] = residual / start
    system = _LeastSquares(iterations, 1.0)
    used = 0
    for j in range(iterations):
        basis[j + 1] = _orthogonalise(basis[: j + 1], operator(basis[j]), system)
        used = j + 1
        if system.residual <= goal or system.broken:
            break
    combined = system.solution().astype(np.float32) @ basis[: system.count]
    return start * precondition(combined).astype(np.float64), used


def _orthogonalise(known: Single, image: Single, system: "_LeastSquares") -> Single:
    """Return the next basis vector, by classical Gram–Schmidt applied twice."""
    weights: Single = known @ image
    image = np.subtract(image, weights @ known, dtype=np.float32)
    again = known @ image
    image -= again @ known
    size = float(np.linalg.norm(image))
    system.append((weights + again).astype(np.float64), size)
    return image / np.float32(size) if size > 0.0 else image


class _LeastSquares:
    """min ‖β e₁ − H y‖ for a growing Hessenberg matrix, by Givens rotations."""

    def __init__(self, iterations: int, beta: float) -> None:
        self._triangle = np.zeros((iterations, iterations))
        self._right = np.zeros(iterations + 1)
        self._right[0] = beta
        self._rotations: list[tuple[float, float]] = []
        self.count = 0
        self.broken = False

    @property
    def residual(self) -> float:
        return abs(float(self._right[self.count]))

    def append(self, column: Array, below: float) -> None:
        if self.broken:
            return
        j = self.count
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
        self.count = j + 1
        self.broken = below <= 1e-15 * radius

    def solution(self) -> Array:
        y = np.zeros(len(self._rotations))
        if self.count:
            y = solve_triangular(self._triangle[: self.count, : self.count], self._right[: self.count])
        return np.asarray(y)


def conjugate_gradients(
    matrix: Operator, precondition: SingleOperator, residual: Array, goal: float, iterations: int
) -> tuple[Array, int]:
    """Conjugate gradients from zero for a positive definite matrix and a symmetric preconditioner.

    Parameters and returns as for `gmres`, except that `matrix` is the matrix alone, in double precision.
    """
    start = float(np.linalg.norm(residual))
    correction, left = np.zeros_like(residual), residual / start
    search, product = np.zeros_like(residual), 1.0
    used = 0
    while used < iterations and np.linalg.norm(left) > goal / start:
        better = precondition(left.astype(np.float32)).astype(np.float64)
        before, product = product, float(left @ better)
        search = better + (product / before) * search if used else better
        image = matrix(search)
        used += 1
        curvature = float(search @ image)
        if not (curvature > 0.0 and product > 0.0):
            break
        correction += (product / curvature) * search
        left -= (product / curvature) * image
    return start * correction, used
