"""The one place where MFEM is imported, and what every user of PyMFEM must know.

PyMFEM wraps C++ objects that point to each other. What a C++ object points to must be kept alive in
Python as long as that object is used: a form holds neither its coefficients nor its quadrature rule.
Arrays it hands out are views of memory that dies with its owner, so they are copied. A mixed form
deletes its integrators although Python owns them too: those added by ``AddDomainIntegrator`` are
handed over by PyMFEM itself.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import mfem.ser as mfem
import numpy as np
from scipy.sparse import csr_array, csr_matrix

from dacore.core.arrays import Sparse

__all__ = ["from_native", "mfem", "quiet", "to_native"]


class _Silence:
    """Switches MFEM's two streams off while anybody wants them off, and back to what they were afterwards."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._wanted = 0
        self._streams: list[Any] = []

    def begin(self) -> None:
        with self._lock:
            if not self._wanted:
                self._streams = [stream for stream in (mfem.out, mfem.err) if stream.IsEnabled()]
                for stream in self._streams:
                    stream.Disable()
            self._wanted += 1

    def end(self) -> None:
        with self._lock:
            self._wanted -= 1
            if not self._wanted:
                for stream in self._streams:
                    stream.Enable()


_silence = _Silence()


@contextmanager
def quiet() -> Iterator[None]:
    """Context in which MFEM writes nothing: it prints an error before it raises it, and what it corrects in a mesh.

    These are MFEM's own streams; nothing else in the process is touched. Contexts may overlap, also in
    several threads.
    """
    _silence.begin()
    try:
        yield
    finally:
        _silence.end()


def from_native(matrix: Any) -> Sparse:
    """Copy of a finished MFEM matrix."""
    arrays = (matrix.GetDataArray(), matrix.GetJArray(), matrix.GetIArray())
    data, indices, indptr = (np.array(array) for array in arrays)
    return csr_array((data, indices, indptr), shape=(matrix.Height(), matrix.Width()))


def to_native(matrix: Sparse) -> Any:
    """MFEM's matrix on a copy of the arrays of another, which it keeps alive."""
    arrays = (matrix.data.astype(np.float64), matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32))
    copy = csr_matrix(arrays, shape=matrix.shape)
    # PyMFEM takes an array that owns its memory away from numpy, and nobody frees it; a view is left alone,
    # which is what scipy may or may not have made of it.
    copy.data = copy.data[:]
    return mfem.SparseMatrix(copy)
