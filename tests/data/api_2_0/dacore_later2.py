"""A plugin of a time to come that needs a name which the door does not have yet."""

from dacore.plugins import Extension, hookimpl  # noqa: F401
