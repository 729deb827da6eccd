"""β(V_n, W) for every n from one QR factorisation."""

import numpy as np

from dacore.core.arrays import Array


def inf_sup_constants(cross: Array) -> Array:
    """Stability constants β_n = σ_min(G[:, :n]) for n = 1 … N.

    One QR of G, then the singular values of the leading blocks of its triangular factor. G is
    never squared. For n > m the constant is 0.

    Parameters
    ----------
    cross : (m, N) array
        G = Wᵀ M Φ with orthonormal W and Φ.

    Returns
    -------
    (N,) array
        Never rising, in [0, 1].
    """
    m, n = cross.shape
    _, triangular = np.linalg.qr(cross)
    out = np.zeros(n)
    for k in range(1, min(m, n) + 1):
        out[k - 1] = np.linalg.svd(triangular[:k, :k], compute_uv=False)[-1]
    return np.minimum.accumulate(np.minimum(out, 1.0))
