"""Polynomials of low degree through noisy values at scattered points, each point judged by the fit to all others."""

from itertools import product

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.estimators.posterior_interpolant import Interpolant

# Total degrees tried, and points for each coefficient at least.
_HIGHEST, _POINTS_EACH = 4, 3
# Directions of the least-squares problem below this share of the largest are left out.
_RANK = 1e-10
# A point that decides its own value to within this share would have any error without itself.
_FREE = 1e-3


def fitted(curved: Array, affine: Array, values: Array) -> tuple[Interpolant | None, Array]:
    """Fit values by polynomials times amplitudes, of the degree that predicts points left out best.

    Parameters
    ----------
    curved : (k, p) array
        Coordinates in which the fit is a polynomial.
    affine : (k, a) array
        Coordinates in which it is affine, with all polynomials.
    values : (k, q) array

    Returns
    -------
    Interpolant or None
        Of (1 + a) · q values; None where leaving the values as they are predicts better.
    left : (k, q) array
        Errors of the fit at each point without that point; the values themselves without a fit.
    """
    count, amplitudes = len(values), np.column_stack([np.ones(len(values)), affine])
    best, found = values, None
    for degree in range(_HIGHEST + 1):
        indices = of_degree(curved.shape[1], degree)
        basis = Interpolant(indices, np.empty((len(indices), 0))).basis(curved)
        columns = (amplitudes[:, :, None] * basis[:, None]).reshape(count, -1)
        if columns.shape[1] * _POINTS_EACH > count:
            break
        u, s, vt = np.linalg.svd(columns, full_matrices=False)
        keep = s > _RANK * s[0]
        u, s, vt = u[:, keep], s[keep], vt[keep]
        along = u.T @ values
        # The error at a point left out, by its leverage: no fit is made again.
        left = (values - u @ along) / np.maximum(1.0 - (u**2).sum(axis=1), _FREE)[:, None]
        if (left**2).sum() < (best**2).sum():
            weights = (vt.T @ (along / s[:, None])).reshape(amplitudes.shape[1], len(indices), -1)
            best, found = left, Interpolant(indices, weights.swapaxes(0, 1).reshape(len(indices), -1))
    return found, np.asarray(best)


def of_degree(dimensions: int, degree: int) -> IntArray:
    """Multi-indices (n, dimensions) of a total degree at most; the number of directions is small."""
    found = [index for index in product(range(degree + 1), repeat=dimensions) if sum(index) <= degree]
    return np.array(found, dtype=np.int64).reshape(len(found), dimensions)
