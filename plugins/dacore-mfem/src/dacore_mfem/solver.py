"""MFEM's Krylov solvers on a scaled quasi-definite system."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.errors import ConvergenceError, ShapeError
from dacore_mfem.krylov import MfemKrylov
from dacore_mfem.library import mfem, quiet, to_native

_CLASSES = {"bicgstab": "BiCGSTABSolver", "gmres": "FGMRESSolver", "minres": "MINRESSolver", "cg": "CGSolver"}
_TITLES = {"bicgstab": "BiCGSTAB", "gmres": "GMRES", "minres": "MINRES", "cg": "conjugate gradients"}
# No run gains more than this: rounding has its part in what comes after, and the base class runs again.
_MOST_GAIN = 1e-10
# These stop by a norm that the preconditioner defines.
_OWN_NORM = ("minres", "cg")


class MfemSolver(CorrectingSolver):
    """A Krylov solver of MFEM for [[A, Bᵀ], [B, −C]].

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    method : MfemKrylov

    Attributes
    ----------
    iterations : int
        Made so far.
    """

    memory = 40  # each iteration saved pays for many remembered vectors

    def __init__(self, matrix: Sparse, definite: BoolArray, tolerance: float, method: MfemKrylov) -> None:
        super().__init__(matrix, definite, tolerance)
        if method.iteration == "cg" and not definite.all():
            raise ShapeError(
                f"mfem_krylov: {(~definite).sum()} of {len(definite)} rows are not of a positive definite block, which "
                "conjugate gradients need; use bicgstab, gmres or minres"
            )
        self.iterations = 0
        self._method = method
        # Gauss–Seidel converges if the pressures come last.
        self._order = np.argsort(~definite, kind="stable")
        ordered = self.matrix[self._order][:, self._order]
        self._native = to_native(ordered)
        # MFEM's objects point to each other without owning: all of them live as long as this one.
        self._preconditioner, self._parts = _preconditioner(method, self._native, ordered, int(definite.sum()))
        self._solver = getattr(mfem, _CLASSES[method.iteration])()
        self._solver.SetPrintLevel(-1)
        self._solver.SetAbsTol(0.0)
        self._solver.SetMaxIter(method.max_iterations)
        if method.iteration == "gmres":
            self._solver.SetKDim(method.restart)
        # In this order: setting the operator later would make the preconditioner anew.
        self._solver.SetOperator(self._native)
        if self._preconditioner is not None:
            self._solver.SetPreconditioner(self._preconditioner)

    @property
    def name(self) -> str:
        """The method and the iterations it took so far."""
        how = self._method.preconditioner.replace("_", " ")
        return f"MFEM's {_TITLES[self._method.iteration]} with {how} ({self.iterations} iterations in all)"

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return "use the direct method, more iterations, a smaller time step or a larger tolerance"

    def correct(self, residual: Array, goal: Array) -> Array:
        """Iterate on each column from zero until its residual is below `goal`."""
        correction = np.empty_like(residual)
        sizes = np.linalg.norm(residual, axis=0)
        for column, (size, limit) in enumerate(zip(sizes.tolist(), goal.tolist(), strict=True)):
            # Half: the residual is known by recurrence only; a fifth: in another norm besides.
            safety = 0.2 if self._method.iteration in _OWN_NORM else 0.5
            self._solver.SetRelTol(max(safety * limit / size, _MOST_GAIN))
            load, solution = mfem.Vector(residual[self._order, column]), mfem.Vector(len(residual))
            solution.Assign(0.0)
            try:
                with quiet():
                    self._solver.Mult(load, solution)
            except RuntimeError as error:
                raise ConvergenceError(
                    f"{self.name}: broke down ({_reason(error)}); use the direct method or check that the matrix is as "
                    "described"
                ) from error
            self.iterations += self._solver.GetNumIterations()
            correction[self._order, column] = solution.GetDataArray()
        return correction


def _preconditioner(method: MfemKrylov, native: Any, matrix: Sparse, n_definite: int) -> tuple[Any, tuple[Any, ...]]:
    """Preconditioner of a matrix with the rows of A first, None for none, and what it points to."""
    if method.preconditioner == "jacobi":
        return None, ()
    if method.preconditioner == "gauss_seidel":
        return mfem.GSSmoother(native, 0, method.sweeps), ()
    if method.preconditioner == "ilu":
        return mfem.BlockILU(native, 1, mfem.BlockILU.Reordering_NONE), ()
    n, k = matrix.shape[0], n_definite
    upper, lower = matrix[:k], matrix[k:]
    coupling = csr_array(lower[:, :k])
    # diag(A) is one. C + B Bᵀ stands for the Schur complement, and is positive definite.
    schur = csr_array(coupling @ coupling.T - lower[:, k:])
    triangle = method.iteration != "minres"
    blocks = [csr_array(upper[:, :k]), -schur if triangle else schur]
    parts: list[Any] = [mfem.intArray([0, k, n])]
    smoothers: list[Any] = []
    for block in blocks:
        block.sort_indices()
        parts.append(to_native(block))
        smoothers.append(mfem.GSSmoother(parts[-1], 0, method.sweeps))
    if k in (0, n):
        return smoothers[0 if k else 1], (*parts, *smoothers)
    whole = (mfem.BlockLowerTriangularPreconditioner if triangle else mfem.BlockDiagonalPreconditioner)(parts[0])
    for index, smoother in enumerate(smoothers):
        whole.SetDiagonalBlock(index, smoother)
    if triangle:
        parts.append(to_native(coupling))
        whole.SetBlock(1, 0, parts[-1])
    return whole, (*parts, *smoothers)


def _reason(error: RuntimeError) -> str:
    """MFEM's own words, on one line."""
    lines = [line.strip(" ->.") for line in str(error).splitlines()]
    told = [line.partition("ErrorException): ")[2] or line for line in lines if line]
    return "; ".join(told[:2])
