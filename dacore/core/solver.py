"""What solves the linear systems of a time step: settings that come through the plugin door, and a prepared solver."""

from abc import ABC, abstractmethod
from typing import Any

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse


class LinearSolver(ABC):
    """Solves K x = b for one matrix K and many right-hand sides."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The method, for messages."""

    @abstractmethod
    def solve(self, rhs: Array, guess: Array | None = None) -> Array:
        """Solve for every column of `rhs`.

        Parameters
        ----------
        rhs : (n,) or (n, k) array
        guess : array of the shape of `rhs`, optional
            Where to start; zero by default.

        Returns
        -------
        array of the shape of `rhs`

        Raises
        ------
        ConvergenceError
            If a column does not reach the tolerance.
        ShapeError
            If a shape is wrong or a value is not finite.
        """


class SolverMethod(ABC):
    """Frozen settings of a linear solver; a plugin class of the hook ``dacore_solvers``.

    Systems are symmetric quasi-definite, K = [[A, Bᵀ], [B, −C]] with A and C positive definite and
    rows in any order; positive definite where there is no C. `dacore.algebra.linear_solver` has a
    base class that scales such a system, checks the true residual and starts from what it solved before.
    """

    def analyse(self, matrix: Sparse, definite: BoolArray, nodes: IntArray) -> Any:
        """Find what depends on the sparsity pattern alone, once for all parameter samples.

        Parameters
        ----------
        matrix : (n, n) csr_array
            A matrix with the pattern.
        definite : (n,) bool array
            True on the rows of A.
        nodes : (n,) int array
            The node each row belongs to; rows of one node stay together in a good ordering.

        Returns
        -------
        object
            Pickled to worker processes; None, the default, if there is nothing to find.
        """
        return None

    @abstractmethod
    def prepare(self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None) -> LinearSolver:
        """Prepare a solver for one matrix.

        Parameters
        ----------
        matrix : (n, n) csr_array
        definite : (n,) bool array
            True on the rows of A; all True for a positive definite matrix.
        tolerance : float
            Bound on the relative residual of every column, ‖D(b − K x)‖ ≤ tolerance · ‖D b‖, in the
            system scaled to D K D, where D makes the diagonals of A and of C + B diag(A)⁻¹ Bᵀ one.
        analysis : object, optional
            What `analyse` returned for a matrix with this pattern; None if it was not asked.

        Raises
        ------
        ShapeError
            If the matrix is not as described.
        ConvergenceError
            If it turns out not to be quasi-definite.
        """
