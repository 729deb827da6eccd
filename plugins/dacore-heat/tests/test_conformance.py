"""The model keeps every promise of a physics, on the reference elements and on every library installed."""

from functools import partial

import pytest

from dacore.core.mesh import Mesh
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.profiles import Course
from dacore.plugins.registry import load
from dacore.testing import model_suite, run
from dacore.testing.meshes import shuffled_box
from dacore_heat.model import Heat
from dacore_heat.parts import Exchange, Inclusion, Source

REGISTRY = load()
READY = [row.name for row in REGISTRY.table() if row.kind == "backend" and row.status == "ready"]
GRID = TimeGrid(20.0, 6)
LOADS = ("arterial", "T_left", "q_hole", "ambient_side", "P_probe", "initial")


def body(dim: int, n: int) -> Mesh:
    """An uneven box of 4 cm with a hole in its middle."""
    box = shuffled_box(dim, n, bumpy=True, hole=True)
    return Mesh(4.0 * box.points, box.cells, box.facets, box.facet_tags, box.roles)


def everything(dim: int, order: int, **changes) -> Heat:
    parts = {
        "held": {"left": 2.0},
        "fluxes": {"hole": 3e5},
        "convection": {"side": Exchange(1e4, -10.0)},
        "sources": {"probe": Source((2.8,) * dim, 0.7, 2e7)},
        "initial": 1.0,
        "inclusions": (Inclusion((1.0,) * dim, 1.0, 3.0, 0.8, 0.2),),
        "courses": {"P_probe": Course("pulse", 70.0), "q_hole": Course("sine", frequency=0.01)},
        "ranges": {"arterial": (-0.5, 0.5), "h_side": (5e3, 2e4), "initial": (0.0, 2.0), "capacity": (3.5e7, 4e7)},
        "log_uniform": ("perfusion", "h_side"),
    }
    return Heat(order, **(parts | changes))


test_on_reference_elements = model_suite(everything(3, 1), partial(body, 3, 3), GRID, affine_in=LOADS).as_test()
test_plain = model_suite(Heat(convection={"side": Exchange(1e4, -10.0)}), partial(body, 2, 5), GRID).as_test()


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize(("dim", "order", "n"), [(2, 1, 5), (2, 2, 4), (3, 1, 3)])
def test_on_every_library(name, dim, order, n):
    made = REGISTRY.get("backend", name)()
    assert run(model_suite(everything(dim, order), partial(body, dim, n), GRID, backend=made, affine_in=LOADS)) == []
