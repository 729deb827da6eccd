"""Settings of MFEM's iterative solvers for time steps; MFEM itself is imported when a solver is prepared.

TABLE
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
