"""Elastodynamics for dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_models() -> list[PluginSpec]:
    """Declare the model."""
    return [
        PluginSpec(
            "elastodynamics",
            "dacore_elastodynamics.model:Elastodynamics",
            summary="waves and vibrations of a damped elastic solid in its displacement u",
        )
    ]
