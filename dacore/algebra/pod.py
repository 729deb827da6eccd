"""Proper orthogonal decomposition in any inner product, by the method of snapshots with deflation.

The Gram matrix AᵀMA squares singular values: one pass resolves them down to about 1e-8 of the
largest. Each further pass works on what the modes found so far leave over, so the basis reaches
any tolerance above round-off. Source: the paper's section on POD; METHOD: C = AᵀMA = BΛBᵀ, Φ = ABΛ^(−1/2).
"""

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from dacore.core.arrays import Array, Sparse
from dacore.core.reduced import ReducedSpace
from dacore.errors import AccuracyError, ShapeError

PASS_DEPTH = 1e-6
MAX_PASSES = 6


def pod(snapshots: Array, product: Sparse, tolerance: float = 0.0, max_rank: int | None = None) -> ReducedSpace:
    """Return the leading modes of a set of snapshots.

    Parameters
    ----------
    snapshots : (n_dofs, K) array
        One snapshot a column; not changed.
    product : (n_dofs, n_dofs) csr_array
        Symmetric positive definite inner product M.
    tolerance : float
        Keep as many modes as bring (Σ‖s − Πs‖² / Σ‖s‖²)^½ to at most this; 0 keeps all that round-off allows.
    max_rank : int, optional
        Keep at most so many modes.

    Returns
    -------
    ReducedSpace
        With as many singular values as modes were computed.

    Raises
    ------
    ShapeError
        If there is no snapshot, one is not finite, or all are zero.
    AccuracyError
        If the modes miss the tolerance for another reason than `max_rank`.
    """
    n, count = snapshots.shape
    if product.shape != (n, n):
        raise ShapeError(f"inner product: got shape {product.shape}, expected {(n, n)}")
    if count == 0 or not np.isfinite(snapshots).all():
        raise ShapeError(f"snapshots: got {count} columns, expected at least one and finite values only")
    weighted = product @ snapshots
    total = float(np.einsum("ij,ij->", snapshots, weighted))
    if not total > 0:
        raise ShapeError("snapshots: all are zero; nothing to decompose")
    limit = min(n, count, max_rank if max_rank is not None else count)
    target = max(tolerance, 1e-14) * np.sqrt(total)
    basis = np.zeros((n, 0))
    values = np.zeros(0)
    residual = snapshots
    for _ in range(MAX_PASSES):
        left = _residual_norm(residual, weighted)
        if left <= target or basis.shape[1] >= limit:
            break
        modes, found = _one_pass(residual, weighted, target, limit - basis.shape[1])
        if modes.shape[1] == 0:
            break
        basis = _orthonormalise(basis, modes, product)
        values = np.append(values, found)
        residual = snapshots - basis @ (basis.T @ (product @ snapshots))
        weighted = product @ residual
    reached = _residual_norm(residual, weighted)
    if tolerance > 0 and basis.shape[1] < limit and reached > 1.01 * target:
        raise AccuracyError(
            f"POD: {basis.shape[1]} modes leave a relative error of {reached / np.sqrt(total):.1e}, "
            f"expected {tolerance:.1e}; raise the tolerance"
        )
    basis, values = _rotate(basis, snapshots, product)
    return ReducedSpace(basis, values, product)


def _residual_norm(residual: Array, weighted: Array) -> float:
    return float(np.sqrt(max(np.einsum("ij,ij->", residual, weighted), 0.0)))


def _one_pass(residual: Array, weighted: Array, target: float, limit: int) -> tuple[Array, Array]:
    """Modes whose singular value the Gram matrix resolves, and their singular values."""
    squares, vectors = eigh(residual.T @ weighted, check_finite=False, driver="evd")
    squares, vectors = squares[::-1], vectors[:, ::-1]
    tail = np.sqrt(np.maximum(np.append(np.cumsum(np.maximum(squares, 0)[::-1])[::-1], 0.0), 0.0))
    wanted = int(np.argmax(tail <= 0.99 * target))
    resolved = int((squares > PASS_DEPTH**2 * squares[0]).sum())
    n = min(wanted, resolved, limit)
    values = np.sqrt(squares[:n])
    return residual @ (vectors[:, :n] / values), values


def _orthonormalise(basis: Array, modes: Array, product: Sparse) -> Array:
    """Append `modes` to an orthonormal basis: block Gram–Schmidt with Cholesky, twice."""
    for _ in range(2):
        modes = modes - basis @ (basis.T @ (product @ modes))
        factor = cholesky(modes.T @ (product @ modes), lower=False)
        modes = solve_triangular(factor, modes.T, trans="T", lower=False).T
    return np.concatenate([basis, modes], axis=1)


def _rotate(basis: Array, snapshots: Array, product: Sparse) -> tuple[Array, Array]:
    """Rotate the basis to the principal axes of the projected snapshots, largest first."""
    coefficients = basis.T @ (product @ snapshots)
    vectors, values, _ = np.linalg.svd(coefficients, full_matrices=False)
    rotated = basis @ vectors
    return _orthonormalise(rotated[:, :0], rotated, product) if rotated.shape[1] else rotated, values
