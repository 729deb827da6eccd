"""The iteration that gives way to a factorisation where it is slow."""

from dacore.algebra.blockwise import BlockSolver
from dacore.algebra.direct import DirectSolver
from dacore.algebra.elimination import Ordering
from dacore.core.arrays import Array, BoolArray, Sparse

# Iterations for one column. At 120,000 to 390,000 unknowns a factorisation costs as much as some 800 to 1600 of them.
PATIENCE = 200
# Entries of a factor of 4 GiB: some 500,000 unknowns of a poroelastic step in three dimensions.
LARGEST_FACTOR = 2**30


class AutoSolver(BlockSolver):
    """`BlockSolver`, and in its place `DirectSolver` once a column stalls or takes more than `PATIENCE` iterations.

    Iterations are counted and no time is measured, so that equal calls give equal results.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    ordering : Ordering, optional
        As for `DirectSolver`; made when it is needed.
    """

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float, ordering: Ordering | None = None) -> None:
        super().__init__(matrix, definite, tolerance)
        self._definite, self._ordering = definite, ordering
        self._direct: DirectSolver | None = None
        self._too_large = False
        self._limit = PATIENCE

    @property
    def name(self) -> str:
        """The method in use."""
        return super().name if self._direct is None else self._direct.name

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return super().advice() if self._direct is None else self._direct.advice()

    def solve(self, rhs: Array, guess: Array | None = None) -> Array:
        """Solve for every column of `rhs` (n,) or (n, k), from `guess` of the same shape."""
        self._limit = self.iterations + PATIENCE * (rhs.shape[1] if rhs.ndim == 2 else 1)
        return super().solve(rhs, guess)

    def correct(self, residual: Array, goal: Array) -> Array:
        """Iterate, or solve with the factor."""
        if self._direct is None and self.iterations > self._limit:
            self.strengthen()
        return super().correct(residual, goal) if self._direct is None else self._direct.correct(residual, goal)

    def strengthen(self) -> bool:
        """Turn to a factor, and from one in single precision to one in double."""
        if self._direct is not None:
            return self._direct.strengthen()
        if self._too_large:
            return False
        ordering = self._ordering or Ordering.of(self.matrix, self._definite)
        self._too_large = ordering.factor_entries > LARGEST_FACTOR
        if self._too_large:
            return False
        self.release()  # never both in memory
        # The matrix is scaled already: its solver scales by one, up to rounding.
        self._direct = DirectSolver(self.matrix, self._definite, self.tolerance, ordering)
        return True
