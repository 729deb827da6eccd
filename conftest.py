"""What every test run shares: required backends, reproducible examples, one BLAS thread."""

import os

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


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to run without the backends that DACORE_REQUIRE names (``skfem,dolfinx``).

    Without it, tests of a backend that is not installed are skipped; with it, a run that passes has
    tested every backend it was told to.
    """
    required = [name.strip() for name in os.environ.get("DACORE_REQUIRE", "").split(",") if name.strip()]
    registry = load()
    for name in required:
        try:
            registry.get("backend", name)
        except PluginError as error:
            raise pytest.UsageError(f"DACORE_REQUIRE names {name}: {error}") from error


def pytest_report_header() -> str:
    """Show which backends this run can test."""
    rows = [row for row in load().table() if row.kind == "backend"]
    return "backends: " + ", ".join(f"{row.name} ({row.status})" for row in rows)
