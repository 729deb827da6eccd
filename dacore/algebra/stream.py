"""POD of a stream of snapshots, each looked at once.

Blocks of snapshots arrive and are forgotten. An orthonormal set of modes Φ grows: of each block B the
part R = B − ΦC that the modes miss is either small enough to drop, or its own modes are added. What is
dropped of different blocks adds up in squares, since it belongs to different snapshots. At the end, and
seldom before, small modes are cut off; what that takes from the coefficients is known, and comes on top by
the triangle inequality:

    (Σ‖s − Φc‖²)^½ ≤ (Σ_blocks ‖dropped‖²)^½ + Σ_cuts ‖coefficients cut off‖.

Both are measured on all the data, so the bound is a result and no estimate. This is the incremental
hierarchical POD of Himpe, Leibner & Rave, SIAM J. Sci. Comput. 40 (2018) A3267, except that known modes
are not decomposed again with every block, and that no step has to be more accurate for the number of steps.

The modes of R come from RᵀMR = VΛVᵀ by deflation: one Gram matrix resolves singular values down to
about 1e-8 of the largest, so each pass takes six digits and the next works on what is left.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from dacore.algebra.panels import Panels, Rows
from dacore.algebra.svd import thin_svd
from dacore.core.arrays import Array, Sparse
from dacore.errors import AccuracyError, ShapeError

#: Snapshots looked at together: enough for BLAS, few enough for the processor's cache.
WIDTH = 64
#: Digits of singular values that one Gram matrix is asked for.
PASS_DEPTH = 1e-6
MAX_PASSES = 6
#: Below this no tolerance can be met in double precision.
FLOOR = 1e-14

# Of a direction that the modes hold all but a thousandth of, the rest is round-off.
_NEWS = 1e-3
# Shares of the tolerance: for what is dropped of blocks, and for cuts before the end.
_DROPPED, _CUT = 0.25, 0.15
# Bound on the round-off of ‖b‖² − ‖c‖², relative to ‖b‖²; with 100,000 dofs and 120 modes 3e-15 is the most seen.
_CANCELLED = 1e-14


@dataclass(frozen=True, eq=False)
class Decomposition:
    """What a stream leaves behind.

    Parameters
    ----------
    basis : (n, r) array
        Orthonormal modes, the largest first.
    values : (r,) array
        Singular values.
    coefficients : (r, K) array, optional
        Of every snapshot, in the order of arrival.
    error : float
        Bound on (Σ‖s − Φc‖² / Σ‖s‖²)^½ over all snapshots.
    total : float
        Σ‖s‖².
    limited : bool
        Whether there could be no more modes, whatever the tolerance.
    """

    basis: Array
    values: Array
    coefficients: Array | None
    error: float
    total: float
    limited: bool

    def check(self, tolerance: float) -> "Decomposition":
        """Return this; AccuracyError if the error exceeds a positive tolerance and more modes could mend it."""
        if tolerance > 0 and not self.limited and self.error > 1.01 * max(tolerance, FLOOR):
            raise AccuracyError(
                f"POD: {len(self.values)} modes leave a relative error of {self.error:.1e}, "
                f"expected {tolerance:.1e}; raise the tolerance"
            )
        return self


class Stream:
    """Modes of snapshots that arrive block by block.

    Memory is r + 2·width columns (n,) for r modes, and 2r at the end, beside what the caller holds and arrays
    without the length n. With `memory` the width adapts, and more modes than fit are refused.

    Parameters
    ----------
    product : (n, n) csr_array
        Symmetric positive definite inner product M.
    tolerance : float
        Bound on (Σ‖s − Φc‖² / Σ‖s‖²)^½; 0 keeps all that round-off allows.
    steps : int
        Number of snapshots to come; what may be dropped is divided among them. A wrong number costs modes only.
    width : int
        Snapshots looked at together.
    memory : float, optional [GiB]
        Bound on what is held; by default as much as the modes need.
    keep : bool
        Whether to keep the coefficients (r, K) of every snapshot.

    Raises
    ------
    ShapeError
        If the width is not positive, or the memory has no room for 16 snapshots.
    """

    def __init__(
        self,
        product: Sparse,
        tolerance: float,
        steps: int,
        width: int = WIDTH,
        memory: float | None = None,
        keep: bool = False,
    ) -> None:
        if width < 1:
            raise ShapeError(f"width: got {width}, expected at least one snapshot")
        self._rows = Rows(product)
        self._memory = memory
        self._most: int | None = None
        panel = WIDTH
        if memory is not None:
            columns = room(memory, self._rows.n)
            width, panel = min(width, columns // 8), min(panel, columns // 16)
            self._most = (columns - panel) // 2
        self._modes = Panels(self._rows, panel)
        self._width, self._steps = width, max(steps, 1)
        self.tolerance = tolerance
        self._square = max(tolerance, FLOOR) ** 2
        self._buffer: Array | None = None
        self._filled = 0
        self.seen = 0
        self.total = self._granted = self._dropped = self._cut = 0.0
        # Coefficients not yet folded into the factor S (r, k), for which S Sᵀ = Σ c cᵀ.
        self._factor: Array = np.zeros((0, 0))
        self._fresh: list[Array] = []
        self._kept: list[Array] | None = [] if keep else None
        self._last = 0

    @property
    def count(self) -> int:
        """Number of modes held."""
        return self._modes.count

    def add(self, block: Array) -> None:
        """Take in snapshots (n, k), one a column; they are not changed."""
        if block.ndim != 2 or block.shape[0] != self._rows.n:
            raise ShapeError(f"snapshots: got shape {block.shape}, expected ({self._rows.n}, k) as the inner product")
        done = 0
        while done < block.shape[1]:
            if self._buffer is None:
                self._buffer = np.empty((self._rows.n, self._width))
            step = min(self._width - self._filled, block.shape[1] - done)
            self._buffer[:, self._filled : self._filled + step] = block[:, done : done + step]
            done, self._filled = done + step, self._filled + step
            if self._filled == self._width:
                self._filled = 0
                self._absorb(self._buffer)

    def finish(self, max_rank: int | None = None) -> Decomposition:
        """Return the modes of all that came, as few as the tolerance needs; the stream is used up.

        Raises
        ------
        ShapeError
            If no snapshot came, or all were zero.
        """
        if self._buffer is not None and self._filled:
            rest = np.ascontiguousarray(self._buffer[:, : self._filled])
            self._buffer = None
            self._absorb(rest)
        self._buffer = None
        if self.seen == 0:
            raise ShapeError("snapshots: got none, expected at least one")
        if not 0 < self.total < np.inf:
            raise _unfit(self.total)
        vectors, values, tail = self._principal()
        limit = min(self._rows.n, self.seen, len(values) if max_rank is None else max_rank)
        spent = float(np.sqrt(self._dropped)) + self._cut
        allowed = max(0.99 * float(np.sqrt(self._square * self.total)) - spent, 0.0)
        count = min(max(int(np.argmax(tail <= allowed**2)), 1), limit)
        vectors = vectors[:, :count]
        coefficients = None
        if self._kept is not None:
            coefficients = np.concatenate([vectors[: len(part)].T @ part for part in self._kept], axis=1)
            self._kept = []
        basis = self._modes.combine(vectors)
        self._modes = Panels(self._rows)  # the caller checks the basis, and needs the room
        most = min(self._rows.n, self.seen, self.seen if max_rank is None else max_rank)
        error = (spent + float(np.sqrt(tail[count]))) / float(np.sqrt(self.total))
        return Decomposition(basis, values[:count], coefficients, error, self.total, count >= most)

    def _absorb(self, block: Array) -> None:
        """Take in a C-contiguous block (n, k), which is overwritten."""
        found, squares = self._modes.observe(block)
        if not np.isfinite(squares).all():
            if np.isfinite(block).all():
                raise _unfit(float(squares.sum()))
            raise ShapeError(f"snapshots: got {self.seen + len(squares)} columns, expected finite values only")
        self.seen += len(squares)
        energy = float(squares.sum())
        self.total += energy
        # Half by size, half by number: neither a large nor a late block is left without.
        share = min(len(squares) / self._steps, 1.0) if self.seen <= self._steps else 0.0
        self._granted += 0.5 * _DROPPED**2 * self._square * (energy + share * self.total)
        allowed = self._granted - self._dropped
        left = float(np.maximum(squares - np.einsum("ij,ij->j", found, found), 0.0).sum()) + _CANCELLED * energy
        if left > allowed and energy > 0:
            found, left = self._grow(block, found, allowed)
        self._dropped += left
        self._fresh.append(found)
        if self._kept is not None:
            self._kept.append(found)
        if sum(part.shape[1] for part in self._fresh) > max(4 * self.count, 4 * self._width):
            self._fold()
        if self._most is not None and self.count > self._most:
            self._shorten()
            if self.count > self._most:
                raise AccuracyError(
                    f"POD: {self.count} modes after {self.seen} of {self._steps} snapshots at the tolerance "
                    f"{self.tolerance:.1e}, but {self._memory:g} GiB have room for {self._most} of length "
                    f"{self._rows.n}; raise the memory or the tolerance"
                )
        elif self.count > 2 * self._last + 2 * WIDTH:
            self._shorten()

    def _grow(self, block: Array, found: Array, allowed: float) -> tuple[Array, float]:
        """Add modes of what a block has beyond the ones held; its coefficients, and what is left of it."""
        self._modes.subtract(block, found)
        gram = self._rows.gram(block)
        for _ in range(MAX_PASSES):
            left = float(np.maximum(np.diag(gram), 0.0).sum())
            if left <= allowed or self.count >= self._rows.n:
                break
            vectors = leading(gram, allowed, self._rows.n - self.count)
            new = np.empty((self._rows.n, vectors.shape[1]))
            for rows in self._rows.bands():
                new[rows] = block[rows] @ vectors
            new = self._modes.news(new, _NEWS)
            if new.shape[1] == 0:  # what is left is round-off of what was found
                break
            # The new modes are orthogonal to the old, so what they take off the block is their own share only.
            extra = np.zeros((new.shape[1], block.shape[1]))
            for rows, image in self._rows.images(new):
                extra += image.T @ block[rows]
            for rows in self._rows.bands():
                block[rows] -= new[rows] @ extra
            self._modes.append(new)
            found = np.concatenate([found, extra])
            gram = self._rows.gram(block)
        return found, float(np.maximum(np.diag(gram), 0.0).sum())

    def _fold(self) -> None:
        """Put fresh coefficients into the factor."""
        parts = [part for part in (self._factor, *self._fresh) if part.size]
        stacked = np.zeros((self.count, sum(part.shape[1] for part in parts)))
        start = 0
        for part in parts:
            stacked[: len(part), start : start + part.shape[1]] = part
            start += part.shape[1]
        self._factor = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
        self._fresh = []

    def _principal(self) -> tuple[Array, Array, Array]:
        """Principal axes (r, k) of the coefficients, singular values (k,), and tails Σ_{i>n} σ_i² for n = 0 … k."""
        self._fold()
        vectors, values, _ = thin_svd(self._factor)
        tail = np.append(np.cumsum(values[::-1] ** 2)[::-1], 0.0)
        return vectors, values, tail

    def _shorten(self) -> None:
        """Cut off modes that, by what is known so far, are not needed; half of what is left to spend each time."""
        vectors, values, tail = self._principal()
        allowed = 0.5 * max(_CUT * float(np.sqrt(self._square * self.total)) - self._cut, 0.0)
        count = max(int(np.argmax(tail <= allowed**2)), 1)
        self._last = count
        if count > 0.9 * self.count and (self._most is None or count > self._most):
            return
        self._cut += float(np.sqrt(tail[count]))
        vectors = vectors[:, :count]
        self._modes.rotate(vectors)
        self._factor = np.diag(values[:count])
        if self._kept is not None:
            self._kept = [vectors[: len(part)].T @ part for part in self._kept]


def leading(gram: Array, target: float, limit: int) -> Array:
    """Weights (k, q) of the leading modes of columns with a Gram matrix (k, k), each mode of size one.

    As many as leave at most `target` of the squares, and no more than `limit` or than the Gram matrix resolves.
    """
    squares, vectors = eigh(gram, check_finite=False, driver="evd")
    squares, vectors = squares[::-1], vectors[:, ::-1]
    tail = np.append(np.cumsum(np.maximum(squares, 0)[::-1])[::-1], 0.0)
    wanted = int(np.argmax(tail <= 0.98 * target))
    resolved = int((squares > PASS_DEPTH**2 * squares[0]).sum())
    count = min(wanted, resolved, limit)
    return np.asarray(vectors[:, :count] / np.sqrt(squares[:count]))


def room(memory: float, n: int) -> int:
    """How many columns of length n fit in `memory` [GiB], a tenth left for all that is small; ShapeError if too few."""
    columns = int(0.9 * memory * 2**30 / (8 * n))
    if columns < 16:
        least = 16 * 8 * n / 0.9 / 2**30
        raise ShapeError(
            f"memory: got {memory:g} GiB, expected at least {least:.2g} for snapshots of length {n}; raise it"
        )
    return columns


def _unfit(total: float) -> ShapeError:
    return ShapeError(
        f"snapshots: the sum of their squares is {total:g}, expected a positive number; all are zero, or so small "
        "or large that squares leave the range of double: change the unit"
    )
