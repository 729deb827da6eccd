"""What every test run shares: required backends, reproducible examples, one BLAS thread."""

import os
import subprocess
import sys

import pytest
from hypothesis import settings

from dacore.errors import PluginError
from dacore.plugins.registry import load

# Nothing above imports numpy, so these still count; worker processes inherit them.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

# One triangle of area 1/2: a library that is found but cannot be loaded, or cannot compile, says so here.
_TRIAL = """
import sys
from dacore.core.fields import Field
from dacore.core.mesh import Mesh
from dacore.plugins.registry import load
backend = load().get("backend", sys.argv[1])()
triangle = Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], [[0, 1], [1, 2], [2, 0]], [1, 1, 1], {"rim": 1})
area = backend.discretize(triangle, [Field("p", 1, 1)]).scalar_mass("p").sum()
if abs(area - 0.5) > 1e-14:
    sys.exit(f"the area of a triangle is {area}, expected 0.5")
print(backend.version())
"""

_VERSIONS = pytest.StashKey[dict[str, str]]()


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to run without the backends that DACORE_REQUIRE names (``skfem,dolfinx``).

    Without it, tests of a backend that is not installed are skipped; with it, a run that passes has
    tested every backend it was told to. Each is tried in a process of its own, so that the tests
    themselves start with no finite element library in memory.
    """
    config.stash[_VERSIONS] = {}
    if hasattr(config, "workerinput"):  # the main process has tried them
        return
    required = [name.strip() for name in os.environ.get("DACORE_REQUIRE", "").split(",") if name.strip()]
    registry = load()
    for name in required:
        try:
            registry.get("backend", name)
        except PluginError as error:
            raise pytest.UsageError(f"DACORE_REQUIRE names {name}: {error}") from error
        trial = subprocess.run([sys.executable, "-c", _TRIAL, name], capture_output=True, text=True, check=False)
        if trial.returncode:
            reason = (trial.stderr.strip().splitlines() or [f"exit code {trial.returncode}"])[-1]
            raise pytest.UsageError(f"DACORE_REQUIRE names {name}, which does not work: {reason}")
        config.stash[_VERSIONS][name] = trial.stdout.split()[-1]


def pytest_report_header(config: pytest.Config) -> str:
    """Show which backends this run can test, and the versions of those it must."""
    versions = config.stash[_VERSIONS]
    rows = [row for row in load().table() if row.kind == "backend"]
    return "backends: " + ", ".join(f"{row.name} {versions.get(row.name, '')} ({row.status})" for row in rows)
