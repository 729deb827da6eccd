"""A plugin of a time to come: plugin interface 2.0, declared with what there is today."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_models():
    return [PluginSpec("later", "dacore_later:Later", api="2.0")]


@hookimpl
def dacore_domains():
    return [PluginSpec("soon", "dacore_later:Soon", api="1.99")]
