"""Singular value decompositions that do not give up, and that do not decompose more than is asked for."""

import numpy as np
import scipy.linalg

from dacore.core.arrays import Array

# Directions whose singular value is below this share of the largest are round-off of the others.
ROUND_OFF = 1e-13


def thin_svd(matrix: Array) -> tuple[Array, Array, Array]:
    """Return the thin singular value decomposition.

    The divide-and-conquer method fails to converge once in a while; the method of QR iterations, slower,
    then takes its place.

    Parameters
    ----------
    matrix : (m, n) array

    Returns
    -------
    u : (m, k) array, k = min(m, n)
    s : (k,) array
    vt : (k, n) array
    """
    tall = matrix.shape[0] > 2 * matrix.shape[1]
    if tall:
        q, matrix = scipy.linalg.qr(matrix, mode="economic", check_finite=False)
    try:
        u, s, vt = scipy.linalg.svd(matrix, full_matrices=False, check_finite=False)
    except np.linalg.LinAlgError:
        u, s, vt = scipy.linalg.svd(matrix, full_matrices=False, check_finite=False, lapack_driver="gesvd")
    return (q @ u if tall else u), s, vt


def left_svd(matrix: Array) -> tuple[Array, Array]:
    """Return left singular vectors (m, k) and values (k,) of a matrix (m, n), k = min(m, n).

    A wide matrix is reduced to its triangular factor first, which has the same ones.
    """
    if matrix.shape[1] > matrix.shape[0]:
        matrix = scipy.linalg.qr(matrix.T, mode="r", check_finite=False)[0][: matrix.shape[0]].T
    u, s, _ = thin_svd(matrix)
    return u, s


def condensed(matrix: Array, floor: float = ROUND_OFF) -> tuple[Array, Array]:
    """Return orthonormal columns Q (m, k) and coordinates C (k, n) of the same columns: matrix = Q C to round-off.

    Parameters
    ----------
    matrix : (m, n) array
    floor : float
        Share of the largest singular value below which directions are left out.
    """
    u, s, vt = thin_svd(matrix)
    rank = max(int((s > floor * s[0]).sum()), 1) if s.size else 0
    return u[:, :rank], s[:rank, None] * vt[:rank]
