"""DOLFINx backend of dacore, and linear solvers of PETSc."""

from dacore.plugins import PluginSpec, hookimpl

_INSTALL = "sudo apt install python3-dolfinx and use /usr/bin/python3 -m venv --system-site-packages"


@hookimpl
def dacore_backends() -> list[PluginSpec]:
    """Declare the backend."""
    return [
        PluginSpec(
            "dolfinx",
            "dacore_dolfinx.backend:DolfinxBackend",
            requires=("dolfinx",),
            install=_INSTALL,
            summary="FEniCS: compiled forms, 0.5.2 (Debian 12) to 0.11",
        )
    ]
