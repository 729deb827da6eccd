"""The iterative solver: GMRES with a block triangle of Gauss–Seidel sweeps."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.algebra.krylov import conjugate_gradients, gmres
from dacore.algebra.linear_solver import CorrectingSolver
from dacore.algebra.triangular import GaussSeidel
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse

_CYCLE = 100  # GMRES iterations before a restart: bounds the memory to as many vectors in single precision
_CONJUGATE = 2000

Single = NDArray[np.float32]


class BlockSolver(CorrectingSolver):
    """GMRES for [[A, Bᵀ], [B, −C]]; conjugate gradients where there is no C.

    The preconditioner is block triangular,  p = −Ŝ⁻¹ r_p,  u = Â⁻¹ (r_u − Bᵀ p). Â⁻¹ and Ŝ⁻¹ are a symmetric
    Gauss–Seidel sweep on A and on C + B diag(A)⁻¹ Bᵀ, kept in single precision. In a time step inertia keeps both
    well conditioned. Every column has a Krylov space of its own and stops by itself.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.

    Attributes
    ----------
    iterations : int
        Made so far, over all columns.
    """

    memory = 40  # each iteration saved pays for many remembered vectors

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        super().__init__(matrix, definite, tolerance)
        self.iterations = 0
        self._inner, self._outer = _rows(definite), _rows(~definite)
        self._sweep: GaussSeidel | None = None
        if not definite.any():
            self._sweep = GaussSeidel(-self.matrix)
        elif definite.all():
            self._sweep = GaussSeidel(self.matrix)
        else:
            upper = _part(self.matrix, self._inner)
            leading = isinstance(self._inner, slice) and self._inner.start == 0
            self._blocks = GaussSeidel(upper if leading else csr_array(upper[:, self._inner]))
            del upper
            lower = _part(self.matrix, self._outer)
            coupling, flow = csr_array(lower[:, self._inner]), csr_array(lower[:, self._outer])
            # The scaled A has a unit diagonal.
            self._schur = GaussSeidel(csr_array(coupling @ coupling.T - flow))
            self._coupling_transpose = csr_array(coupling.T, dtype=np.float32)
            self._coupling = self._coupling_transpose.T  # the same arrays
            self._flow = flow.astype(np.float32)

    @property
    def name(self) -> str:
        """The method and the iterations it took so far."""
        kind = "block-preconditioned GMRES" if self._sweep is None else "conjugate gradients"
        return f"{kind} ({self.iterations} iterations in all)"

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return "use the direct method, a smaller time step or a larger tolerance"

    def release(self) -> None:
        """Free the preconditioner; nothing can be solved any more."""
        for name in ("_sweep", "_blocks", "_schur", "_coupling", "_coupling_transpose", "_flow"):
            self.__dict__.pop(name, None)

    def correct(self, residual: Array, goal: Array) -> Array:
        """Iterate on each column until its residual is below `goal`."""
        correction = np.empty_like(residual)
        for c in range(residual.shape[1]):
            # Half: within a run the residual is known by recurrence only.
            column, limit = np.ascontiguousarray(residual[:, c]), 0.5 * float(goal[c])
            if self._sweep is None:
                correction[:, c], used = gmres(self._operator, self._precondition, column, limit, _CYCLE)
            else:
                correction[:, c], used = self._conjugate(self._sweep, column, limit)
            self.iterations += used
        return correction

    def _conjugate(self, sweep: GaussSeidel, residual: Array, goal: float) -> tuple[Array, int]:
        sign = 1.0 if self.matrix.diagonal()[0] > 0 else -1.0
        correction, used = conjugate_gradients(lambda x: sign * (self.matrix @ x), sweep, residual, goal, _CONJUGATE)
        return sign * correction, used

    def _precondition(self, vector: Single) -> Single:
        result = np.empty_like(vector)
        pressure = self._schur(vector[self._outer])
        result[self._outer] = -pressure
        result[self._inner] = self._blocks(vector[self._inner] + self._coupling_transpose @ pressure)
        return result

    def _operator(self, vector: Single) -> Single:
        """Precondition and multiply by the matrix, with what the first knows of the second."""
        image = np.empty_like(vector)
        pressure = self._schur(vector[self._outer])
        push = self._coupling_transpose @ pressure
        displacement, product = self._blocks.with_image(vector[self._inner] + push)
        image[self._inner] = product - push
        image[self._outer] = self._coupling @ displacement - self._flow @ pressure
        return image


def _rows(chosen: BoolArray) -> IntArray | slice:
    """Return the chosen rows, as a slice where they stand together: that needs no copies."""
    rows = np.flatnonzero(chosen)
    together = len(rows) and rows[-1] - rows[0] + 1 == len(rows)
    return slice(int(rows[0]), int(rows[-1]) + 1) if together else rows


def _part(matrix: Sparse, rows: IntArray | slice) -> Sparse:
    """Return some rows of a matrix; without a copy of values and indices where they stand together."""
    if not isinstance(rows, slice):
        return matrix[rows]
    starts = matrix.indptr[rows.start : rows.stop + 1]
    entries = slice(int(starts[0]), int(starts[-1]))
    shape = (rows.stop - rows.start, matrix.shape[1])
    return csr_array((matrix.data[entries], matrix.indices[entries], starts - starts[0]), shape=shape)
