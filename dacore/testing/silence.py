"""What a call writes to standard output and error, whoever writes it: Python, C or Fortran."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Callable


def written_by(work: Callable[[], object]) -> str:
    """Call `work` and return what arrived at file descriptors 1 and 2 meanwhile."""
    _flush()
    saved = [os.dup(number) for number in (1, 2)]
    with tempfile.TemporaryFile() as file:
        try:
            for number in (1, 2):
                os.dup2(file.fileno(), number)
            work()
            _flush()
        finally:
            for number, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, number)
                os.close(copy)
        file.seek(0)
        return file.read().decode(errors="replace")


def _flush() -> None:
    """Write out what Python and C hold back."""
    for stream in (sys.stdout, sys.stderr, sys.__stdout__, sys.__stderr__):
        if stream is not None and not stream.closed:
            stream.flush()
    ctypes.CDLL(None).fflush(None)
