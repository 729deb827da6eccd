"""The finite element libraries that this run can test."""

from dacore.plugins.registry import load

REGISTRY = load()
READY = [row.name for row in REGISTRY.table() if row.kind == "backend" and row.status == "ready"]
"""Names of the backends whose library is installed; the root conftest fails a run that lacks a required one."""


def backend(name):
    return REGISTRY.get("backend", name)()
