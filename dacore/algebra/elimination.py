"""The symbolic half of a sparse factorisation: which dofs go together, in which order, and what they touch.

It depends on the sparsity pattern alone, so one `Ordering` serves every parameter sample of a model.
It holds arrays only and can be pickled to worker processes.
"""

from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.ordering import nested_dissection, quotient, same_pattern
from dacore.core.arrays import BoolArray, IntArray, Sparse

# A front of this many dofs is dense anyway; smaller ones cost more calls, larger ones more fill.
_LEAF_DOFS = 160


@dataclass(frozen=True, eq=False)
class Front:
    """One dense step of the elimination.

    Parameters
    ----------
    start : int
        First of its dofs in the permuted order.
    definite, size : int
        Its first `definite` dofs belong to A, the rest of the `size` to −C.
    rows : (r,) int array
        Later dofs, in the permuted order, that its elimination touches; increasing.
    children : tuple of int
        Fronts whose remainders are added to this one.
    place : (r,) int array
        Positions of `rows` among the parent's own dofs followed by the parent's rows.
    """

    start: int
    definite: int
    size: int
    rows: IntArray
    children: tuple[int, ...]
    place: IntArray


@dataclass(frozen=True, eq=False)
class Scatter:
    """Where the entries of a matrix of one pattern go: front i takes ``data[source[i]]`` to ``target[i]``.

    Targets index the transposed panel (size, size + rows) of the front, flattened row by row.
    """

    source: tuple[IntArray, ...]
    target: tuple[IntArray, ...]


@dataclass(frozen=True, eq=False)
class Ordering:
    """A fill-reducing elimination order for one sparsity pattern.

    Parameters
    ----------
    permutation : (n,) int array
        The dof at each place of the elimination.
    fronts : tuple of Front
        In the order of elimination.
    digest : bytes
        Identifies the pattern and the split into A and −C.
    scatter : Scatter
        For matrices of exactly that pattern.
    """

    permutation: IntArray
    fronts: tuple[Front, ...]
    digest: bytes
    scatter: Scatter

    @property
    def factor_entries(self) -> int:
        """Entries of the triangular factor, which bound memory and the time of a solve."""
        return sum(f.size * (f.size + 1) // 2 + f.size * len(f.rows) for f in self.fronts)

    @property
    def operations(self) -> float:
        """Multiply–add pairs times two of one factorisation."""
        return float(sum(f.size**3 / 3 + f.size**2 * len(f.rows) + f.size * len(f.rows) ** 2 for f in self.fronts))

    @staticmethod
    def of(matrix: Sparse, definite: BoolArray, nodes: IntArray | None = None) -> "Ordering":
        """Order the elimination of a matrix by nested dissection.

        Parameters
        ----------
        matrix : (n, n) csr_array
            Symmetric pattern; values do not matter.
        definite : (n,) bool array
            True on the rows of A in [[A, Bᵀ], [B, −C]].
        nodes : (n,) int array, optional
            The mesh node of each row: rows of one node are kept together, which makes the ordering
            several times cheaper to find. By default rows with the same pattern are.
        """
        matrix = canonical(matrix)
        group = np.unique(same_pattern(matrix) if nodes is None else nodes, return_inverse=True)[1].reshape(-1)
        weights, graph = np.bincount(group), quotient(matrix, group)
        dissection = nested_dissection(graph, weights, _LEAF_DOFS)
        # Dofs sorted by part, and within a part those of A first.
        part_of_vertex = np.empty(len(weights), dtype=np.int64)
        part_of_vertex[np.concatenate(dissection.parts)] = np.repeat(
            np.arange(len(dissection.parts)), [len(part) for part in dissection.parts]
        )
        part = part_of_vertex[group]
        permutation = np.lexsort((group, ~definite, part))
        starts = np.searchsorted(part[permutation], np.arange(len(dissection.parts) + 1))
        counts = np.bincount(part[definite], minlength=len(dissection.parts))
        fronts = _fronts(matrix, permutation, starts, counts, dissection.parents)
        scatter = locate(matrix, permutation, fronts)
        if scatter is None:  # unreachable: the fronts were made from this very pattern
            raise ValueError("the fronts do not hold the matrix they were made from")
        return Ordering(permutation, fronts, fingerprint(matrix, definite), scatter)


def canonical(matrix: Sparse) -> Sparse:
    """`matrix` with sorted, unique column indices in each row; a copy only if needed."""
    if matrix.has_canonical_format:
        return matrix
    matrix = matrix.copy()
    matrix.sum_duplicates()
    return matrix


def fingerprint(matrix: Sparse, definite: BoolArray) -> bytes:
    """Digest of a sparsity pattern and its split."""
    digest = blake2b(digest_size=16)
    for array in (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), np.packbits(definite)):
        digest.update(array.tobytes())
    return digest.digest()


def locate(matrix: Sparse, permutation: IntArray, fronts: tuple[Front, ...]) -> Scatter | None:
    """Find the place of every entry of a matrix in the fronts; None if one has no place."""
    row, column, entry = _lower(matrix, permutation)
    starts = np.array([front.start for front in fronts])
    first = np.searchsorted(column, np.append(starts, len(permutation)))
    sources: list[IntArray] = []
    targets: list[IntArray] = []
    for front, begin, end in zip(fronts, first[:-1], first[1:], strict=True):
        rows = row[begin:end]
        stop = front.start + front.size
        below = rows >= stop
        found = np.searchsorted(front.rows, rows)
        inside = np.minimum(found, max(len(front.rows) - 1, 0))
        if below.any() and (not len(front.rows) or (front.rows[inside[below]] != rows[below]).any()):
            return None
        local = np.where(below, front.size + found, rows - front.start)
        width = front.size + len(front.rows)
        sources.append(entry[begin:end].astype(np.int32))
        targets.append(((column[begin:end] - front.start) * width + local).astype(np.int64))
    return Scatter(tuple(sources), tuple(targets))


def _lower(matrix: Sparse, permutation: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Permuted row, column and number of each entry of the lower triangle, column by column."""
    n = len(permutation)
    inverse = np.empty(n, dtype=np.int64)
    inverse[permutation] = np.arange(n)
    row = inverse[np.repeat(np.arange(n), np.diff(matrix.indptr))]
    column = inverse[matrix.indices]
    entry = np.flatnonzero(row >= column)
    # A sparse transposition sorts by column and row, faster than a general sort.
    by_column = csr_array((entry, (column[entry], row[entry])), shape=(n, n))
    by_column.sort_indices()
    columns = np.repeat(np.arange(n), np.diff(by_column.indptr))
    return by_column.indices.astype(np.int64), columns, by_column.data


def _fronts(
    matrix: Sparse, permutation: IntArray, starts: IntArray, counts: IntArray, parents: IntArray
) -> tuple[Front, ...]:
    """Rows that each front touches: its own couplings and what its children leave."""
    row, column, _ = _lower(matrix, permutation)
    first = np.searchsorted(column, starts)
    children: list[list[int]] = [[] for _ in parents]
    for child, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(child)
    rows: list[IntArray] = []
    for i in range(len(parents)):
        touched = np.unique(np.concatenate([row[first[i] : first[i + 1]], *(rows[child] for child in children[i])]))
        rows.append(touched[np.searchsorted(touched, starts[i + 1]) :])
    fronts = []
    for i, parent in enumerate(parents):
        place = np.empty(0, dtype=np.int64)
        if parent >= 0:
            own = np.arange(starts[parent], starts[parent + 1])
            place = np.searchsorted(np.concatenate([own, rows[parent]]), rows[i])
        size = int(starts[i + 1] - starts[i])
        fronts.append(Front(int(starts[i]), int(counts[i]), size, rows[i], tuple(children[i]), place))
    return tuple(fronts)
