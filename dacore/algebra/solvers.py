"""The built-in linear solvers, declared through the plugin door.

CPU seconds of one thread over a cycle of 40 time steps of poroelasticity on anatomical meshes, the
ordering found beforehand, memory beyond the matrix (``tests/benchmarks/solvers.py``):

========  ========  =========  ========================  =======  =======  ====  ======
nodes     unknowns  tolerance  method                    set-up   a step   its   GiB
========  ========  =========  ========================  =======  =======  ====  ======
5,055     18,176    1e-10      direct                    0.25     0.026    –     0.05
5,055     18,176    1e-10      krylov                    0.19     0.047    18    0.02
5,055     18,176    1e-10      SuperLU, minimum degree   2.66     0.020    –     0.19
5,055     18,176    1e-10      BiCGSTAB, diagonal        0.01     0.37     351   0.00
33,111    123,921   1e-8       direct                    7.9      0.19     –     0.85
33,111    123,921   1e-8       krylov                    2.5      0.63     22    0.32
33,111    123,921   1e-8       BiCGSTAB, diagonal        0.1      3.5      409   0.00
101,707   387,675   1e-8       direct                    73       0.71     –     4.4
101,707   387,675   1e-8       krylov                    15       5.5      43    1.8
========  ========  =========  ========================  =======  =======  ====  ======

The direct method also works where the iteration stalls (ν → 1/2, large time steps, static problems),
so `Auto` takes it whenever the factor fits in memory. Ordering costs 0.4, 2.3 and 9 seconds once.
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
