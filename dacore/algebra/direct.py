"""The direct solver: a factorisation in single precision, refined in double."""

import numpy as np
from numpy.typing import DTypeLike

from dacore.algebra.elimination import Ordering, Scatter, fingerprint, locate
from dacore.algebra.factorisation import Factorisation
from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.errors import ConvergenceError


class DirectSolver(CorrectingSolver):
    """Multifrontal factorisation with iterative refinement.

    The factor is made in single precision, which halves time and memory; each refinement gains about
    six digits on a well-scaled system. If it gains too little, or the matrix is not quasi-definite in
    single precision, a factor in double precision takes its place.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    ordering : Ordering, optional
        Of a matrix with the same pattern (or a larger one); made anew if absent or unfit.
    """

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float, ordering: Ordering | None = None) -> None:
        super().__init__(matrix, definite, tolerance)
        self._ordering, self._scatter = _fit(self.matrix, definite, ordering)
        self._double = False
        try:
            self._factor = self._factorise(np.float32)
        except ConvergenceError:
            self.strengthen()

    @property
    def name(self) -> str:
        """The method and its precision."""
        return f"direct solver ({'double' if self._double else 'single'} precision factor)"

    def _factorise(self, dtype: DTypeLike) -> Factorisation:
        return Factorisation(self._ordering, self._scatter, self.matrix.data, dtype)

    def strengthen(self) -> bool:
        """Turn to a factor in double precision."""
        if self._double:
            return False
        self._double = True
        self.__dict__.pop("_factor", None)  # never both in memory
        self._factor = self._factorise(np.float64)
        return True

    def correct(self, residual: Array, goal: Array) -> Array:
        """Solve with the factor."""
        # Single precision has a narrow range: solve for residuals of size one.
        size = np.linalg.norm(residual, axis=0)
        return np.asarray(self._factor.solve(residual / size) * size)


def _fit(matrix: Sparse, definite: BoolArray, ordering: Ordering | None) -> tuple[Ordering, Scatter]:
    """`ordering` if it serves the matrix, or a new one; and the places of the entries in it."""
    if ordering is not None and len(ordering.permutation) == matrix.shape[0]:
        if ordering.digest == fingerprint(matrix, definite):
            return ordering, ordering.scatter
        # Entries that cancelled in one of the two matrices do no harm: the fronts have room for more.
        split = definite[ordering.permutation]
        if all(_agrees(split[f.start : f.start + f.size], f.definite) for f in ordering.fronts):
            scatter = locate(matrix, ordering.permutation, ordering.fronts)
            if scatter is not None:
                return ordering, scatter
    ordering = Ordering.of(matrix, definite)
    return ordering, ordering.scatter


def _agrees(split: BoolArray, definite: int) -> bool:
    return bool(split[:definite].all() and not split[definite:].any())
