"""Proper orthogonal decomposition in any inner product, by the method of snapshots with deflation.

The Gram matrix AᵀMA squares singular values: one pass resolves them down to about 1e-8 of the
largest. Each further pass works on what the modes found so far leave over, so the basis reaches
any tolerance above round-off. Source: the paper's section on POD, corrected: C = AᵀMA = BΛBᵀ, Φ = ABΛ^(−1/2).
"""

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from dacore.core.arrays import Array, Sparse
from dacore.core.reduced import ReducedSpace
from dacore.errors import AccuracyError, ShapeError

PASS_DEPTH = 1e-6
MAX_PASSES = 6
_NEWS = 1e-3


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
    basis, values = modes_of(snapshots, product, tolerance, max_rank)
    return ReducedSpace(basis, values, product)


def modes_of(
    snapshots: Array, product: Sparse, tolerance: float = 0.0, max_rank: int | None = None
) -> tuple[Array, Array]:
    """Modes (n_dofs, r) and singular values (r,) of `pod`, without the check of a `ReducedSpace`."""
    n, count = snapshots.shape
    if product.shape != (n, n):
        raise ShapeError(f"inner product: got shape {product.shape}, expected {(n, n)}")
    if count == 0 or not np.isfinite(snapshots).all():
        raise ShapeError(f"snapshots: got {count} columns, expected at least one and finite values only")
    residual, weighted = snapshots, product @ snapshots
    total = float(np.einsum("ij,ij->", residual, weighted))
    if not 0 < total < np.inf:
        raise ShapeError(
            f"snapshots: the sum of their squares is {total:g}, expected a positive number; all are zero, or so small "
            "or large that squares leave the range of double: change the unit"
        )
    limit = min(n, count, max_rank if max_rank is not None else count)
    target = max(tolerance, 1e-14) * np.sqrt(total)
    left = np.sqrt(total)
    basis = weighted_basis = np.zeros((n, 0))
    coefficients = np.zeros((0, count))
    for _ in range(MAX_PASSES):
        modes = _one_pass(residual, weighted, target, limit - basis.shape[1])
        if modes.shape[1] == 0:
            break
        modes, weighted_modes = _orthonormalise(basis, weighted_basis, modes, product)
        if modes.shape[1] == 0:  # what is left is round-off of what was found
            break
        found = modes.T @ weighted
        basis = np.concatenate([basis, modes], axis=1)
        weighted_basis = np.concatenate([weighted_basis, weighted_modes], axis=1)
        coefficients = np.concatenate([coefficients, found])
        size = float(np.einsum("ij,ij->", residual, weighted))
        left = np.sqrt(max(size - float((found**2).sum()), 0.0))
        # The difference of squares is exact enough to stop on only where it is not all cancellation.
        resolved = left > 1e-6 * np.sqrt(size)
        if (left <= target and resolved) or basis.shape[1] >= limit:
            break
        residual, weighted = residual - modes @ found, weighted - weighted_modes @ found
        left = np.sqrt(max(float(np.einsum("ij,ij->", residual, weighted)), 0.0))
        if left <= target:
            break
    if tolerance > 0 and basis.shape[1] < limit and left > 1.01 * target:
        raise AccuracyError(
            f"POD: {basis.shape[1]} modes leave a relative error of {left / np.sqrt(total):.1e}, "
            f"expected {tolerance:.1e}; raise the tolerance"
        )
    # Rotate to the principal axes of the projected snapshots, largest first.
    vectors, values, _ = np.linalg.svd(coefficients, full_matrices=False)
    return np.asarray(basis @ vectors), values


def _one_pass(residual: Array, weighted: Array, target: float, limit: int) -> Array:
    """Modes whose singular value the Gram matrix resolves, as many as the target needs."""
    squares, vectors = eigh(residual.T @ weighted, check_finite=False, driver="evd")
    squares, vectors = squares[::-1], vectors[:, ::-1]
    tail = np.sqrt(np.append(np.cumsum(np.maximum(squares, 0)[::-1])[::-1], 0.0))
    wanted = int(np.argmax(tail <= 0.99 * target))
    resolved = int((squares > PASS_DEPTH**2 * squares[0]).sum())
    n = min(wanted, resolved, limit)
    return np.asarray(residual @ (vectors[:, :n] / np.sqrt(squares[:n])))


def _orthonormalise(basis: Array, weighted_basis: Array, modes: Array, product: Sparse) -> tuple[Array, Array]:
    """Make modes of size one orthonormal, and orthogonal to an orthonormal basis: Gram–Schmidt by blocks, twice.

    Modes of which the basis already holds all but a thousandth are left out: at the limit of round-off
    they are noise.
    """
    for _ in range(2):
        modes = modes - basis @ (weighted_basis.T @ modes)
        gram = modes.T @ (product @ modes)
        squares, vectors = eigh(gram)
        new = squares > _NEWS**2
        if new.all():
            modes = solve_triangular(cholesky(gram, lower=False), modes.T, trans="T", lower=False).T
        else:
            modes = modes @ (vectors[:, new] / np.sqrt(squares[new]))
    return modes, np.asarray(product @ modes)
