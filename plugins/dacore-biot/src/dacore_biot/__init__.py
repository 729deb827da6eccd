"""Biot poroelasticity for dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_models() -> list[PluginSpec]:
    """Declare the model."""
    return [
        PluginSpec(
            "biot",
            "dacore_biot.model:Biot",
            summary="dynamic poroelasticity in displacement and pressure (u, p)",
        )
    ]
