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


@hookimpl
def dacore_solvers() -> list[PluginSpec]:
    """Declare the linear solvers."""
    return [
        PluginSpec(
            "petsc_krylov",
            "dacore_dolfinx.solvers:PetscKrylov",
            requires=("petsc4py",),
            install=_INSTALL,
            summary="PETSc: GMRES or BiCGSTAB, incomplete factors of the blocks",
        ),
        PluginSpec(
            "petsc_mumps",
            "dacore_dolfinx.solvers:PetscMumps",
            requires=("petsc4py",),
            install=_INSTALL,
            summary="PETSc: LDLT factorisation by MUMPS, double precision",
        ),
    ]
