"""POD of more snapshots than should be held at once: incremental hierarchical POD.

Source: Himpe, Leibner & Rave, Hierarchical approximate proper orthogonal decomposition, SIAM J. Sci. Comput. 40
(2018) A3267; what differs is told in `dacore.algebra.stream`.
"""

from collections.abc import Iterable

from dacore.algebra.stream import WIDTH, Stream
from dacore.core.arrays import Array, Sparse
from dacore.core.reduced import ReducedSpace


def hapod(
    blocks: Iterable[Array],
    product: Sparse,
    tolerance: float,
    steps: int,
    width: int = WIDTH,
    memory: float | None = None,
) -> ReducedSpace:
    """Return modes of a stream of snapshots, each read once.

    Parameters
    ----------
    blocks : iterable of (n_dofs, k) arrays
    product : (n_dofs, n_dofs) csr_array
    tolerance : float
        Relative error in the mean-square sense; kept whatever the order and the number of blocks.
    steps : int
        Number of snapshots in all; a wrong number costs modes on the way, no accuracy.
    width : int
        Snapshots looked at together; of no influence on the error.
    memory : float, optional [GiB]
        Bound on what is held beside the block that has just come; the basis returned is part of it.

    Returns
    -------
    ReducedSpace

    Raises
    ------
    ShapeError
        If there is no snapshot, one is not finite, all are zero, or the memory has no room for 16 of them.
    AccuracyError
        If the tolerance is below what round-off allows, or needs more modes than fit in the memory.
    """
    stream = Stream(product, tolerance, steps, width, memory)
    for block in blocks:
        stream.add(block)
    found = stream.finish().check(tolerance)
    return ReducedSpace(found.basis, found.values, product)
