"""Every backend whose library is installed, and bars to shake."""

import pytest

from dacore.domains.box import Box
from dacore.plugins.registry import load

REGISTRY = load()
READY = [row.name for row in REGISTRY.table() if row.kind == "backend" and row.status == "ready"]


@pytest.fixture(params=READY)
def backend(request):
    return REGISTRY.get("backend", request.param)()


@pytest.fixture
def on(backend):
    """Turn a mesh into what `Physics.build` asks for."""
    return lambda mesh: lambda fields: backend.discretize(mesh, fields)


@pytest.fixture(scope="session")
def bar():
    """Make a bar along the first axis; its near side is `base`, its far side `tip`, the rest `side`."""

    def make(dim=2, cells=16, length=2.0, across=1):
        sides = [f"{axis}{end}" for axis in "xyz"[1:dim] for end in "-+"]
        roles = {"base": ("x-",), "tip": ("x+",), "side": tuple(sides)}
        width = length / cells * across
        upper = (length, *(width,) * (dim - 1))
        return Box((0.0,) * dim, upper, (cells, *(across,) * (dim - 1)), roles).mesh()

    return make
