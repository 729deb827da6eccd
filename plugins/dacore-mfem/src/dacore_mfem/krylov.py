"""Settings of MFEM's iterative solvers for time steps; MFEM itself is imported when a solver is prepared.

CPU seconds of one thread over a cycle of 40 time steps of poroelasticity on the brain, mid-range
parameters, beside the built-in methods (the ordering of "direct" found beforehand), memory beyond the matrix:

========  ========  =========  =======================  =======  =======  ====  ======
nodes     unknowns  tolerance  method                   set-up   a step   its   GiB
========  ========  =========  =======================  =======  =======  ====  ======
5,147     18,342    1e-10      direct                   0.28     0.029    –     0.05
5,147     18,342    1e-10      krylov                   0.24     0.060    18    0.02
5,147     18,342    1e-10      bicgstab, blocks         0.05     0.051    11    0.02
5,147     18,342    1e-10      gmres, blocks            0.05     0.056    19    0.02
5,147     18,342    1e-10      minres, blocks           0.07     0.15     63    0.02
5,147     18,342    1e-10      bicgstab, gauss_seidel   0.02     0.21     40    0.01
5,147     18,342    1e-10      bicgstab, ilu            0.62     0.32     18    0.03
33,247    124,207   1e-8       direct                   8.8      0.24     –     0.71
33,247    124,207   1e-8       krylov                   2.8      0.70     22    0.26
33,247    124,207   1e-8       bicgstab, blocks         0.35     0.35     11    0.22
33,247    124,207   1e-8       gmres, blocks            0.46     0.34     18    0.22
33,247    124,207   1e-8       minres, blocks           0.46     1.1      73    0.22
33,247    124,207   1e-8       bicgstab, gauss_seidel   0.12     1.4      43    0.06
========  ========  =========  =======================  =======  =======  ====  ======

Over the corners of the ranges of κ, E and ν, "bicgstab, blocks" takes 10 to 15 iterations a step. It slows
down and does not stall for steps a hundred times as long (350 iterations) or ν = 0.499 (110).
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

from dacore.core.arrays import BoolArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ShapeError

Iteration = Literal["bicgstab", "gmres", "minres", "cg"]
Preconditioner = Literal["blocks", "gauss_seidel", "ilu", "jacobi"]

# MINRES and conjugate gradients need a symmetric positive definite preconditioner.
_DEFINITE = {"blocks", "jacobi"}


@dataclass(frozen=True)
class MfemKrylov(SolverMethod):
    """Krylov iterations of MFEM.

    Parameters
    ----------
    iteration : {"bicgstab", "gmres", "minres", "cg"}
        "gmres" is flexible GMRES. "cg" is for positive definite matrices alone.
    preconditioner : {"blocks", "gauss_seidel", "ilu", "jacobi"}
        "blocks": Gauss–Seidel on A and on C + B diag(A)⁻¹ Bᵀ, put together as a block triangle, as a
        block diagonal for "minres". "gauss_seidel": on the whole matrix. "ilu": incomplete
        factorisation without fill; slow in MFEM. "jacobi": no more than the scaling of the system.
    sweeps : int
        Gauss–Seidel sweeps, each forward and backward.
    restart : int
        GMRES iterations between restarts: memory is twice that many vectors.
    max_iterations : int
        Of one run; the solver runs again as long as it gains.

    Raises
    ------
    ShapeError
        If a setting is out of range or two do not go together.
    """

    iteration: Iteration = "bicgstab"
    preconditioner: Preconditioner = "blocks"
    sweeps: int = 1
    restart: int = 50
    max_iterations: int = 1000

    def __post_init__(self) -> None:
        for name, allowed in (("iteration", get_args(Iteration)), ("preconditioner", get_args(Preconditioner))):
            if getattr(self, name) not in allowed:
                raise ShapeError(
                    f"mfem_krylov {name}: got {getattr(self, name)!r}, expected one of {', '.join(allowed)}"
                )
        for name in ("sweeps", "restart", "max_iterations"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ShapeError(f"mfem_krylov {name}: got {value!r}, expected a whole number of at least 1")
        if self.iteration in ("minres", "cg") and self.preconditioner not in _DEFINITE:
            raise ShapeError(
                f"mfem_krylov: {self.iteration} needs a positive definite preconditioner, which {self.preconditioner} "
                f"is not; use {' or '.join(sorted(_DEFINITE))}, or bicgstab or gmres"
            )

    def prepare(self, matrix: Sparse, definite: BoolArray, tolerance: float, analysis: Any = None) -> LinearSolver:
        """Make the preconditioner."""
        from dacore_mfem.solver import MfemSolver

        return MfemSolver(matrix, definite, tolerance, self)
