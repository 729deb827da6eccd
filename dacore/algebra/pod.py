"""Proper orthogonal decomposition of snapshots at hand, in any inner product.

Source: the paper's section on POD, corrected: C = AᵀMA = BΛBᵀ, Φ = ABΛ^(−1/2). The matrix C is formed for
a few snapshots at a time only, of what the modes found so far leave over (`dacore.algebra.stream`): work grows
with the number of modes, not with that of snapshots squared, and the basis reaches any tolerance above round-off.
"""

from dacore.algebra.stream import Stream
from dacore.core.arrays import Array, Sparse
from dacore.core.reduced import ReducedSpace
from dacore.errors import ShapeError


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
        With as many singular values as modes.

    Raises
    ------
    ShapeError
        If there is no snapshot, one is not finite, or all are zero.
    AccuracyError
        If the modes miss the tolerance for another reason than `max_rank`.
    """
    count = snapshots.shape[1]
    if count == 0:
        raise ShapeError(f"snapshots: got {count} columns, expected at least one and finite values only")
    stream = Stream(product, tolerance, count)
    stream.add(snapshots)
    found = stream.finish(max_rank).check(tolerance)
    return ReducedSpace(found.basis, found.values, product)
