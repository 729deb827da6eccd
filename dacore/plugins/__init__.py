"""The plugin door: what a plugin's module imports to declare what it brings."""

from dacore.plugins.spec import API_VERSION, GROUP, PluginSpec, hookimpl

__all__ = ["API_VERSION", "GROUP", "PluginSpec", "hookimpl"]
