"""Versions of the plugin interface: what a plugin was written for, and whether this dacore still has that.

The interface is what docs/versions.md lists: hooks, base classes, the values they exchange, the suites. It has a
version of its own, apart from dacore's. A minor step adds: a hook, a method with a default, a field with a
default. A major step changes or removes. So a plugin runs wherever the major version is its own and the minor
version is at least its own.
"""

import re

API_VERSION = (1, 1)
"""(major, minor) of this dacore."""

OLDEST = "1.0"
"""What a plugin that says nothing was written for: the least of this major version, so that it claims nothing."""


def text_of(api: object) -> str:
    """Return "major.minor" of a version given as such, as (major, minor) or as a whole major; "" if it is none."""
    if isinstance(api, int) and not isinstance(api, bool):
        return f"{api}.0"
    if isinstance(api, tuple) and len(api) == 2 and all(type(each) is int for each in api):
        return f"{api[0]}.{api[1]}"
    return api if isinstance(api, str) and re.fullmatch(r"\d+\.\d+", api) else ""


def refused(api: object) -> str:
    """Return why a plugin written for `api` cannot be used here, on one line, or nothing.

    Parameters
    ----------
    api : str, int or (int, int)
        As `PluginSpec.api` has it.
    """
    text = text_of(api)
    if not text:
        return f"api: got {api!r}, expected the version of the plugin interface as text, such as {OLDEST!r}"
    major, minor = map(int, text.split("."))
    here = ".".join(map(str, API_VERSION))
    if (major, minor) > API_VERSION:
        return f"written for plugin interface {text}, this dacore has {here}; update dacore"
    if major < API_VERSION[0]:
        return (
            f"written for plugin interface {text}, this dacore has {here}, which is not compatible; update the plugin, "
            "or install a dacore of its time"
        )
    return ""
