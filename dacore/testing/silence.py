"""What a call writes to standard output and error, whoever writes it: Python, C or Fortran."""

import ctypes
import io
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout


def written_by(work: Callable[[], object]) -> str:
    """Call `work` and return what arrived meanwhile at sys.stdout and sys.stderr and at file descriptors 1 and 2."""
    # Python's streams need not lead to the descriptors: a test runner may have put its own in their place.
    python = io.StringIO()
    _flush()
    saved = [os.dup(number) for number in (1, 2)]
    with tempfile.TemporaryFile() as file:
        try:
            for number in (1, 2):
                os.dup2(file.fileno(), number)
            with redirect_stdout(python), redirect_stderr(python):
                work()
            _flush()
        finally:
            for number, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, number)
                os.close(copy)
        file.seek(0)
        return python.getvalue() + file.read().decode(errors="replace")


def _flush() -> None:
    """Write out what Python and C hold back."""
    for stream in (sys.stdout, sys.stderr, sys.__stdout__, sys.__stderr__):
        if stream is not None and not stream.closed:
            stream.flush()
    ctypes.CDLL(None).fflush(None)
