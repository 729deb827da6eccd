"""PETSc's Krylov methods on the scaled system, with incomplete factorisations."""

from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.linear_solver import CorrectingSolver
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.errors import ConvergenceError
from dacore_dolfinx.petsc import Native, one_thread, petsc, to_mat

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
        self._native = Native()
        with one_thread():
            ksp = self._native.ksp = PETSc.KSP().create(PETSc.COMM_SELF)
            ksp.setType(_PETSC_NAMES[self._kind])
            if not single:
                ksp.setPCSide(PETSc.PC.Side.RIGHT)
            ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            if self._kind == "gmres":
                ksp.setGMRESRestart(restart)
            operator = to_mat(system)
            ksp.setOperators(operator)
            self._native.right, self._native.left = operator.createVecs()
            try:
                if single:
                    _incomplete(ksp.getPC(), "icc", fill)
                elif preconditioner == "ilu":
                    _incomplete(ksp.getPC(), "ilu", fill)
                else:
                    _blocks(ksp.getPC(), system, self._split, fill)
                ksp.setUp()
                ksp.setUpOnBlocks()
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
        ksp, left, right = self._native.ksp, self._native.left, self._native.right
        with one_thread():
            for column in range(residual.shape[1]):
                ksp.setTolerances(rtol=1e-15, atol=0.5 * goal[column], max_it=self._limit)
                left.setArray(self._sign * residual[self._order, column])
                right.set(0.0)
                ksp.solve(left, right)
                self.iterations += int(ksp.getIterationNumber())
                correction[self._order, column] = right.getArray(readonly=True)
        return correction


def _blocks(pc: Any, system: Sparse, inner: int, fill: int) -> None:
    """Precondition by p = −Ŝ⁻¹ r_p, u = Â⁻¹ (r_u − Bᵀ p): Â of A, Ŝ of C + B diag(A)⁻¹ Bᵀ, both incomplete.

    Parameters
    ----------
    pc : PETSc.PC
    system : (n, n) csr_array
        [[A, Bᵀ], [B, −C]] with a unit diagonal of A.
    inner : int
        Rows of A.
    fill : int
    """
    PETSc = petsc()
    lower = csr_array(system[inner:])
    coupling, flow = csr_array(lower[:, :inner]), csr_array(lower[:, inner:])
    schur = csr_array(flow - coupling @ coupling.T)
    schur.sort_indices()
    first = PETSc.IS().createStride(inner, 0, 1, PETSc.COMM_SELF)
    second = PETSc.IS().createStride(system.shape[0] - inner, inner, 1, PETSc.COMM_SELF)
    pc.setType("fieldsplit")
    pc.setFieldSplitType(PETSc.PC.CompositeType.SCHUR)
    pc.setFieldSplitSchurFactType(PETSc.PC.SchurFactType.UPPER)
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
