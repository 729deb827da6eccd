"""Fresh Python processes, and which finite element libraries they loaded."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dacore.plugins.registry import load

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples" / "toy" / "ball.toml"
SMALL = ("training.samples=2", "time.steps=2", "domain.edge=2.5")

FAMILIES = {
    "skfem": {"skfem"},
    "dolfinx": {"dolfinx", "petsc4py", "slepc4py", "mpi4py", "ufl", "basix", "ffcx", "ffc"},
    "mfem": {"mfem"},
}
"""Top-level modules that come with each backend's library."""

LIBRARIES = set().union(*FAMILIES.values())

LOADED = "import sys\ndef loaded():\n    return ' '.join(sorted({name.partition('.')[0] for name in sys.modules}))\n"
"""Source of `loaded()`, for the code that `python` runs."""


def backends() -> list:
    """Every backend as a parameter of a test; one without its library is skipped, unless DACORE_REQUIRE names it."""
    status = {row.name: row.status for row in load().table() if row.kind == "backend"}
    return [
        pytest.param(
            name, marks=pytest.mark.skipif(status.get(name) != "ready", reason=f"{name}: {status.get(name, 'absent')}")
        )
        for name in FAMILIES
    ]


def python(code: str, *arguments: object, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `code` in a fresh interpreter, with `path` before everything that is installed."""
    environment = {**os.environ, "COLUMNS": "200"}
    if path is not None:
        environment["PYTHONPATH"] = str(path)
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, check=False)


def dacore(*arguments: object, before: str = "", path: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line in a fresh interpreter, after the code `before`.

    The last line of its output names the top-level modules that were loaded.
    """
    code = (
        f"{LOADED}{before}\nfrom dacore.cli.main import main\n"
        "try:\n    main(sys.argv[1:])\nfinally:\n    print(loaded())"
    )
    return python(code, *arguments, path=path)


def last_line(done: subprocess.CompletedProcess[str]) -> set[str]:
    """The modules named in the last line of a process that ended well."""
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())
