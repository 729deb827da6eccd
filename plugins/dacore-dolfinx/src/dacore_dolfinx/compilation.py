"""DOLFINx's just-in-time compiler: deliberate options, no noise, errors that say what to do.

A kernel takes about 0.2 s once; then it is in the cache, ``$XDG_CACHE_HOME/fenics`` or
``~/.cache/fenics`` unless DOLFINx's own settings file says otherwise. Processes may share it.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from cffi import VerificationError

from dacore.errors import PluginError
from dacore_dolfinx import compat
from dacore_dolfinx.quiet import quiet

# -O3 and -march=native gain nothing measurable: the time goes into adding to the matrix.
_OPTIONS = {
    "cffi_extra_compile_args": ["-O2", "-g0", "-w"],
    "cffi_verbose": False,
    "cffi_debug": False,
    "timeout": 60,  # seconds to wait for another process that compiles the same kernel
}

_T = TypeVar("_T")


def compile_form(form: Any) -> Any:
    """Kernel of a UFL form; PluginError if it cannot be compiled."""
    return _compiled(lambda: compat.compiled(form, _OPTIONS))


def compile_space(domain: Any, order: int) -> Any:
    """Scalar Lagrange elements on a mesh, of order 0 one constant a cell; PluginError if they cannot be compiled."""
    return _compiled(lambda: compat.space(domain, order, _OPTIONS))


def _compiled(make: Callable[[], _T]) -> _T:
    try:
        with quiet():
            return make()
    except VerificationError as error:
        raise PluginError(
            f"backend dolfinx: its C compiler failed ({_line(error)}); install gcc and Python's headers: "
            "sudo apt install gcc python3-dev"
        ) from error
    except TimeoutError as error:
        raise PluginError(
            f"backend dolfinx: {_line(error)}; if no other process is compiling, one was stopped while it did: "
            "remove that file"
        ) from error


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())
