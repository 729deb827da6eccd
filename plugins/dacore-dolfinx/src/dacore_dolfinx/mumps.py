"""The multifrontal solver MUMPS, through PETSc."""

import numpy as np

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.errors import ConvergenceError
from dacore_dolfinx.petsc import one_thread, petsc, to_mat

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
        with one_thread():
            operator = to_mat(self.matrix)
            operator.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            self._right, self._left = operator.createVecs()
            self._pc = PETSc.PC().create(PETSc.COMM_SELF)
            self._pc.setOperators(operator)
            self._pc.setType("cholesky")
            self._pc.setFactorSolverType("mumps")
            self._pc.setFactorSetUpSolverType()
            factor = self._pc.getFactorMatrix()
            factor.setMumpsCntl(1, pivot_threshold)
            factor.setMumpsIcntl(14, extra_memory)
            factor.setMumpsIcntl(4, 0)  # no messages
            try:
                self._pc.setUp()
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
        with one_thread():
            for column in range(residual.shape[1]):
                self._left.setArray(residual[:, column])
                self._pc.apply(self._left, self._right)
                correction[:, column] = self._right.getArray(readonly=True)
        return correction
