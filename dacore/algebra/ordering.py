"""Nested dissection of a graph: a tree of small parts and the thin separators between them.

George, *Nested dissection of a regular finite element mesh*, SIAM J. Numer. Anal. 10 (1973). A part is
cut along the median of a smoothed graph distance, which approximates the slowest vibration of the
graph; the separator is a smallest set of vertices that covers the cut edges (König's theorem). No
coordinates are needed.
"""

from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_bipartite_matching

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse

_SMOOTHING_SWEEPS = 25
_QUANTILES = (0.45, 0.55)  # cuts tried beside the median


@dataclass(frozen=True, eq=False)
class Dissection:
    """Parts of a graph in postorder: eliminating one touches only its descendants and ancestors.

    Parameters
    ----------
    parts : tuple of (s,) int arrays
        Disjoint sets of vertices; every vertex is in one.
    parents : (len(parts),) int array
        The separator above each part, −1 for a root. A parent comes after its children.
    """

    parts: tuple[IntArray, ...]
    parents: IntArray


def same_pattern(matrix: Sparse) -> IntArray:
    """Group (n,) of each row; rows with the same sparsity pattern, diagonal included, share one.

    The components of a field at one node do so, unless exact zeros were dropped.
    """
    n = matrix.shape[0]
    # Sums of fixed pseudo-random 64-bit tags over the pattern agree where the patterns do; a false
    # agreement (probability about n² / 2⁶⁴) would cost fill, not correctness.
    tags = _tags(n)
    rows = np.repeat(np.arange(n), np.diff(matrix.indptr))
    off = rows != matrix.indices
    sums = tags.copy()
    np.add.at(sums, rows[off], tags[matrix.indices[off]])
    return np.asarray(np.unique(sums, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def quotient(matrix: Sparse, group: IntArray) -> csr_matrix:
    """Graph between groups of rows: ones where two different groups are coupled, either way.

    Parameters
    ----------
    matrix : (n, n) csr_array
    group : (n,) int array
        Numbers 0 to v−1, all of them used.

    Returns
    -------
    (v, v) csr_matrix
    """
    rows = group[np.repeat(np.arange(len(group)), np.diff(matrix.indptr))]
    columns = group[matrix.indices]
    off = rows != columns
    size = int(group.max()) + 1
    graph = csr_matrix((np.ones(int(off.sum())), (rows[off], columns[off])), shape=(size, size))
    # Round-off leaves entries on one side of the diagonal where the other side has an exact zero.
    graph = csr_matrix(graph + graph.T)
    graph.data[:] = 1.0
    return graph


def nested_dissection(graph: csr_matrix, weights: IntArray, leaf: int) -> Dissection:
    """Cut a graph until no part weighs more than `leaf`.

    Parameters
    ----------
    graph : (v, v) csr_matrix
        Symmetric, ones off the diagonal, nothing on it.
    weights : (v,) int array
    leaf : int
        Largest weight of a part that is not cut further.
    """
    parts: list[IntArray] = []
    parents: list[int] = []

    def emit(vertices: IntArray, children: list[int]) -> int:
        parts.append(vertices)
        parents.append(-1)
        for child in children:
            parents[child] = len(parts) - 1
        return len(parts) - 1

    def descend(local: csr_matrix, vertices: IntArray) -> list[int]:
        if weights[vertices].sum() <= leaf or len(vertices) == 1:
            return [emit(vertices, [])]
        heavy, light = _components(local, weights[vertices], leaf)
        if light or len(heavy) > 1:
            below = [root for piece in heavy for root in descend(_restrict(local, piece), vertices[piece])]
            return below + [emit(vertices[piece], []) for piece in light]
        side, separator = _bisect(local, weights[vertices])
        halves = [np.flatnonzero(half & ~separator) for half in (side, ~side)]
        below = [root for half in halves if len(half) for root in descend(_restrict(local, half), vertices[half])]
        return [emit(vertices[separator], below)]

    descend(graph, np.arange(graph.shape[0]))
    return Dissection(tuple(parts), np.array(parents, dtype=np.int64))


def _tags(n: int) -> Any:
    """Fixed well-mixed 64-bit numbers (splitmix64) for 0..n−1."""
    z = np.arange(1, n + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _restrict(graph: csr_matrix, vertices: IntArray) -> csr_matrix:
    return graph[vertices][:, vertices]


def _components(graph: csr_matrix, weights: IntArray, leaf: int) -> tuple[list[IntArray], list[IntArray]]:
    """Connected components heavier than `leaf`, and the others gathered into batches of up to twice that."""
    count, label = connected_components(graph, directed=True, connection="strong")  # no transposing: it is symmetric
    weight = np.bincount(label, weights=weights, minlength=count)
    few = weight <= leaf
    batch = np.where(few, (np.cumsum(np.where(few, weight, 0.0)) // leaf).astype(np.int64), np.arange(count))
    return _gather(batch[label], ~few[label]), _gather(batch[label], few[label])


def _gather(number: IntArray, chosen: BoolArray) -> list[IntArray]:
    """The chosen vertices, by number."""
    vertices = np.flatnonzero(chosen)
    vertices = vertices[np.argsort(number[vertices], kind="stable")]
    return np.split(vertices, np.flatnonzero(np.diff(number[vertices])) + 1) if len(vertices) else []


def _distance(graph: csr_matrix, root: int) -> tuple[IntArray, int]:
    """Breadth-first distance of each vertex of a connected graph from `root`, and a farthest vertex."""
    order, predecessor = breadth_first_order(graph, root, directed=True, return_predecessors=True)
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    above = position[predecessor[order[1:]]]  # never falls, so one level is one slice
    depth = np.zeros(len(order), dtype=np.int64)
    first, last, level = 0, 1, 0
    while last < len(order):
        level += 1
        first, last = last, int(np.searchsorted(above, last - 1, side="right")) + 1
        depth[first:last] = level
    return depth[position], int(order[-1])


def _directions(graph: csr_matrix) -> Array:
    """Two smooth functions (v, 2) that vary along the two longest extents of a connected graph."""
    _, far = _distance(graph, 0)
    one, opposite = _distance(graph, far)
    two, _ = _distance(graph, opposite)
    three, aside = _distance(graph, int(np.argmax(np.minimum(one, two))))
    four, _ = _distance(graph, aside)
    functions = np.column_stack([one - two, three - four]).astype(np.float64)
    degree = np.asarray(graph.sum(axis=1)).reshape(-1, 1)
    for _ in range(_SMOOTHING_SWEEPS):
        functions -= functions.mean(axis=0)
        functions = 0.5 * (functions + (graph @ functions) / degree)
    return functions


def _bisect(graph: csr_matrix, weights: IntArray) -> tuple[BoolArray, BoolArray]:
    """Side (True: first) and separator of the best of a few cuts of a connected graph of two or more vertices."""
    functions = _directions(graph)
    middle = [_cut(graph, weights, function, 0.5) for function in functions.T]
    best = int(np.argmin([score for score, _, _ in middle]))
    aside = [_cut(graph, weights, functions[:, best], quantile) for quantile in _QUANTILES]
    _, side, separator = min([middle[best], *aside], key=itemgetter(0))
    return side, separator


def _cut(graph: csr_matrix, weights: IntArray, function: Array, quantile: float) -> tuple[float, BoolArray, BoolArray]:
    """Score (less is better), side and separator of a cut at a quantile of a function of the vertices."""
    order = np.argsort(function, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    side = np.zeros(len(weights), dtype=np.bool_)
    side[order[: min(max(int(np.searchsorted(share, quantile)), 1), len(weights) - 1)]] = True
    separator = _cover(graph, side)
    first, second = (int(weights[half & ~separator].sum()) for half in (side, ~side))
    balance = max(first, second) / max(min(first, second), 1)
    return float(weights[separator].sum()) * (0.5 + 0.5 * balance), side, separator


def _cover(graph: csr_matrix, side: BoolArray) -> BoolArray:
    """A smallest vertex cover of the edges between the two sides, from a largest matching (König)."""
    edges = graph[side].tocoo()
    cut = ~side[edges.col]
    rows, row = np.unique(np.flatnonzero(side)[edges.row[cut]], return_inverse=True)
    columns, column = np.unique(edges.col[cut], return_inverse=True)
    forward = csr_matrix((np.ones(len(row)), (row, column)), shape=(len(rows), len(columns)))
    backward = csr_matrix(forward.T)
    mate = maximum_bipartite_matching(forward, perm_type="column")
    mate_of_column = np.full(len(columns), -1)
    mate_of_column[mate[mate >= 0]] = np.flatnonzero(mate >= 0)
    reached_rows, reached_columns = mate < 0, np.zeros(len(columns), dtype=np.bool_)
    front = reached_rows.copy()
    while front.any():
        new = (backward @ front.astype(np.float64) > 0) & ~reached_columns
        reached_columns |= new
        mates = mate_of_column[new]
        front = np.zeros(len(rows), dtype=np.bool_)
        front[mates[mates >= 0]] = True
        front &= ~reached_rows
        reached_rows |= front
    cover = np.zeros(graph.shape[0], dtype=np.bool_)
    cover[rows[~reached_rows]] = True
    cover[columns[reached_columns]] = True
    return cover
