"""Transient heat conduction for dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_models() -> list[PluginSpec]:
    """Declare the model."""
    return [
        PluginSpec(
            "heat",
            "dacore_heat.model:Heat",
            summary="transient heat conduction in one temperature T, with perfusion by blood (Pennes)",
        )
    ]
