"""Linear solvers of PETSc, declared through the plugin door; PETSc is imported where a system is first prepared.

CPU seconds of one thread over a cycle of 40 time steps of poroelasticity on the brain's meshes, mid-range
parameters, the ordering of `direct` found beforehand (0.4 and 3 s), memory beyond the matrix, on a busy machine:

======  ========  =========  ================================  =======  =======  ====  ======
nodes   unknowns  tolerance  method                            set-up   a step   its   GiB
======  ========  =========  ================================  =======  =======  ====  ======
5,147   18,342    1e-10      direct                            0.31     0.037    –     0.05
5,147   18,342    1e-10      krylov                            0.33     0.068    18    0.03
5,147   18,342    1e-10      petsc_krylov                      0.10     0.027    15    0.03
5,147   18,342    1e-10      petsc_krylov, bicgstab with ilu   0.10     0.047    14    0.03
5,147   18,342    1e-10      petsc_mumps                       0.43     0.016    –     0.09
33,247  124,207   1e-8       direct                            8.8      0.24     –     0.86
33,247  124,207   1e-8       krylov                            2.9      0.77     22    0.38
33,247  124,207   1e-8       petsc_krylov                      0.54     0.24     16    0.30
33,247  124,207   1e-8       petsc_krylov, bicgstab with ilu   0.51     0.36     13    0.30
33,247  124,207   1e-8       petsc_mumps                       13.0     0.25     –     1.3
======  ========  =========  ================================  =======  =======  ====  ======

Tried at 33,247 nodes and left out because a step costs more: SOR or a polynomial for the displacements (twice,
three times), algebraic multigrid for the pressures (seven times), BLR compression in MUMPS (twice, and no memory
saved at this size). One level of fill in both blocks costs twice the time for a fifth fewer iterations.
"""

from dataclasses import dataclass
from typing import Any

from dacore.core.arrays import BoolArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ShapeError
from dacore_dolfinx.krylov import KrylovSolver, Method, Preconditioner
from dacore_dolfinx.mumps import MumpsSolver


@dataclass(frozen=True)
class PetscKrylov(SolverMethod):
    """A Krylov method of PETSc with incomplete factorisations; nothing is shared between parameter samples.

    Parameters
    ----------
    method : {"gmres", "bicgstab"}
        For a system that is positive definite as a whole it is conjugate gradients instead.
    preconditioner : {"blocks", "ilu"}
        "blocks" is block triangular: incomplete Cholesky of the displacements, incomplete LU of the pressures'
        Schur complement C + B diag(A)⁻¹ Bᵀ. "ilu" factors the whole matrix at once.
    fill : int
        Levels of fill of the incomplete factorisations, 0 to 10. More memory for fewer iterations.
    restart : int
        Iterations of GMRES before a restart; as many vectors are kept.
    iterations : int
        At most, for one correction of the solution.

    Raises
    ------
    ShapeError
        If a setting is out of range.
    """

    method: Method = "gmres"
    preconditioner: Preconditioner = "blocks"
    fill: int = 0
    restart: int = 50
    iterations: int = 1000

    def __post_init__(self) -> None:
        _one_of("method", self.method, ("gmres", "bicgstab"))
        _one_of("preconditioner", self.preconditioner, ("blocks", "ilu"))
        _whole("fill", self.fill, 0, 10)
        _whole("restart", self.restart, 1, 10_000)
        _whole("iterations", self.iterations, 1, 1_000_000)

    def prepare(self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None) -> LinearSolver:
        """Make the preconditioner."""
        return KrylovSolver(
            matrix, definite, tolerance, self.method, self.preconditioner, self.fill, self.restart, self.iterations
        )


@dataclass(frozen=True)
class PetscMumps(SolverMethod):
    """LDLᵀ factorisation by MUMPS in double precision, ordered anew for each matrix.

    Parameters
    ----------
    pivot_threshold : float
        From 0, no pivoting, to 0.5, the most stable. A quasi-definite system needs little.
    extra_memory : int
        Work space beyond MUMPS's own estimate, in per cent.

    Raises
    ------
    ShapeError
        If a setting is out of range.
    """

    pivot_threshold: float = 0.01
    extra_memory: int = 20

    def __post_init__(self) -> None:
        _within("pivot_threshold", self.pivot_threshold, 0.0, 0.5)
        _whole("extra_memory", self.extra_memory, 0, 1000)

    def prepare(self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None) -> LinearSolver:
        """Factorise the matrix."""
        return MumpsSolver(matrix, definite, tolerance, self.pivot_threshold, self.extra_memory)


def _one_of(name: str, given: str, allowed: tuple[str, ...]) -> None:
    if given not in allowed:
        raise ShapeError(f"{name}: got {given!r}, expected one of {', '.join(allowed)}")


def _within(name: str, given: float, low: float, high: float) -> None:
    # NaN fails the comparison too.
    if isinstance(given, bool) or not isinstance(given, int | float) or not low <= given <= high:
        raise ShapeError(f"{name}: got {given!r}, expected a number from {low} to {high}")


def _whole(name: str, given: int, low: int, high: int) -> None:
    if isinstance(given, bool) or not isinstance(given, int) or not low <= given <= high:
        raise ShapeError(f"{name}: got {given!r}, expected a whole number from {low} to {high}")
