"""dacore: from a few measurements of a physical system to its whole state, with honest uncertainty."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dacore.workflow.open import open_scene
    from dacore.workflow.session import Session

__version__ = "0.1.0"
__all__ = ["Session", "__version__", "open_scene"]


def __getattr__(name: str) -> Any:
    # Imported at first use, so that ``import dacore`` costs nothing.
    if name == "open_scene":
        from dacore.workflow.open import open_scene

        return open_scene
    if name == "Session":
        from dacore.workflow.session import Session

        return Session
    raise AttributeError(f"module 'dacore' has no attribute {name!r}")
