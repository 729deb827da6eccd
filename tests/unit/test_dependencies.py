"""Whatever is imported is declared: an undeclared package is only there by luck of another's."""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

from dacore.plugins.registry import load

ROOT = Path(__file__).resolve().parents[2]
IMPORTED_AS = {"scikit-fem": "skfem"}
# What comes with a package as a matter of course; DOLFINx cannot be had without the rest of FEniCS, PETSc and MPI.
WITH = {
    "pydantic": {"annotated_types", "pydantic_core"},
    "dolfinx": {"basix", "cffi", "ffcx", "mpi4py", "petsc4py", "ufl"},
}
DISTRIBUTIONS = {".": "dacore"} | {f"plugins/{path.name}": "src" for path in sorted((ROOT / "plugins").iterdir())}


def declared(folder):
    project = tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for lines in project.get("optional-dependencies", {}).values() for line in lines]
    names = {re.match(r"[A-Za-z0-9_.-]+", line)[0] for line in [*project["dependencies"], *extras]}
    modules = {IMPORTED_AS.get(name, name.replace("-", "_")) for name in names} | required(project["name"])
    return modules | {more for name in modules for more in WITH.get(name, ())}


def required(distribution):
    """What its plugins say they need: a library that pip cannot install stands there only."""
    own = (each.spec for each in load().declarations if each.source.distribution == distribution)
    return {module.partition(".")[0] for spec in own for module in spec.requires}


def imported(source):
    for file in source.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from ((alias.name.partition(".")[0], file) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                yield node.module.partition(".")[0], file


@pytest.mark.parametrize("folder", DISTRIBUTIONS)
def test_every_import_is_declared(folder):
    source = ROOT / folder / DISTRIBUTIONS[folder]
    own = {path.name for path in source.iterdir() if path.is_dir()} | {"dacore"}
    allowed = set(sys.stdlib_module_names) | own | declared(folder) | declared(".")
    undeclared = {f"{file.relative_to(ROOT)}: {name}" for name, file in imported(source) if name not in allowed}
    assert not undeclared
