"""The built-in linear solvers, declared through the plugin door.

What they cost beside the plugins' solvers, and how `Auto` chooses, is in ``docs/solvers.md``; measured by
``tests/benchmarks/solvers.py``.
"""

from dataclasses import dataclass

from dacore.algebra.auto import AutoSolver
from dacore.algebra.blockwise import BlockSolver
from dacore.algebra.direct import DirectSolver
from dacore.algebra.elimination import Ordering
from dacore.core.arrays import BoolArray, IntArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod

# Unknowns from which the iteration is cheaper over a few tens of steps, and takes a third of the memory.
_DIRECT_UNKNOWNS = 60_000


@dataclass(frozen=True)
class Direct(SolverMethod):
    """Multifrontal factorisation in single precision, refined in double."""

    def analyse(self, matrix: Sparse, definite: BoolArray, nodes: IntArray) -> Ordering:
        """Return the order of elimination."""
        return Ordering.of(matrix, definite, nodes)

    def prepare(
        self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Ordering | None = None
    ) -> LinearSolver:
        """Factorise the matrix."""
        return DirectSolver(matrix, definite, tolerance, analysis)


@dataclass(frozen=True)
class Krylov(SolverMethod):
    """Block-preconditioned GMRES; conjugate gradients for a positive definite matrix."""

    def prepare(
        self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Ordering | None = None
    ) -> LinearSolver:
        """Make the preconditioner."""
        return BlockSolver(matrix, definite, tolerance)


@dataclass(frozen=True)
class Auto(SolverMethod):
    """The direct method for up to 60,000 unknowns; above, the iteration, and the direct method where that is slow.

    The iteration is slow where a column takes more than `dacore.algebra.auto.PATIENCE` iterations. The direct
    method then takes its place for the rest of the steps of that matrix, if its factor fits in 4 GiB.
    """

    def analyse(self, matrix: Sparse, definite: BoolArray, nodes: IntArray) -> Ordering | None:
        """Return the order of elimination where the direct method comes first."""
        return Ordering.of(matrix, definite, nodes) if matrix.shape[0] <= _DIRECT_UNKNOWNS else None

    def prepare(
        self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Ordering | None = None
    ) -> LinearSolver:
        """Prepare the method that suits the size."""
        if matrix.shape[0] <= _DIRECT_UNKNOWNS:
            return DirectSolver(matrix, definite, tolerance, analysis)
        return AutoSolver(matrix, definite, tolerance, analysis)
