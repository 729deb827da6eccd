"""PBDW as the saddle-point problem it comes from: the reference that the explicit form must meet.

u* = argmin ‖Π_{V_n^⊥} u‖² subject to ⟨w_i, u⟩ = l_i, so with orthonormal Φ and W::

    [[I − ΦΦᵀM, −W], [WᵀM, 0]] (u, λ) = (0, l)

(docs/method.md: PBDW; the paper prints λ = Wᵀη and a constraint row without M, see the errata).
"""

import numpy as np

from dacore.core.arrays import Array, Sparse
from dacore.errors import ShapeError, UnstableError

LARGEST = 6000


def solve_saddle_point(basis: Array, product: Sparse, representers: Array, data: Array) -> Array:
    """Solve the dense saddle-point system; for verification on small meshes.

    Parameters
    ----------
    basis : (n_dofs, n) array
        Φ, orthonormal in `product`.
    product : (n_dofs, n_dofs) csr_array
        M.
    representers : (n_dofs, m) array
        W, orthonormal in `product`.
    data : (m, k) array
        Data in the orthonormal representers.

    Returns
    -------
    (n_dofs, k) array

    Raises
    ------
    ShapeError
        If n_dofs + m is more than 6000.
    UnstableError
        If the system is singular: β(V_n, W) = 0.
    """
    n_dofs, m = representers.shape
    if n_dofs + m > LARGEST:
        raise ShapeError(
            f"saddle-point form: got {n_dofs + m} unknowns, expected at most {LARGEST}; use the explicit form"
        )
    system = np.zeros((n_dofs + m, n_dofs + m))
    system[:n_dofs, :n_dofs] = np.eye(n_dofs) - basis @ (product @ basis).T
    system[:n_dofs, n_dofs:] = -representers
    system[n_dofs:, :n_dofs] = (product @ representers).T
    right = np.concatenate([np.zeros((n_dofs, data.shape[1])), data])
    try:
        return np.asarray(np.linalg.solve(system, right)[:n_dofs])
    except np.linalg.LinAlgError as error:
        raise UnstableError("saddle-point form: the system is singular, β(V_n, W) = 0; lower n") from error
