"""Least squares within a box, for the few series that leave it."""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from dacore.core.arrays import Array
from dacore.errors import UnstableError


def ranges(values: Array, factor: float) -> tuple[Array, Array]:
    """Least and largest of values (..., K), moved away from their middle by `factor`: both (...)."""
    low, high = values.min(axis=-1), values.max(axis=-1)
    middle, half = (low + high) / 2, factor * (high - low) / 2
    return middle - half, middle + half


def solve_within(triangular: Array, right: Array, low: Array, high: Array) -> Array:
    """Minimise ‖R c − b‖ over low ≤ c ≤ high, column by column.

    Parameters
    ----------
    triangular : (n, n) array
        R.
    right : (n, k) array
        b; least squares in a QR factorisation differ from this by a constant.
    low, high : (n, k) array

    Returns
    -------
    (n, k) array
        The unconstrained solution where it is inside.
    """
    found = np.asarray(solve_triangular(triangular, right))
    outside = ((found < low) | (found > high)).any(axis=0)
    # A mode that did not vary has a box of no width, which the solver refuses.
    width = np.maximum(high - low, 1e-14 * np.maximum(np.abs(low), np.abs(high)))
    width = np.where(width > 0, width, np.finfo(np.float64).tiny)
    for j in np.flatnonzero(outside):
        # In units of the box, so that one tolerance fits all modes.
        scaled = triangular * width[:, j]
        target = right[:, j] - triangular @ low[:, j]
        size = float(np.linalg.norm(scaled)) or 1.0
        answer = lsq_linear(scaled / size, target / size, (0.0, 1.0), method="bvls", tol=1e-12, max_iter=20 * len(low))
        if not answer.success:
            raise UnstableError(f"box: no least-squares solution within it was found: {answer.message}; lower n")
        found[:, j] = low[:, j] + width[:, j] * answer.x
    return found
