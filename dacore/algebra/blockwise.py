"""The iterative solver: GMRES with a block preconditioner made from diagonal, polynomial and pressure parts."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.algebra.elimination import Ordering
from dacore.algebra.factorisation import Factorisation
from dacore.algebra.krylov import conjugate_gradients, flexible_gmres
from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, Sparse

_CYCLE = 50  # GMRES iterations before a restart: bounds the memory to a hundred vectors a column
_CONJUGATE = 2000
_LANCZOS = 20

Single = NDArray[np.float32]


class BlockSolver(CorrectingSolver):
    """Flexible GMRES for [[A, Bᵀ], [B, −C]]; conjugate gradients where there is no C.

    The preconditioner is block triangular,  p = −Ŝ⁻¹ r_p,  u = Â⁻¹ (r_u − Bᵀ p):

    - Â⁻¹ is a Chebyshev polynomial in A scaled to unit diagonal (Golub and Varga, Numer. Math. 3,
      1961). In a time step inertia keeps A well conditioned and two or three terms suffice.
    - Ŝ = C + B diag(A)⁻¹ Bᵀ is assembled and factored once: it is scalar, so its factor is tiny beside
      that of the whole system.

    Both are kept in single precision.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    """

    memory = 40  # each iteration saved pays for many remembered vectors

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        super().__init__(matrix, definite, tolerance)
        self.iterations = 0
        self._inner = np.flatnonzero(definite)
        self._outer = np.flatnonzero(~definite)
        if not len(self._outer):
            return
        upper, lower = self.matrix[self._inner], self.matrix[self._outer]
        coupling, flow = csr_array(lower[:, self._inner]), csr_array(-lower[:, self._outer])
        block = csr_array(upper[:, self._inner])
        low, self._high = _extremes(block) if len(self._inner) else (0.5, 1.0)
        # A polynomial of degree d damps a range of ratio about d²·8 well; below it GMRES does the work.
        self._terms = 2 if self._high < 60.0 * low else 4
        self._low = max(low, self._high / (10.0 * self._terms**2))
        schur = csr_array(flow + coupling @ coupling.T)  # the scaled A has a unit diagonal
        schur.sum_duplicates()
        ordering = Ordering.of(schur, np.ones(len(self._outer), dtype=np.bool_))
        self._schur = Factorisation(ordering, ordering.scatter, schur.data, np.float32)
        self._block = block.astype(np.float32)
        self._coupling_transpose = csr_array(coupling.T).astype(np.float32)

    @property
    def name(self) -> str:
        """The method and the iterations it took so far."""
        kind = "block-preconditioned GMRES" if len(self._outer) else "conjugate gradients"
        return f"{kind} ({self.iterations} iterations in all)"

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return "use the direct method, a smaller time step or a larger tolerance"

    def correct(self, residual: Array, goal: Array) -> Array:
        """Iterate until the residual is below `goal`."""
        if len(self._outer):
            correction, used = flexible_gmres(self._product, self._precondition, residual, 0.5 * goal, _CYCLE)
        else:
            correction, used = conjugate_gradients(self._product, residual, 0.5 * goal, _CONJUGATE)
        self.iterations += used
        return correction

    def _product(self, vectors: Array) -> Array:
        return np.asarray(self.matrix @ vectors)

    def _precondition(self, vectors: Array) -> Array:
        pressure = -self._schur.solve(vectors[self._outer])
        load = vectors[self._inner].astype(np.float32) - self._coupling_transpose @ pressure.astype(np.float32)
        result = np.empty_like(vectors)
        result[self._outer] = pressure
        result[self._inner] = self._chebyshev(load)
        return result

    def _chebyshev(self, load: Single) -> Single:
        """Chebyshev iteration for A x = load from zero."""
        middle, radius = np.float32((self._high + self._low) / 2.0), np.float32((self._high - self._low) / 2.0)
        ratio = middle / radius
        step = load / middle
        solution, left, previous = step.copy(), load, 1.0 / ratio
        for _ in range(1, self._terms):
            left = left - self._block @ step
            factor = np.float32(1.0) / (2.0 * ratio - previous)
            step = factor * previous * step + (2.0 * factor / radius) * left
            solution += step
            previous = factor
        return solution


def _extremes(matrix: Sparse) -> tuple[float, float]:
    """Estimates of the least and largest eigenvalue of a positive definite matrix, by Lanczos."""
    n = matrix.shape[0]
    steps = min(_LANCZOS, n)
    basis = np.zeros((steps + 1, n))
    start = np.cos(np.arange(n, dtype=np.float64) ** 2)  # fixed, and like no eigenvector
    basis[0] = start / np.linalg.norm(start)
    for j in range(steps):
        image = matrix @ basis[j]
        for _ in range(2):
            image = image - (basis[: j + 1] @ image) @ basis[: j + 1]
        size = np.linalg.norm(image)
        if size < 1e-12:
            steps = j + 1
            break
        basis[j + 1] = image / size
    projected = basis[:steps] @ (matrix @ basis[:steps].T)
    values = np.linalg.eigvalsh(0.5 * (projected + projected.T))
    # Lanczos sees the largest from below; for a polynomial it must not be underestimated.
    return float(max(values[0], 1e-6 * values[-1])), 1.05 * float(values[-1])
