"""PETSc, started once a process: without its signal handlers, without files of options, in one thread of BLAS."""

from functools import cache
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from dacore.core.arrays import Sparse
from dacore.errors import PluginError


@cache
def petsc() -> Any:
    """Module ``petsc4py.PETSc``; PluginError if it was built for complex numbers."""
    import petsc4py

    # Its handlers would write a report whenever a worker is told to stop. Whoever started PETSc earlier has chosen.
    petsc4py.init(["dacore", "-no_signal_handler", "-skip_petscrc"])
    from petsc4py import PETSc

    if PETSc.ScalarType is not np.float64:
        raise PluginError(
            f"petsc4py: built for numbers of type {PETSc.ScalarType.__name__}, expected float64; "
            "choose the real build: unset PETSC_DIR and PETSC_ARCH, or sudo apt install python3-petsc4py-real"
        )
    return PETSc


def one_thread() -> Any:
    """Context in which BLAS runs in one thread, PETSc's own too."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    petsc()  # a controller knows what is loaded when it is made
    return ThreadpoolController()


def to_mat(matrix: Sparse) -> Any:
    """PETSc's matrix of a csr_array on this process alone; the arrays are copied."""
    PETSc = petsc()
    whole = (matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data)
    return PETSc.Mat().createAIJ(size=matrix.shape, csr=whole, comm=PETSc.COMM_SELF)
