"""A plugin of every kind there was, written against plugin interface 1.0 and left as it was then. Do not modernise."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_domains():
    return [PluginSpec("bar", "dacore_bar.domain:Bar", summary="a bar of triangles")]


@hookimpl
def dacore_models():
    # The version of the interface was a whole number.
    return [PluginSpec("bar_heat", "dacore_bar.model:Heat", (), "", "heat in a bar", 1)]


@hookimpl
def dacore_observations():
    return [PluginSpec("bar_probes", "dacore_bar.probes:Probes", api=1)]


@hookimpl
def dacore_quantities():
    return [PluginSpec("bar_end", "dacore_bar.probes:End", requires=("scipy",))]


@hookimpl
def dacore_estimators():
    return [PluginSpec("bar_nearest", "dacore_bar.nearest:Nearest")]


@hookimpl
def dacore_solvers():
    return [PluginSpec("bar_minres", "dacore_bar.solver:MinimalResiduals", install="pip install scipy")]


@hookimpl
def dacore_backends():
    return [PluginSpec("bar_elements", "dacore_bar.backend:Elements")]


@hookimpl
def dacore_studies():
    return [PluginSpec("bar_samples", "dacore_bar.study:Samples")]
