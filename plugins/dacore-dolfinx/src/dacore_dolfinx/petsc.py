"""PETSc with real numbers, on this process alone, in one thread of BLAS."""

import sys
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from dacore.core.arrays import Sparse
from dacore.errors import PluginError


@cache
def petsc() -> Any:
    """Module ``petsc4py.PETSc``; PluginError if it was built for complex numbers."""
    import h5py  # noqa: F401  before PETSc, which brings an HDF5 of its own
    from petsc4py import PETSc

    if PETSc.ScalarType is not np.float64:
        raise PluginError(
            f"petsc4py: built for numbers of type {PETSc.ScalarType.__name__}, expected float64; "
            "choose the real build: unset PETSC_DIR and PETSC_ARCH, or sudo apt install python3-petsc4py-real"
        )
    return PETSc


class Native(SimpleNamespace):
    """PETSc's objects, as attributes. They are destroyed when this is.

    petsc4py 3.18 does not destroy what Python no longer refers to but keeps it until it is told to.
    """

    def __del__(self) -> None:
        if sys.is_finalizing():
            return
        vars(self).clear()
        PETSc = petsc()
        if hasattr(PETSc, "garbage_cleanup") and not PETSc.Sys.isFinalized():
            PETSc.garbage_cleanup(PETSc.COMM_SELF)


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
