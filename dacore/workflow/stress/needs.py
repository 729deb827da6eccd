"""What the references need beside numpy and scipy."""

from typing import Any

from dacore.errors import MissingDependencyError


def mpmath() -> Any:
    """Module mpmath; MissingDependencyError if it is not installed."""
    try:
        import mpmath as module
    except ImportError as error:
        raise MissingDependencyError(
            "stress: the references need mpmath, which is not installed; pip install 'dacore[stress]'"
        ) from error
    return module
