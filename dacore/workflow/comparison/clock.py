"""A linear solver whose set-up is timed."""

import time
from typing import Any, final

from dacore.core.arrays import BoolArray, IntArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod


@final
class Clocked(SolverMethod):
    """Another method, with the CPU time of every set-up.

    Parameters
    ----------
    method : SolverMethod

    Attributes
    ----------
    seconds : list of float
        CPU seconds of each call of `prepare`.
    solvers : list of str
        What each of them prepared.
    """

    def __init__(self, method: SolverMethod) -> None:
        self.method = method
        self.seconds: list[float] = []
        self.solvers: list[str] = []

    def analyse(self, matrix: Sparse, definite: BoolArray, nodes: IntArray) -> Any:
        """Pass on."""
        return self.method.analyse(matrix, definite, nodes)

    def prepare(self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None) -> LinearSolver:
        """Pass on and measure."""
        start = time.process_time()
        solver = self.method.prepare(matrix, definite, tolerance, analysis)
        self.seconds.append(time.process_time() - start)
        self.solvers.append(solver.name)
        return solver
