from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import minres, splu

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ShapeError


class Minres(CorrectingSolver):
    """Minimal residuals for each column, and a factorisation where they stall."""

    name = "minimal residuals"

    def __init__(self, matrix, definite, tolerance, iterations):
        super().__init__(matrix, definite, tolerance)
        self.iterations, self.factor = iterations, None

    def correct(self, residual, goal):
        if self.factor is not None:
            return self.factor.solve(residual)
        out = np.empty_like(residual)
        for k, (column, wanted) in enumerate(zip(residual.T, goal, strict=True)):
            size = np.linalg.norm(column)
            out[:, k] = minres(self.matrix, column / size, rtol=0.1 * wanted / size, maxiter=self.iterations)[0] * size
        return out

    def strengthen(self):
        if self.factor is not None:
            return False
        try:
            self.factor = splu(self.matrix.tocsc())
        except RuntimeError:  # singular
            return False
        return True

    def advice(self):
        return "ask for a larger tolerance, or take the solver direct"


@dataclass(frozen=True)
class MinimalResiduals(SolverMethod):
    """Settings: the fields are keys of a scene's [solver] table."""

    iterations: int = 200

    def __post_init__(self):
        if self.iterations < 1:
            raise ShapeError(f"minimal residuals: got {self.iterations} iterations, expected at least 1")

    def prepare(self, matrix, definite, tolerance, analysis=None) -> LinearSolver:
        return Minres(matrix, definite, tolerance, self.iterations)
