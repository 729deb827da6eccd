"""Exact integrals of finite element functions over the boxes of a grid."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse, check_shape
from dacore.core.simplex import local_edges, n_local
from dacore.errors import ShapeError
from dacore.geometry.clip_split import snap, split, volume_fractions

#: Simplices handled at once: large enough for numpy, small enough for the processor's cache.
BATCH = 16_384
# Entries of the matrix that wait to be summed, about 50 MB.
_ENTRIES = 2_000_000


@dataclass(frozen=True, eq=False)
class Pieces:
    """Simplices, each within one cell and one box; together they fill the cells in the boxes.

    Parameters
    ----------
    cell : (k,) int array
    box : (k,) int array
        Number of the box, the last axis running fastest.
    barycentric : (k, d + 1, d + 1) array
        Coordinates of each vertex in the cell.
    fraction : (k,) array
        Volume of the piece relative to the cell's.
    """

    cell: IntArray
    box: IntArray
    barycentric: Array
    fraction: Array


def clip(points: Array, cells: IntArray, lower: IntArray, upper: IntArray, batch: int = BATCH) -> Iterator[Pieces]:
    """Cut cells along the planes of a grid of unit boxes.

    A simplex is bisected at a grid plane until it lies in one box; what lies outside the asked
    boxes is dropped as soon as it is cut off. Pieces wait on a stack, so memory stays bounded by
    a few dozen batches whatever the mesh and the grid.

    Parameters
    ----------
    points : (n, d) array
        Vertices in grid coordinates, in which box i is [i, i + 1)^d.
    cells : (c, d + 1) int array
        Triangles or tetrahedra, of either orientation.
    lower, upper : (d,) int array
        The boxes asked for: lower <= i < upper on each axis.
    batch : int
        Number of simplices cut at once.

    Yields
    ------
    Pieces
    """
    coordinates = snap(points)
    corners = coordinates[cells]
    low, high = _layers(corners)
    waiting = np.flatnonzero(((low < upper) & (high >= lower)).all(axis=1))
    dim = points.shape[1]
    shape = tuple((upper - lower).tolist())
    unit = np.eye(dim + 1)
    stack: list[tuple[Array, IntArray]] = []
    while stack or waiting.size:
        blocks, count = [], 0
        while stack and count < batch:
            blocks.append(stack.pop())
            count += len(blocks[-1][1])
        if count < batch and waiting.size:
            fresh, waiting = waiting[: batch - count], waiting[batch - count :]
            whole = np.broadcast_to(unit, (len(fresh), dim + 1, dim + 1))
            blocks.append((np.concatenate([whole, corners[fresh]], axis=2), fresh))
        vertices = np.concatenate([block[0] for block in blocks])
        cell = np.concatenate([block[1] for block in blocks])

        low, high = _layers(vertices[:, :, dim + 1 :])
        inside = ((low < upper) & (high >= lower)).all(axis=1)
        done = inside & (low == high).all(axis=1)
        if done.any():
            barycentric = vertices[done, :, : dim + 1]
            box = np.ravel_multi_index(tuple((low[done] - lower).T), shape)
            yield Pieces(cell[done], box, barycentric, volume_fractions(barycentric))
        cut = np.flatnonzero(inside & ~done)
        if cut.size:
            pieces, source = _bisect(vertices[cut], low[cut], high[cut], lower, upper)
            origin = cell[cut][source]
            stack += [(pieces[k : k + batch], origin[k : k + batch]) for k in range(0, len(pieces), batch)]


def box_integrals(
    points: Array,
    cells: IntArray,
    nodes: IntArray,
    order: int,
    lower: IntArray,
    upper: IntArray,
    batch: int = BATCH,
) -> Sparse:
    """Integrals of nodal basis functions over unit boxes, exact up to round-off.

    Parameters
    ----------
    points : (n, d) array
        Vertices in grid coordinates (rotated and scaled: box i is [i, i + 1)^d).
    cells : (c, d + 1) int array
    nodes : (c, n_local) int array
        Node numbers of each cell in the local order of `dacore.core.simplex.lagrange`.
    order : int
        1 or 2.
    lower, upper : (d,) int array
        The boxes asked for: lower <= i < upper on each axis.
    batch : int
        Number of simplices cut at once; sets the memory.

    Returns
    -------
    (n_boxes, n_nodes) csr_array
        In units of a box's volume. The basis sums to one, so a row's sum is the covered
        fraction of its box. The last axis of the boxes runs fastest.

    Raises
    ------
    ShapeError
        If the order is not 1 or 2, shapes disagree, or no box is asked for.
    """
    dim = points.shape[1]
    if order not in (1, 2):
        raise ShapeError(f"element order: got {order}, expected 1 or 2")
    if dim not in (2, 3):
        raise ShapeError(f"points: got {dim} coordinates, expected 2 or 3")
    check_shape("cells", cells, (None, dim + 1))
    check_shape("nodes", nodes, (len(cells), n_local(dim, order)))
    check_shape("lower", lower, (dim,))
    check_shape("upper", upper, (dim,))
    if (upper <= lower).any():
        raise ShapeError(f"boxes: got {lower.tolist()} to {upper.tolist()}, expected at least one on each axis")
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    volumes = np.abs(np.linalg.det(edges)) / (2.0 if dim == 2 else 6.0)
    shape = (int(np.prod(upper - lower)), int(nodes.max()) + 1)
    total = csr_array(shape)
    waiting: list[tuple[Array, IntArray, IntArray]] = []
    for piece in clip(points, cells, lower, upper, batch):
        scale = (volumes[piece.cell] * piece.fraction)[:, None]
        values = scale * basis_means(order, piece.barycentric)
        waiting.append((values.ravel(), np.repeat(piece.box, values.shape[1]), nodes[piece.cell].ravel()))
        if sum(len(entry[0]) for entry in waiting) > _ENTRIES:
            total = csr_array(total + _gather(waiting, shape))
            waiting = []
    return csr_array(total + _gather(waiting, shape))


def _gather(entries: list[tuple[Array, IntArray, IntArray]], shape: tuple[int, int]) -> Sparse:
    """Sum of (values, rows, columns) as a csr_array."""
    if not entries:
        return csr_array(shape)
    values, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return csr_array(coo_array((values, (rows, columns)), shape=shape))


def basis_means(order: int, barycentric: Array) -> Array:
    """Means (k, n_local) of the Lagrange basis of a cell over pieces of it.

    Parameters
    ----------
    order : int
        1 or 2.
    barycentric : (k, d + 1, d + 1) array
        Vertices of the pieces: (piece, vertex, coordinate).

    Notes
    -----
    Over a simplex with vertices b₀ … b_d the mean of λᵢ is Sᵢ/(d + 1), and that of λᵢλⱼ is
    (Σ_k b_ki b_kj + SᵢSⱼ) / ((d + 1)(d + 2)), with S = Σ_k b_k.
    """
    size = barycentric.shape[2]
    sums = barycentric.sum(axis=1)
    first = sums / size
    if order == 1:
        return np.asarray(first)
    second = np.swapaxes(barycentric, 1, 2) @ barycentric + sums[:, :, None] * sums[:, None, :]
    second /= size * (size + 1)
    i, j = np.array(local_edges(size - 1)).T
    diagonal = np.arange(size)
    return np.concatenate([2.0 * second[:, diagonal, diagonal] - first, 4.0 * second[:, i, j]], axis=1)


def _layers(coordinates: Array) -> tuple[IntArray, IntArray]:
    """First and last layer (k, d) of boxes that simplices (k, d + 1, d) meet on each axis."""
    low = np.floor(coordinates.min(axis=1))
    high = np.maximum(np.ceil(coordinates.max(axis=1)) - 1.0, low)
    return low.astype(np.int64), high.astype(np.int64)


def _bisect(vertices: Array, low: IntArray, high: IntArray, lower: IntArray, upper: IntArray) -> tuple[Array, IntArray]:
    """Cut each simplex at one grid plane: first where asked boxes end, then in its middle."""
    dim = low.shape[1]
    beneath, above = low < lower, high >= upper
    plane = np.where(beneath, lower, np.where(above, upper, (low + high + 1) // 2))
    crosses = low < high
    leaves: BoolArray = beneath | above
    gain = np.where(crosses, high - low + np.where(leaves, 1 << 40, 0), -1)
    axis = np.argmax(gain, axis=1)
    here = np.arange(len(axis))
    plane = plane[here, axis]
    pieces, source = split(vertices, axis, plane)
    if (vertices[here, :, dim + 1 + axis] == plane[:, None]).any():
        solid = volume_fractions(pieces[:, :, : dim + 1]) > 0
        pieces, source = pieces[solid], source[solid]
    return pieces, source
