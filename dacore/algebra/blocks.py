"""Symmetric matrices that fall apart into blocks, many of them equal, as Gram matrices of vector images do.

The three components of a voxel image share no degree of freedom: their Gram matrix is three times the same
block, and only one is kept and factorised.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.errors import ShapeError, UnstableError

_SMALLEST = 1e-7


@dataclass(frozen=True, eq=False)
class Blocks:
    """A symmetric matrix (m, m) with blocks on rows that share nothing with other rows.

    Parameters
    ----------
    size : int
        m.
    parts : sequence of ((c, k) int array, (k, k) array)
        Rows of the c equal blocks, and the block. Every row is in one of them.
    """

    size: int
    parts: Sequence[tuple[IntArray, Array]]

    def __post_init__(self) -> None:
        rows = np.sort(np.concatenate([each.ravel() for each, _ in self.parts])) if self.parts else np.zeros(0)
        if not np.array_equal(rows, np.arange(self.size)):
            raise ShapeError(f"blocks: their rows number {rows.size}, expected each of {self.size} once")

    @classmethod
    def of(cls, matrix: Array) -> "Blocks":
        """Find the blocks of a symmetric matrix (m, m); entries that are zero connect nothing."""
        found: dict[tuple[int, int], list[tuple[list[IntArray], Array]]] = {}
        for rows in _connected(matrix):
            block = np.asarray(matrix[np.ix_(rows, rows)])
            # Blocks of one size are compared; their first entries tell most apart.
            same = found.setdefault((len(rows), hash(block[0].tobytes())), [])
            for places, known in same:
                if np.array_equal(known, block):
                    places.append(rows)
                    break
            else:
                same.append(([rows], block))
        return cls(len(matrix), [(np.array(places), block) for same in found.values() for places, block in same])

    def __matmul__(self, values: Array) -> Array:
        """The matrix times values (m, ...)."""
        flat = values.reshape(values.shape[0], -1)
        out = np.empty((self.size, flat.shape[1]))
        for places, block in self.parts:
            out[places] = block @ flat[places]
        return out.reshape(values.shape)

    def dense(self) -> Array:
        """The whole matrix (m, m)."""
        return _dense(self.size, self.parts)

    def kept(self, mask: BoolArray | None) -> "Blocks":
        """The same for the rows of a mask (m,), numbered anew."""
        if mask is None or mask.all():
            return self
        numbers = np.cumsum(mask) - 1
        parts = []
        for places, block in self.parts:
            patterns, which = np.unique(mask[places], axis=0, return_inverse=True)
            for number, pattern in enumerate(patterns):
                if pattern.any():
                    rows = numbers[places[which.ravel() == number][:, pattern]]
                    parts.append((rows, np.asarray(block[np.ix_(pattern, pattern)])))
        return Blocks(int(mask.sum()), parts)

    def factor(self, labels: tuple[str, ...]) -> "LowerBlocks":
        """Cholesky factor of each block.

        Parameters
        ----------
        labels : m str
            What each row is called in a message.

        Raises
        ------
        UnstableError
            If rows are linearly dependent to round-off; names two of them.
        """
        factors, failed = [], False
        for places, block in self.parts:
            scale = np.sqrt(np.diag(block))
            scaled = block / np.outer(scale, scale)
            try:
                lower = np.asarray(cholesky(scaled, lower=True, overwrite_a=True))
                failed |= float(np.diag(lower).min()) < _SMALLEST
            except np.linalg.LinAlgError:
                failed = True
            if failed:
                break
            lower *= scale[:, None]
            factors.append((places, lower))
        if failed:
            raise self._dependent(labels)
        return LowerBlocks(self.size, factors)

    def _dependent(self, labels: tuple[str, ...]) -> UnstableError:
        worst, pair = -1.0, (0, 0)
        for places, block in self.parts:
            scale = np.sqrt(np.diag(block))
            off = np.abs(block / np.outer(scale, scale) - np.eye(len(block)))
            i, j = np.unravel_index(int(off.argmax()), off.shape)
            if off[i, j] > worst:
                worst, pair = float(off[i, j]), (int(places[0, i]), int(places[0, j]))
        return UnstableError(
            f"functionals are linearly dependent; the closest pair is {labels[pair[0]]} and {labels[pair[1]]} "
            f"(cosine {worst:.9f}); drop duplicates"
        )


@dataclass(frozen=True, eq=False)
class LowerBlocks:
    """Lower Cholesky factor R (m, m) of `Blocks`.

    Parameters
    ----------
    size : int
    parts : sequence of ((c, k) int array, (k, k) array)
        As of `Blocks`; triangular in the order of each row of the places, which increases.
    """

    size: int
    parts: Sequence[tuple[IntArray, Array]]

    @property
    def shape(self) -> tuple[int, int]:
        """(m, m)."""
        return self.size, self.size

    def dense(self) -> Array:
        """The whole factor (m, m), lower triangular."""
        return _dense(self.size, self.parts)

    def solve(self, values: Array, transposed: bool = False) -> Array:
        """R⁻¹ values, or R⁻ᵀ values, for values (m, ...)."""
        flat = values.reshape(values.shape[0], -1)
        if len(flat) != self.size:
            raise ShapeError(f"triangular system: got {len(flat)} rows, expected {self.size}")
        out = np.empty(flat.shape)
        for places, lower in self.parts:
            # Equal blocks stand side by side, so each is one system with many columns.
            beside = flat[places].swapaxes(0, 1)
            solved = solve_triangular(
                lower, beside.reshape(len(lower), -1), lower=True, trans="T" if transposed else "N", check_finite=False
            )
            out[places] = solved.reshape(beside.shape).swapaxes(0, 1)
        return out.reshape(values.shape)


def _dense(size: int, parts: Sequence[tuple[IntArray, Array]]) -> Array:
    out = np.zeros((size, size))
    for places, block in parts:
        for rows in places:
            out[np.ix_(rows, rows)] = block
    return out


def _connected(matrix: Array) -> Iterator[IntArray]:
    """Yield rows, in increasing order, of each set that no entry of a symmetric matrix joins to another."""
    free = np.ones(len(matrix), dtype=bool)
    for start in range(len(matrix)):
        if not free[start]:
            continue
        member = np.zeros(len(matrix), dtype=bool)
        member[start] = True
        waiting = [start]
        while waiting:
            # A full block is found in one step; a chain takes a step a row.
            new = (matrix[waiting.pop()] != 0) & ~member
            member |= new
            waiting.extend(np.flatnonzero(new).tolist())
            if waiting and member.sum() == free.sum():
                break
        free &= ~member
        yield np.flatnonzero(member)
