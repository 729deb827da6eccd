"""MFEM backend of dacore."""

from dacore.plugins import PluginSpec, hookimpl

_INSTALL = "pip install mfem (where numpy must stay below 2: pip install --no-deps mfem==4.10.0.1)"


@hookimpl
def dacore_backends() -> list[PluginSpec]:
    """Declare the backend."""
    return [
        PluginSpec(
            "mfem",
            "dacore_mfem.backend:MfemBackend",
            requires=("mfem",),
            install=_INSTALL,
            summary="MFEM: compiled C++, through PyMFEM",
        )
    ]
