"""Keep what libraries do on the side to themselves: logging for all, warnings nobody here can act on, linker flags."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet() -> Iterator[None]:
    """Context for importing DOLFINx and for compiling with it.

    FFCx and setuptools, which runs the compiler, set up the root logger, and setuptools logs every
    command to it. FFCx leaves files open and calls numpy by old names. DOLFINx before 0.8 makes every
    extension module that is imported later share its symbols.
    """
    root, flags = logging.getLogger(), sys.getdlopenflags()
    level = root.level
    handler = logging.NullHandler()
    root.addFilter(_important)
    root.addHandler(handler)  # without one, logging would add its own, which writes to stderr
    try:
        with warnings.catch_warnings():
            for category in (DeprecationWarning, FutureWarning, ResourceWarning):
                warnings.simplefilter("ignore", category)
            yield
    finally:
        root.removeHandler(handler)
        root.removeFilter(_important)
        root.setLevel(level)
        sys.setdlopenflags(flags)


def _important(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING
