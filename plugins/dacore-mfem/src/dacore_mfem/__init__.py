"""MFEM backend and solvers of dacore."""

from dacore.plugins import PluginSpec, hookimpl

_INSTALL = "pip install mfem (beside a numpy below 2.4: pip install --no-deps mfem==4.10.0.1)"


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


@hookimpl
def dacore_solvers() -> list[PluginSpec]:
    """Declare the solvers."""
    return [
        PluginSpec(
            "mfem_krylov",
            "dacore_mfem.krylov:MfemKrylov",
            requires=("mfem",),
            install=_INSTALL,
            summary="MFEM's BiCGSTAB, GMRES, MINRES and conjugate gradients",
        )
    ]
