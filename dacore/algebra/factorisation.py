"""Multifrontal factorisation of symmetric quasi-definite matrices in dense blocks.

A quasi-definite matrix has a factorisation L S Lᵀ, S = diag(±1), for every symmetric permutation
(Vanderbei, *Symmetric quasidefinite matrices*, SIAM J. Optim. 5, 1995), so no pivoting is needed and
each front is two dense Cholesky factorisations: one of its A, one of its C + B A⁻¹ Bᵀ. The work is
done by BLAS on matrices that stay in cache (Duff and Reid, ACM TOMS 9, 1983).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.linalg import get_blas_funcs, get_lapack_funcs

from dacore.algebra.elimination import Front, Ordering, Scatter
from dacore.algebra.threads import one_blas_thread
from dacore.core.arrays import Array, IntArray
from dacore.errors import ConvergenceError

Dense = NDArray[Any]
_CHUNK = 64  # rows of a child added at a time: small enough for the cache


@dataclass(frozen=True, eq=False)
class _Block:
    """A front's part of L: inverses of its two triangles, and what lies below them."""

    first: Dense  # (d, d) inverse Cholesky factor of A
    below_first: Dense  # (size − d + r, d)
    second: Dense  # (size − d, size − d) inverse Cholesky factor of the Schur complement
    below_second: Dense  # (r, size − d)


class Factorisation:
    """L S Lᵀ of one matrix.

    Parameters
    ----------
    ordering : Ordering
    scatter : Scatter
        Places of the matrix's entries.
    data : (nnz,) array
        The entries.
    dtype : float32 or float64
        Precision of the factor. Single precision takes half the time and memory, and leaves a
        relative error of about 1e-7 times the condition number to be refined away.

    Raises
    ------
    ConvergenceError
        If the matrix is not quasi-definite in this precision.
    """

    def __init__(self, ordering: Ordering, scatter: Scatter, data: Array, dtype: DTypeLike) -> None:
        self._ordering = ordering
        self._dtype = np.dtype(dtype)
        entries = data.astype(self._dtype)
        remainders: dict[int, Dense] = {}
        self._blocks: list[_Block] = []
        with one_blas_thread():
            for i, front in enumerate(ordering.fronts):
                panel, rest = self._assemble(front, scatter.source[i], scatter.target[i], entries, remainders)
                block, remainders[i] = _eliminate(front, panel, rest)
                self._blocks.append(block)

    def _assemble(
        self, front: Front, source: IntArray, target: IntArray, entries: Dense, remainders: dict[int, Dense]
    ) -> tuple[Dense, Dense]:
        """Transposed panel (size, size + r) and remainder (r, r), upper triangles, of a front."""
        below = len(front.rows)
        panel = np.zeros((front.size, front.size + below), dtype=self._dtype)
        panel.reshape(-1)[target] = entries[source]
        rest = np.zeros((below, below), dtype=self._dtype)
        for child in front.children:
            place = self._ordering.fronts[child].place
            remainder = remainders.pop(child)
            own = int(np.searchsorted(place, front.size))
            _add(panel, remainder[:own], place[:own], place)
            _add(rest, remainder[own:, own:], place[own:] - front.size, place[own:] - front.size)
        return panel, rest

    def solve(self, rhs: Dense) -> Array:
        """Solve for (n, k) columns in the factor's precision; the result is float64."""
        fronts = self._ordering.fronts
        work = rhs[self._ordering.permutation].astype(self._dtype)
        for front, block in zip(fronts, self._blocks, strict=True):
            middle, stop = front.start + front.definite, front.start + front.size
            if front.definite:
                head = block.first @ work[front.start : middle]
                work[front.start : middle] = head
                change = block.below_first @ head
                work[middle:stop] -= change[: stop - middle]
                work[front.rows] -= change[stop - middle :]
            if stop > middle:
                head = block.second @ work[middle:stop]
                work[middle:stop] = head
                work[front.rows] += block.below_second @ head
        for front, block in zip(reversed(fronts), reversed(self._blocks), strict=True):
            middle, stop = front.start + front.definite, front.start + front.size
            later = work[front.rows]
            if stop > middle:
                work[middle:stop] = block.second.T @ (block.below_second.T @ later - work[middle:stop])
            if front.definite:
                later = np.concatenate([work[middle:stop], later])
                work[front.start : middle] = block.first.T @ (work[front.start : middle] - block.below_first.T @ later)
        solution = np.empty(rhs.shape, dtype=np.float64)
        solution[self._ordering.permutation] = work
        return solution


def _add(target: Dense, block: Dense, rows: IntArray, columns: IntArray) -> None:
    """``target[rows, columns] += block`` on the upper triangle, `rows` being the first of `columns`."""
    if not len(rows):
        return
    # Gathering along whole rows, with zeros where nothing is added, is several times faster than
    # indexing both axes.
    width = target.shape[1]
    gather = np.zeros(width, dtype=np.int64)
    gather[columns] = np.arange(len(columns))
    present = np.zeros(width, dtype=target.dtype)
    present[columns] = 1.0
    for begin in range(0, len(rows), _CHUNK):
        chunk = slice(begin, begin + _CHUNK)
        left = rows[begin]
        spread = block[chunk].take(gather[left:], axis=1, mode="clip")
        spread *= present[left:]
        target[rows[chunk], left:] += spread


def _eliminate(front: Front, panel: Dense, rest: Dense) -> tuple[_Block, Dense]:
    """Factor a front; what remains of the rows below it is returned as an upper triangle."""
    trsm, syrk = get_blas_funcs(("trsm", "syrk"), dtype=panel.dtype)
    definite, others = front.definite, front.size - front.definite
    # BLAS wants columns together: the transposes of these row-wise arrays are just that.
    first = _inverse_cholesky(panel[:definite, :definite].T, front, "A")
    below_first = np.ascontiguousarray(panel[:definite, definite:]).T
    second_panel = np.ascontiguousarray(panel[definite:, definite:]).T
    remainder = rest.T
    if definite and below_first.size:
        below_first = trsm(1.0, first[0], below_first, side=1, lower=1, trans_a=1, overwrite_b=1)
        if others:
            second_panel = second_panel - below_first @ below_first[:others].T
        if remainder.size:
            tail = np.asfortranarray(below_first[others:])
            remainder = syrk(-1.0, tail, beta=1.0, c=remainder, lower=1, overwrite_c=1)
    second = _inverse_cholesky(-second_panel[:others], front, "C")
    below_second = np.asfortranarray(second_panel[others:])
    if others and remainder.size:
        below_second = trsm(1.0, second[0], below_second, side=1, lower=1, trans_a=1, overwrite_b=1)
        remainder = syrk(1.0, below_second, beta=1.0, c=remainder, lower=1, overwrite_c=1)
    return _Block(first[1], below_first, second[1], below_second), remainder.T


def _inverse_cholesky(matrix: Dense, front: Front, name: str) -> tuple[Dense, Dense]:
    """Cholesky factor of the lower triangle of `matrix`, and its inverse."""
    if not matrix.size:
        return matrix, matrix
    potrf, trtri = get_lapack_funcs(("potrf", "trtri"), dtype=matrix.dtype)
    factor, failed = potrf(np.asfortranarray(matrix), lower=1, clean=1)
    if failed:
        raise ConvergenceError(
            f"factorisation: block {name} of the front at {front.start} is not positive definite in {matrix.dtype}; "
            "expected a nonsingular quasi-definite matrix: check boundary conditions, parameters and the signs of rows"
        )
    return factor, trtri(factor, lower=1)[0]
