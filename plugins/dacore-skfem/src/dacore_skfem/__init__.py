"""scikit-fem backend of dacore."""

from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_backends() -> list[PluginSpec]:
    """Declare the backend."""
    return [
        PluginSpec(
            "skfem",
            "dacore_skfem.backend:SkfemBackend",
            requires=("skfem",),
            install="pip install scikit-fem",
            summary="scikit-fem: pure Python, the embedded default",
        )
    ]
