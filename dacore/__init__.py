"""dacore: from a few measurements of a physical system to its whole state, with honest uncertainty.

`open_scene` opens a scene and returns a `Session`, which makes each result when it is asked for; `reconstruct` takes
measured values from files. Every error raised on purpose is a `DacoreError`. Pictures are in `dacore.plotting`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dacore.errors import DacoreError as DacoreError

if TYPE_CHECKING:
    from dacore.workflow.open import open_scene as open_scene
    from dacore.workflow.reconstruct.run import reconstruct as reconstruct
    from dacore.workflow.session import Session as Session

__version__ = "0.1.0"
__all__ = ["DacoreError", "Session", "__version__", "open_scene", "reconstruct"]

# Imported at first use, so that ``import dacore`` costs nothing.
_LAZY = {
    "Session": "dacore.workflow.session",
    "open_scene": "dacore.workflow.open",
    "reconstruct": "dacore.workflow.reconstruct.run",
}


if not TYPE_CHECKING:  # or a type checker would take any name for one of dacore's

    def __getattr__(name: str) -> Any:
        if name not in _LAZY:
            raise AttributeError(f"module 'dacore' has no attribute {name!r}")
        return getattr(import_module(_LAZY[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
