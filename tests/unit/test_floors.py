"""Importing does nothing: what a bare import of dacore and its command line may load."""

import subprocess
import sys
from importlib.util import find_spec

import pytest

OPTIONAL = (
    "matplotlib",
    "skfem",
    "nibabel",
    "nilearn",
    "sklearn",
    "pyamg",
    "pandas",
    "pint",
    "pyvista",
    "dolfinx",
    "mfem",
)
PLUGINS = ("dacore_skfem", "dacore_biot", "dacore_imaging")


def loaded_by(statement: str) -> set[str]:
    """Top-level modules in memory after `statement` in a fresh interpreter."""
    code = f"import sys; {statement}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stderr == ""
    return set(result.stdout.split())


@pytest.mark.parametrize("module", ["dacore", "dacore.plugins", "dacore.builtin", "dacore.errors"])
def test_the_door_loads_no_numerical_library(module):
    assert (
        loaded_by(f"import {module}") & {"numpy", "scipy", "h5py", "meshio", "pydantic", *OPTIONAL, *PLUGINS} == set()
    )


def test_the_command_line_loads_no_optional_library():
    assert find_spec("dacore.cli.main") is not None
    assert loaded_by("import dacore.cli.main") & {*OPTIONAL, *PLUGINS} == set()


@pytest.mark.parametrize(
    "package", ["core", "algebra", "geometry", "domains", "dynamics", "estimators", "io", "pipeline"]
)
def test_the_lower_floors_load_no_optional_library_and_draw_no_random_number(package):
    modules = (
        "import pkgutil, importlib, numpy as np; before = np.random.get_state()[1].tolist(); "
        f"import dacore.{package} as p; "
        "[importlib.import_module(m.name) for m in pkgutil.walk_packages(p.__path__, p.__name__ + '.')]; "
        "assert before == np.random.get_state()[1].tolist()"
    )
    assert loaded_by(modules) & {*OPTIONAL, *PLUGINS} == set()
