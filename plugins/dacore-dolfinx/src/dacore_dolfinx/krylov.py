"""PETSc's Krylov methods on the scaled system, with incomplete factorisations."""

from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.errors import ConvergenceError
from dacore_dolfinx.petsc import one_thread, petsc, to_mat

Method = Literal["gmres", "bicgstab"]
Preconditioner = Literal["blocks", "ilu"]

_PETSC_NAMES = {"gmres": "gmres", "bicgstab": "bcgs", "conjugate gradients": "cg"}


class KrylovSolver(CorrectingSolver):
    """GMRES or BiCGSTAB for [[A, Bᵀ], [B, −C]]; conjugate gradients where one of A and C is all there is.

    PETSc measures the preconditioned residual by default. Here it preconditions from the right and
    measures the residual of the scaled system, and `CorrectingSolver` computes that anew at the end.

    Parameters
    ----------
    matrix, definite, tolerance
        As for `CorrectingSolver`.
    method : {"gmres", "bicgstab"}
    preconditioner : {"blocks", "ilu"}
    fill : int
        Levels of fill of the incomplete factorisations.
    restart : int
        Iterations of GMRES before a restart.
    iterations : int
        At most, for one correction.

    Raises
    ------
    ConvergenceError
        If an incomplete factorisation breaks down.
    """

    memory = 40  # each iteration saved pays for many remembered vectors

    def __init__(
        self,
        matrix: Sparse,
        definite: BoolArray,
        tolerance: float,
        method: Method,
        preconditioner: Preconditioner,
        fill: int,
        restart: int,
        iterations: int,
    ) -> None:
        super().__init__(matrix, definite, tolerance)
        PETSc = petsc()
        self.iterations = 0
        self._limit = iterations
        # Rows of A first: the splits of PETSc are then two ranges, and incomplete pivots stay away from zero.
        self._order: IntArray = np.argsort(~definite, kind="stable")
        self._split = int(definite.sum())
        single = self._split in (0, len(definite))
        self._sign = -1.0 if self._split == 0 else 1.0
        self._kind = "conjugate gradients" if single else method
        system = csr_array(self.matrix[self._order][:, self._order])
        if self._sign < 0.0:
            system.data *= -1.0
        with one_thread():
            self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
            self._ksp.setType(_PETSC_NAMES[self._kind])
            if not single:
                self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
            self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            if self._kind == "gmres":
                self._ksp.setGMRESRestart(restart)
            operator = to_mat(system)
            self._ksp.setOperators(operator)
            self._right, self._left = operator.createVecs()
            try:
                if single:
                    _incomplete(self._ksp.getPC(), "icc", fill)
                elif preconditioner == "ilu":
                    _incomplete(self._ksp.getPC(), "ilu", fill)
                else:
                    self._precondition_blocks(system, fill)
                self._ksp.setUp()
                self._ksp.setUpOnBlocks()
            except PETSc.Error as error:
                raise ConvergenceError(
                    f"{self.name}: the incomplete factorisation broke down (PETSc error {error.ierr}); {self.advice()}"
                ) from error

    @property
    def name(self) -> str:
        """The method and the iterations it took so far."""
        return f"PETSc's {self._kind} ({self.iterations} iterations in all)"

    def advice(self) -> str:
        """What to do when the tolerance is not reached."""
        return "use petsc_mumps or the direct method, more fill, a smaller time step or a larger tolerance"

    def correct(self, residual: Array, goal: Array) -> Array:
        """Iterate, column by column, until the residual is below `goal`."""
        correction = np.empty_like(residual)
        with one_thread():
            for column in range(residual.shape[1]):
                self._ksp.setTolerances(rtol=1e-15, atol=0.5 * goal[column], max_it=self._limit)
                self._left.setArray(self._sign * residual[self._order, column])
                self._right.set(0.0)
                self._ksp.solve(self._left, self._right)
                self.iterations += int(self._ksp.getIterationNumber())
                correction[self._order, column] = self._right.getArray(readonly=True)
        return correction

    def _precondition_blocks(self, system: Sparse, fill: int) -> None:
        """Precondition by p = −Ŝ⁻¹ r_p, u = Â⁻¹ (r_u − Bᵀ p): Â of A, Ŝ of C + B diag(A)⁻¹ Bᵀ, both incomplete."""
        PETSc = petsc()
        inner, n = self._split, system.shape[0]
        lower = csr_array(system[inner:])
        coupling, flow = csr_array(lower[:, :inner]), csr_array(lower[:, inner:])
        schur = csr_array(flow - coupling @ coupling.T)  # the scaled A has a unit diagonal
        schur.sort_indices()
        pc = self._ksp.getPC()
        pc.setType("fieldsplit")
        pc.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
        pc.setFieldSplitSchurFactType(PETSc.PC.SchurFactType.UPPER)
        first = PETSc.IS().createStride(inner, 0, 1, PETSc.COMM_SELF)
        second = PETSc.IS().createStride(n - inner, inner, 1, PETSc.COMM_SELF)
        pc.setFieldSplitIS(("u", first), ("p", second))
        pc.setFieldSplitSchurPreType(PETSc.PC.SchurPreType.USER, to_mat(schur))
        pc.setUp()
        displacements, pressures = pc.getFieldSplitSchurGetSubKSP()[:2]
        for ksp in (displacements, pressures):
            ksp.setType("preonly")
        _incomplete(displacements.getPC(), "icc", fill)
        _incomplete(pressures.getPC(), "ilu", fill)


def _incomplete(pc: Any, kind: Literal["icc", "ilu"], fill: int) -> None:
    """Incomplete Cholesky or LU factorisation with levels of fill."""
    pc.setType(kind)
    pc.setFactorLevels(fill)
