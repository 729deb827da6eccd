"""The plugin door: what a plugin's module imports to declare what it brings."""

from dacore.plugins.api import API_VERSION
from dacore.plugins.spec import GROUP, PluginSpec, hookimpl

__all__ = ["API_VERSION", "GROUP", "PluginSpec", "hookimpl"]
