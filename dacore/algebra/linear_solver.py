"""What dacore's linear solvers share: a scaled system, the true residual checked, earlier solutions used."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.algebra.elimination import canonical
from dacore.algebra.threads import one_blas_thread
from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ConvergenceError, PluginError, ShapeError

Single = NDArray[np.float32]

_LEAST_NEWS = 1e-6  # a direction of which less than this is new would be mostly rounding in single precision
_LARGEST_DIRECTION = 1e30  # of images of size one, well inside the range of single precision
_REMEMBERED_COLUMNS = 3
_ROWS = 20_000
_FEW_COLUMNS = 4  # up to here one product a column is faster than scipy's product of all at once
_LEAST_GAIN = 0.25  # a correction that leaves more than this of a residual is not worth repeating


class CorrectingSolver(LinearSolver):
    """Solves K x = b for one symmetric quasi-definite matrix K by corrections until the true residual is small.

    A method only has to give an approximate solution for a residual, `correct`; it is repeated as
    long as it gains.

    The system is scaled to D K D, where D makes the diagonals of A and of C + B diag(A)⁻¹ Bᵀ
    one, and residuals are measured there: every column satisfies ‖D(b − K x)‖ ≤ tolerance · ‖D b‖.
    Equations in different units then count alike; the plain norm of a displacement–pressure system
    sees the momentum balance only. C may be as small as the pressures are well determined without it.

    A solver remembers the span of its last few solutions and starts from the best point in it, which
    matters in time stepping. That is acceleration only: results meet the tolerance in any order of
    calls, but agree between orders no better than that. A solver is not safe to share between threads.

    Parameters
    ----------
    matrix : (n, n) csr_array
        K = [[A, Bᵀ], [B, −C]] with A and C positive definite, rows in any order.
    definite : (n,) bool array
        True on the rows of A; all True for a positive definite matrix.
    tolerance : float
        Bound on the relative residual.

    Attributes
    ----------
    matrix : (n, n) csr_array
        The scaled system D K D.
    memory : int
        How many solutions are remembered, for each of up to three columns that are solved together.

    Raises
    ------
    ShapeError
        If the shapes, the tolerance, or the signs on the diagonal are not as stated.
    """

    memory: ClassVar[int] = 16

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        n = matrix.shape[0]
        if n == 0 or matrix.shape != (n, n) or definite.shape != (n,):
            raise ShapeError(
                f"linear system: got a matrix {matrix.shape} and flags {definite.shape}, expected (n, n) and (n,)"
            )
        if not 0.0 < tolerance < 1.0:
            raise ShapeError(f"linear system: got the tolerance {tolerance}, expected a number between 0 and 1")
        matrix = canonical(matrix)
        self._scale: Array = scales(matrix, definite)
        data = matrix.data.astype(np.float64)
        for begin in range(0, n, _ROWS):  # in parts: the factors of all entries would be as large as the matrix
            starts = matrix.indptr[begin : begin + _ROWS + 1]
            part = slice(int(starts[0]), int(starts[-1]))
            data[part] *= self._scale[matrix.indices[part]]
            data[part] *= np.repeat(self._scale[begin : begin + _ROWS], np.diff(starts))
        if not np.isfinite(data).all():
            raise ShapeError("linear system: the matrix holds NaN, infinite or hopelessly scaled entries")
        self.matrix: Sparse = csr_array((data, matrix.indices, matrix.indptr), shape=(n, n))
        self.tolerance = tolerance
        # Pairs (direction, image) with orthonormal images, one a row; a full memory forgets the oldest. Single
        # precision is enough for where to start, and half the memory and time.
        self._remembered = 0
        self._directions: Single = np.zeros((0, n), dtype=np.float32)
        self._images: Single = np.zeros((0, n), dtype=np.float32)

    @abstractmethod
    def correct(self, residual: Array, goal: Array) -> Array:
        """Approximate solution (n, k) of the scaled system for a residual (n, k).

        A method that iterates stops when the norm of each column's residual is below `goal` (k,).
        """

    def strengthen(self) -> bool:
        """Turn to a more accurate method; False if there is none."""
        return False

    def solve(self, rhs: Array, guess: Array | None = None) -> Array:
        """Solve for every column of `rhs` (n,) or (n, k), from `guess` of the same shape."""
        n = len(self._scale)
        if rhs.ndim not in (1, 2) or rhs.shape[0] != n or (guess is not None and guess.shape != rhs.shape):
            given = "none" if guess is None else guess.shape
            raise ShapeError(
                f"linear system: got a right-hand side {rhs.shape} and a guess {given}, expected ({n},) or ({n}, k)"
            )
        scale = self._scale[:, None]
        load = np.atleast_2d(rhs.T).T * scale
        size = np.linalg.norm(load, axis=0)
        solution = np.zeros_like(load) if guess is None else np.atleast_2d(guess.T).T / scale
        if not (np.isfinite(size).all() and np.isfinite(solution).all()):
            raise ShapeError("linear system: the right-hand side or the guess holds NaN or infinite values")
        solution[:, size == 0.0] = 0.0
        with one_blas_thread():
            solution = self._improve(load, solution, self.tolerance * size)
        return np.asarray((solution * scale).reshape(rhs.shape))

    def _improve(self, load: Array, solution: Array, goal: Array) -> Array:
        """Correct a solution until the residual meets the goal."""
        residual = load - product(self.matrix, solution) if solution.any() else load.copy()
        reached = np.linalg.norm(residual, axis=0)
        self._make_room(load.shape[1])
        self._recall(load, solution, residual, reached, goal)
        remained = np.ones(len(reached))
        while len(open_ := np.flatnonzero(~(reached <= goal))):
            correction = np.asarray(self.correct(residual[:, open_], goal[open_]))
            if correction.shape != (len(load), len(open_)):
                wanted = (len(load), len(open_))
                raise PluginError(
                    f"{self.name}: correct gave shape {correction.shape}, expected {wanted} as the residual"
                )
            trial = solution[:, open_] + correction
            left = load[:, open_] - product(self.matrix, trial)
            norms = np.linalg.norm(left, axis=0)
            stuck = ~((norms <= goal[open_]) | (norms < _LEAST_GAIN * reached[open_]))
            better = norms < reached[open_]  # False for NaN
            remained[open_] = norms / reached[open_]
            chosen = open_[better]
            solution[:, chosen], residual[:, chosen] = trial[:, better], left[:, better]
            reached[chosen] = norms[better]
            if stuck.any() and not self.strengthen():
                break
        if not (reached <= goal).all():  # NaN counts as missed
            worst = int(np.argmax(reached - goal))
            size = goal[worst] / self.tolerance
            raise ConvergenceError(
                f"{self.name}: the relative residual of column {worst} is {reached[worst] / size:.1e}, wanted "
                f"{self.tolerance:.1e}, and the last correction left {remained[worst]:.1g} of it, where less than "
                f"{_LEAST_GAIN:g} is worth another; {self.advice()}"
            )
        for column in range(load.shape[1]):
            self._remember(solution[:, column], load[:, column], residual[:, column])
        return solution

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return "check that the matrix is symmetric and nonsingular, or ask for a larger tolerance"

    def _make_room(self, columns: int) -> None:
        """Let the memory hold the solutions of so many columns a solve."""
        rows, (have, n) = self.memory * min(columns, _REMEMBERED_COLUMNS), self._images.shape
        if rows > have and self._remembered <= have:  # a memory in which the oldest was replaced stays as it is
            # Pages of zeros that are never written take no memory.
            for name in ("_directions", "_images"):
                grown = np.zeros((rows, n), dtype=np.float32)
                grown[: self._remembered] = getattr(self, name)[: self._remembered]
                setattr(self, name, grown)

    def _recall(self, load: Array, solution: Array, residual: Array, reached: Array, goal: Array) -> None:
        """Move to the point of least residual in the span of the remembered solutions, in place."""
        known = slice(0, min(self._remembered, len(self._images)))
        open_ = np.flatnonzero(reached > goal)
        if not self._remembered or not len(open_):
            return
        # Single precision has a narrow range: look at residuals of size one.
        sizes = reached[open_]
        weights = self._images[known] @ (residual[:, open_] / sizes).astype(np.float32)
        trial = solution[:, open_] + sizes * (self._directions[known].T @ weights)
        left = load[:, open_] - product(self.matrix, trial)
        norms = np.linalg.norm(left, axis=0)
        better = norms < sizes  # False for NaN
        moved = open_[better]
        solution[:, moved], residual[:, moved], reached[moved] = trial[:, better], left[:, better], norms[better]

    def _remember(self, solution: Array, load: Array, residual: Array) -> None:
        """Add a solution and its image to the remembered span, in place of the oldest where it is full."""
        image = load - residual
        size = np.linalg.norm(image)
        if not size or not np.linalg.norm(solution) < _LARGEST_DIRECTION * size:
            return
        direction, image = (solution / size).astype(np.float32), (image / size).astype(np.float32)
        rows = len(self._images)
        place = self._remembered % rows
        known = np.arange(min(self._remembered, rows)) != place
        for _ in range(2):
            weights = np.where(known, self._images[: len(known)] @ image, np.float32(0.0))
            direction -= weights @ self._directions[: len(known)]
            image -= weights @ self._images[: len(known)]
        left = np.linalg.norm(image)
        # Below this the new part of the image is the error of the solver, not a new direction.
        if left > max(10.0 * self.tolerance, _LEAST_NEWS):
            self._directions[place], self._images[place] = direction / left, image / left
            self._remembered += 1


def product(matrix: Sparse, columns: Array) -> Array:
    """Multiply (n, k) columns by a matrix, the fastest way for their number."""
    if columns.shape[1] > _FEW_COLUMNS:
        return np.asarray(matrix @ columns)
    out = np.empty((matrix.shape[0], columns.shape[1]), dtype=np.result_type(matrix.dtype, columns.dtype), order="F")
    for c in range(columns.shape[1]):
        out[:, c] = matrix @ columns[:, c]
    return out


def prepared(
    method: SolverMethod, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None
) -> LinearSolver:
    """Prepare a solver whose every answer is checked, by itself if it is a `CorrectingSolver`, here otherwise.

    Parameters
    ----------
    method : SolverMethod
    matrix, definite, tolerance, analysis
        As `SolverMethod.prepare` takes them.
    """
    solver = method.prepare(matrix, definite, tolerance, analysis)
    return solver if isinstance(solver, CorrectingSolver) else _Checked(solver, matrix, definite, tolerance)


class _Checked(LinearSolver):
    """Another's solver, with the true residual of every solution checked."""

    def __init__(self, solver: LinearSolver, matrix: Sparse, definite: BoolArray, tolerance: float) -> None:
        self._solver, self._matrix, self._tolerance = solver, matrix, tolerance
        self._scale = scales(canonical(matrix), definite)[:, None]

    @property
    def name(self) -> str:
        """The other's."""
        return self._solver.name

    def solve(self, rhs: Array, guess: Array | None = None) -> Array:
        """Solve and check; ConvergenceError if the residual misses the tolerance, PluginError for a wrong shape."""
        solution = np.asarray(self._solver.solve(rhs, guess))
        if solution.shape != rhs.shape:
            raise PluginError(
                f"{self.name}: solve gave shape {solution.shape}, expected {rhs.shape} as the right-hand side"
            )
        load, image = np.atleast_2d(rhs.T).T, np.atleast_2d((self._matrix @ solution).T).T
        left = np.linalg.norm(self._scale * (load - image), axis=0)
        size = np.linalg.norm(self._scale * load, axis=0)
        missed = ~(left <= 2.0 * self._tolerance * size)  # True for NaN
        if missed.any():
            worst = int(
                np.argmax(np.where(missed, np.divide(left, size, out=np.full_like(left, np.inf), where=size > 0), 0))
            )
            raise ConvergenceError(
                f"{self.name}: the relative residual of column {worst} is {left[worst] / size[worst]:.1e}, wanted "
                f"{self._tolerance:.1e}, and the solver did not say so; it is at fault, choose another one"
            )
        return solution


def scales(matrix: Sparse, definite: BoolArray) -> Array:
    """Scale D (n,) of rows and columns, one over the roots of the diagonals of A and C + B diag(A)⁻¹ Bᵀ.

    Parameters
    ----------
    matrix : (n, n) csr_array
        K = [[A, Bᵀ], [B, −C]], rows in any order, no entry twice.
    definite : (n,) bool array
        True on the rows of A.

    Raises
    ------
    ShapeError
        If a row vanishes, or its diagonal has the wrong sign.
    """
    diagonal = np.asarray(matrix.diagonal(), dtype=np.float64)
    wrong = np.where(definite, ~(diagonal > 0.0), ~(diagonal <= 0.0))
    if not wrong.any():
        outer = np.flatnonzero(~definite)
        lower = matrix[outer]
        coupling = definite[lower.indices]
        rows = np.repeat(outer, np.diff(lower.indptr))[coupling]
        # Divide before squaring: the squares of badly scaled entries may overflow.
        shares = lower.data[coupling] / np.sqrt(diagonal[lower.indices[coupling]])
        diagonal = np.abs(diagonal) + np.bincount(rows, shares**2, minlength=len(definite))
        wrong = ~(diagonal > 0.0)
    if wrong.any():
        raise ShapeError(
            f"linear system: {wrong.sum()} of {len(wrong)} rows vanish or have a diagonal of the wrong sign; expected "
            "positive where definite, negative elsewhere: check boundary conditions, parameters and the signs of rows"
        )
    return np.asarray(1.0 / np.sqrt(diagonal))
