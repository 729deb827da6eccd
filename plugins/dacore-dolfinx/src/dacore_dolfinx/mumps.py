"""The multifrontal solver MUMPS, through PETSc."""

import numpy as np

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.errors import ConvergenceError
from dacore_dolfinx.petsc import Native, one_thread, petsc, to_mat

_NEGATIVE_PIVOTS = 12  # places in MUMPS's INFOG
_ERROR, _DETAIL = 1, 2
_OUT_OF_MEMORY = (-7, -8, -9, -11, -13, -14, -17, -18, -19, -20)


class MumpsSolver(CorrectingSolver):
    """LDLᵀ factorisation in double precision with threshold pivoting.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    pivot_threshold : float
        Pivots may be smaller than their column by this factor.
    extra_memory : int
        Work space beyond MUMPS's estimate, in per cent.

    Raises
    ------
    ConvergenceError
        If the factorisation fails, or finds another number of negative pivots than −C has rows.
    """

    def __init__(
        self, matrix: Sparse, definite: BoolArray, tolerance: float, pivot_threshold: float, extra_memory: int
    ) -> None:
        super().__init__(matrix, definite, tolerance)
        PETSc = petsc()
        self._native = Native()
        with one_thread():
            operator = to_mat(self.matrix)
            operator.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            self._native.right, self._native.left = operator.createVecs()
            pc = self._native.pc = PETSc.PC().create(PETSc.COMM_SELF)
            pc.setOperators(operator)
            pc.setType("cholesky")
            pc.setFactorSolverType("mumps")
            pc.setFactorSetUpSolverType()
            factor = pc.getFactorMatrix()
            factor.setMumpsCntl(1, pivot_threshold)
            factor.setMumpsIcntl(14, extra_memory)
            factor.setMumpsIcntl(4, 0)  # no messages
            try:
                pc.setUp()
            except PETSc.Error as error:
                raise ConvergenceError(
                    f"{self.name}: the factorisation failed (PETSc error {error.ierr}); {self.advice()}"
                ) from error
            status, detail = factor.getMumpsInfog(_ERROR), factor.getMumpsInfog(_DETAIL)
            if status < 0:
                what = "raise extra_memory" if status in _OUT_OF_MEMORY else self.advice()
                raise ConvergenceError(
                    f"{self.name}: the factorisation failed (MUMPS error {status}, {detail}); {what}"
                )
            negative, expected = factor.getMumpsInfog(_NEGATIVE_PIVOTS), int((~definite).sum())
            if negative != expected:
                raise ConvergenceError(
                    f"{self.name}: the matrix is not quasi-definite: {negative} negative pivots, expected {expected}; "
                    "check the parameters and the signs of rows"
                )

    @property
    def name(self) -> str:
        """The method."""
        return "MUMPS"

    def correct(self, residual: Array, goal: Array) -> Array:
        """Solve with the factor."""
        correction = np.empty_like(residual)
        pc, left, right = self._native.pc, self._native.left, self._native.right
        with one_thread():
            for column in range(residual.shape[1]):
                left.setArray(residual[:, column])
                pc.apply(left, right)
                correction[:, column] = right.getArray(readonly=True)
        return correction
