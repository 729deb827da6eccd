"""Choice of a linear solver."""

from typing import Literal

from dacore.algebra.blockwise import BlockSolver
from dacore.algebra.direct import DirectSolver
from dacore.algebra.elimination import Ordering
from dacore.algebra.linear_solver import LinearSolver
from dacore.core.arrays import BoolArray, Sparse
from dacore.errors import ShapeError

# Entries of a factor of 4 GiB: some 500,000 unknowns of a poroelastic step in three dimensions.
_LARGEST_FACTOR = 2**30
_SURELY_DIRECT = 50_000

Method = Literal["auto", "direct", "krylov"]

__all__ = ["LinearSolver", "Method", "Ordering", "make_solver"]


def make_solver(
    matrix: Sparse,
    definite: BoolArray,
    method: Method = "auto",
    tolerance: float = 1e-10,
    ordering: Ordering | None = None,
) -> LinearSolver:
    """Prepare a solver of A x = b for one symmetric quasi-definite matrix.

    Parameters
    ----------
    matrix : (n, n) csr_array
        [[A, Bᵀ], [B, −C]] with A and C positive definite, rows in any order.
    definite : (n,) bool array
        True on the rows of A; all True for a positive definite matrix.
    method : {"auto", "direct", "krylov"}
    tolerance : float
        Bound on the relative residual of every column, see `LinearSolver`.
    ordering : Ordering, optional
        From ``Ordering.of(matrix, definite)`` of any matrix with this pattern; saves the direct
        method from finding it again for every parameter sample.

    Raises
    ------
    ShapeError
        If the matrix is not as described.
    ConvergenceError
        If it turns out not to be quasi-definite.
    """
    if method not in ("auto", "direct", "krylov"):
        raise ShapeError(f"linear solver: got the method {method!r}, expected 'auto', 'direct' or 'krylov'")
    if method == "krylov":
        return BlockSolver(matrix, definite, tolerance)
    if method == "auto" and matrix.shape[0] > _SURELY_DIRECT:
        ordering = Ordering.of(matrix, definite) if ordering is None else ordering
        if ordering.factor_entries > _LARGEST_FACTOR:
            return BlockSolver(matrix, definite, tolerance)
    return DirectSolver(matrix, definite, tolerance, ordering)
