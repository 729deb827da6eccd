"""Choice of a linear solver.

CPU seconds of one thread over a cycle of 40 time steps of poroelasticity on anatomical meshes, the
ordering found beforehand, memory beyond the matrix (``tests/benchmarks/solvers.py``):

========  ========  =========  ========================  =======  =======  ====  ======
nodes     unknowns  tolerance  method                    set-up   a step   its   GiB
========  ========  =========  ========================  =======  =======  ====  ======
5,055     18,176    1e-10      direct                    0.25     0.026    –     0.05
5,055     18,176    1e-10      krylov                    0.19     0.047    18    0.02
5,055     18,176    1e-10      SuperLU, minimum degree   2.66     0.020    –     0.19
5,055     18,176    1e-10      BiCGSTAB, diagonal        0.01     0.37     351   0.00
33,111    123,921   1e-8       direct                    7.9      0.19     –     0.85
33,111    123,921   1e-8       krylov                    2.5      0.63     22    0.32
33,111    123,921   1e-8       BiCGSTAB, diagonal        0.1      3.5      409   0.00
101,707   387,675   1e-8       direct                    73       0.71     –     4.4
101,707   387,675   1e-8       krylov                    15       5.5      43    1.8
========  ========  =========  ========================  =======  =======  ====  ======

The direct method also works where the iteration stalls (ν → 1/2, large time steps, static problems),
so "auto" takes it whenever the factor fits in memory. Ordering costs 0.4, 2.3 and 9 seconds once.
"""

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
