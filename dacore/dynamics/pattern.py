"""Sums of sparse matrices with varying coefficients, on one sparsity pattern made once.

Adding sparse matrices merges their patterns anew each time; for many samples of a parameter this
costs more than the numbers. Here the union of the patterns is made once, and a sum is a sum of
value vectors. No value is copied: of every matrix only the place of its entries is kept, and matrices
of one pattern share that.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.errors import ShapeError

Places = NDArray[np.int32]

_ENTRIES = 2**19


class PatternSum:
    """Two blocks of Σ_i c_i · T_i for fixed matrices T_i of one shape: some rows, and two sets of columns of them.

    Parameters
    ----------
    matrices : sequence of (n, n) csr_array
        With sorted column indices and no entry twice; kept, not copied.
    shape : (int, int)
        Of every matrix.
    rows : (r,) int array
        The rows that are summed, increasing.
    columns : sequence of (c,) int arrays
        The columns of each block, increasing; no column is in two.
    """

    def __init__(
        self, matrices: Sequence[Sparse], shape: tuple[int, int], rows: IntArray, columns: Sequence[IntArray]
    ) -> None:
        self._matrices = tuple(_canonical(matrix, shape) for matrix in matrices)
        inside = np.zeros(shape[0], dtype=bool)
        inside[rows] = True
        # Columns in the order of the blocks, so that a row of the sum is a row of each block in turn.
        order = np.concatenate(columns)
        number = np.full(shape[1], len(order), dtype=np.int32)
        number[order] = np.arange(len(order), dtype=np.int32)
        union = _union(self._matrices, shape, rows, number, len(order))
        starts = np.cumsum([0, *map(len, columns)])
        self._shapes = [(len(rows), len(block)) for block in columns]
        self._patterns = []
        # Entry e of the union is entry `offset[e]` of the blocks' values, one block after the other.
        offset, begin = np.empty(union.nnz, dtype=np.int32), 0
        for start, stop in pairwise(starts):
            chosen = (union.indices >= start) & (union.indices < stop)
            count = int(chosen.sum())
            offset[chosen] = np.arange(begin, begin + count, dtype=np.int32)
            self._patterns.append(((union.indices[chosen] - start).astype(np.int32), _ends(chosen, union.indptr)))
            begin += count
        self._size = begin
        self._places = _places(self._matrices, union, offset, inside, number, begin)

    def combine(self, coefficients: Array) -> list[Sparse]:
        """Return the blocks (r, c) of Σ_i c_i T_i for coefficients (k,)."""
        # What lies outside the blocks is gathered in one more entry.
        data = np.zeros(self._size + 1)
        for coefficient, matrix, places in zip(coefficients, self._matrices, self._places, strict=True):
            for begin in range(0, len(places) if coefficient else 0, _ENTRIES):  # bounds the work space
                part = slice(begin, begin + _ENTRIES)
                data[places[part]] += coefficient * matrix.data[part]
        blocks, begin = [], 0
        for (indices, indptr), shape in zip(self._patterns, self._shapes, strict=True):
            block = csr_array((data[begin : begin + len(indices)], indices, indptr), shape=shape)
            block.has_canonical_format = True
            blocks.append(block)
            begin += len(indices)
        return blocks


def _canonical(matrix: Sparse, shape: tuple[int, int]) -> Sparse:
    if matrix.shape != shape:
        raise ShapeError(f"matrices of a sum: got shape {matrix.shape}, expected {shape}")
    matrix = csr_array(matrix)
    if matrix.has_canonical_format:
        return matrix
    matrix = matrix.copy()
    matrix.sum_duplicates()
    return matrix


def _union(matrices: Sequence[Sparse], shape: tuple[int, int], rows: IntArray, number: Places, width: int) -> Sparse:
    """Pattern of all matrices: the chosen rows, columns renumbered and those with no number left out."""
    union = csr_array(shape, dtype=np.int8)
    for matrix in _distinct(matrices):
        ones = csr_array((np.ones(matrix.nnz, dtype=np.int8), matrix.indices, matrix.indptr), shape=shape)
        union = csr_array(union + ones)
        union.data[:] = 1  # so that no sum overflows
    union = csr_array(union[rows])
    columns = number[union.indices]
    kept = columns < width
    indptr = _ends(kept, union.indptr)
    union = csr_array((np.ones(int(kept.sum()), dtype=np.int8), columns[kept], indptr), shape=(len(rows), width))
    union.sort_indices()
    return union


def _ends(chosen: NDArray[np.bool_], indptr: NDArray[Any]) -> Places:
    """Row pointers of the chosen entries alone."""
    return np.asarray(np.concatenate([np.zeros(1, dtype=np.int32), np.cumsum(chosen, dtype=np.int32)])[indptr])


def _places(
    matrices: Sequence[Sparse], union: Sparse, offset: Places, inside: NDArray[Any], number: Places, outside: int
) -> list[Places]:
    """Place of each matrix's entries among the values of the blocks; `outside` for what is in none."""
    keys = _keys(np.arange(union.shape[0]), np.diff(union.indptr), union.indices, union.shape[1])
    position = np.cumsum(inside) - 1
    found: list[Places] = []
    for index, matrix in enumerate(matrices):
        same = next((i for i in range(index) if _same(matrices[i], matrix)), None)
        if same is not None:
            found.append(found[same])
            continue
        places = np.full(matrix.nnz, outside, dtype=np.int32)
        chosen = np.repeat(inside, np.diff(matrix.indptr)) & (number[matrix.indices] < union.shape[1])
        rows = np.repeat(position, np.diff(matrix.indptr))[chosen]
        wanted = rows * union.shape[1] + number[matrix.indices[chosen]]
        places[chosen] = offset[np.searchsorted(keys, wanted)]
        found.append(places)
    return found


def _keys(rows: IntArray, counts: IntArray, columns: NDArray[Any], width: int) -> IntArray:
    """One number for each stored entry, increasing in canonical order."""
    return np.asarray(np.repeat(rows.astype(np.int64), counts) * width + columns, dtype=np.int64)


def _same(one: Sparse, other: Sparse) -> bool:
    """Whether two matrices have one pattern."""
    if one.nnz != other.nnz or not np.array_equal(one.indptr, other.indptr):
        return False
    return one.indices is other.indices or bool(np.array_equal(one.indices, other.indices))


def _distinct(matrices: Sequence[Sparse]) -> list[Sparse]:
    """One matrix of each pattern."""
    found: list[Sparse] = []
    for matrix in matrices:
        if not any(_same(other, matrix) for other in found):
            found.append(matrix)
    return found
