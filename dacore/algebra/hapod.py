"""POD of more snapshots than should be held at once: incremental hierarchical POD.

The modes found so far, scaled by their singular values, stand in for the snapshots they came from;
each new block is decomposed together with them. Source: Himpe, Leibner & Rave, Hierarchical
approximate proper orthogonal decomposition, SIAM J. Sci. Comput. 40 (2018) A3267.
"""

from collections.abc import Iterable

import numpy as np

from dacore.algebra.pod import modes_of, pod
from dacore.core.arrays import Array, Sparse
from dacore.core.reduced import ReducedSpace
from dacore.errors import ShapeError

WIDTH = 480


def hapod(blocks: Iterable[Array], product: Sparse, tolerance: float, steps: int, width: int = WIDTH) -> ReducedSpace:
    """Return modes of a stream of snapshots; at most `width` columns and the modes are held.

    Each of N decompositions on the way may leave tolerance/(2N) of all it stands for, the last one half of the
    tolerance: by the triangle inequality the whole leaves no more than the tolerance.

    Parameters
    ----------
    blocks : iterable of (n_dofs, k) arrays
    product : (n_dofs, n_dofs) csr_array
    tolerance : float
        Relative error in the mean-square sense.
    steps : int
        Number of snapshots in all, by which the tolerance is divided among the decompositions.
    width : int
        Columns gathered before a decomposition.

    Returns
    -------
    ReducedSpace
    """
    count = max(-(-steps // width), 1)
    local = tolerance / (2.0 * count)
    scaled: Array | None = None
    waiting: list[Array] = []
    for block in blocks:
        waiting.append(block)
        if sum(each.shape[1] for each in waiting) >= width:
            scaled, waiting = _scaled(scaled, waiting, product, local), []
    if scaled is None and not waiting:
        raise ShapeError("snapshots: got none, expected at least one")
    return pod(_gather(scaled, waiting), product, tolerance if scaled is None else tolerance / 2.0)


def _gather(scaled: Array | None, waiting: list[Array]) -> Array:
    return np.concatenate(waiting if scaled is None else [scaled, *waiting], axis=1)


def _scaled(scaled: Array | None, waiting: list[Array], product: Sparse, tolerance: float) -> Array:
    basis, values = modes_of(_gather(scaled, waiting), product, tolerance)
    return np.asarray(basis * values)
