"""Flexible GMRES in complex arithmetic: the preconditioner may be another solver, stopped early.

Saad, *A flexible inner–outer preconditioned GMRES algorithm*, SIAM J. Sci. Comput. 14 (1993) 461.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dacore.errors import ConvergenceError

Vector = NDArray[np.complex128]

# Of the norm of the right-hand side: what is smaller is rounding.
_LEAST_NEWS = 1e-15


def flexible_gmres(
    operator: Callable[[Vector], Vector],
    precondition: Callable[[Vector], Vector],
    right: Vector,
    tolerance: float,
    iterations: int,
) -> tuple[Vector, float, int]:
    """Solve K x = b by combinations of what a preconditioner gives.

    Parameters
    ----------
    operator : callable
        x (n,) -> K x (n,).
    precondition : callable
        r (n,) -> about K⁻¹ r (n,); may vary from call to call.
    right : (n,) complex array
    tolerance : float
        Stop when ‖b − K x‖ is at most this times ‖b‖.
    iterations : int
        Most of them; two vectors of each are kept.

    Returns
    -------
    solution : (n,) complex array
    residual : float
        ‖b − K x‖/‖b‖, computed anew.
    used : int
        Iterations made.

    Raises
    ------
    ConvergenceError
        If the preconditioner gives infinite values.
    """
    solution, residual, used = np.zeros_like(right), right, 0
    size = start = float(np.linalg.norm(right))
    if size == 0.0:
        return solution, 0.0, 0
    # The small residual of a cycle drifts from the true one, so a cycle that claims enough is checked and repeated.
    while used < iterations:
        change, count = _cycle(operator, precondition, residual, tolerance * start / size, iterations - used)
        used += count
        trial = solution + change
        left = right - operator(trial)
        norm = float(np.linalg.norm(left))
        if not norm < 0.5 * size:
            if norm < size:
                solution, size = trial, norm
            break
        solution, residual, size = trial, left, norm
        if size <= tolerance * start:
            break
    return solution, size / start, used


def _cycle(operator: Any, precondition: Any, residual: Vector, goal: float, most: int) -> tuple[Vector, int]:
    """One cycle from zero, until the residual is `goal` of what it was."""
    size = float(np.linalg.norm(residual))
    basis: list[Vector] = [residual / size]
    given: list[Vector] = []
    hessenberg = np.zeros((most + 1, most), dtype=np.complex128)
    weights: Any = np.zeros(0, dtype=np.complex128)
    for j in range(most):
        given.append(precondition(basis[j]))
        if not np.isfinite(given[j]).all():
            raise ConvergenceError("flexible GMRES: the preconditioner gives infinite values")
        image: Any = operator(given[j])
        length = float(np.linalg.norm(image))
        for _ in range(2):
            for k, known in enumerate(basis):
                weight = np.vdot(known, image)
                hessenberg[k, j] += weight
                image = image - weight * known
        rest = float(np.linalg.norm(image))
        hessenberg[j + 1, j] = rest
        small, load = hessenberg[: j + 2, : j + 1], np.zeros(j + 2, dtype=np.complex128)
        load[0] = 1.0
        weights = np.linalg.lstsq(small, load, rcond=None)[0]
        left = float(np.linalg.norm(load - small @ weights))
        if left <= goal or not rest > _LEAST_NEWS * length:
            break
        basis.append(image / rest)
    return np.asarray(size * sum(weight * vector for weight, vector in zip(weights, given, strict=True))), len(given)
