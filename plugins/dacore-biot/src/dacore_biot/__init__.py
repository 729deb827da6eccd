"""Biot poroelasticity for dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_models() -> list[PluginSpec]:
    """Declare the models."""
    return [
        PluginSpec(
            "biot",
            "dacore_biot.model:Biot",
            summary="dynamic poroelasticity in displacement and pressure (u, p)",
        ),
        PluginSpec(
            "biot_harmonic",
            "dacore_biot.harmonic:BiotHarmonic",
            summary="poroelasticity at one frequency: amplitudes and phases of (u, p)",
        ),
    ]
