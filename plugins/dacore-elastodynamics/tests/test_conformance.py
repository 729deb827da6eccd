"""The model keeps every promise of a physics, on the reference elements and on every library installed."""

from functools import partial

import pytest

from dacore.core.mesh import Mesh
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.profiles import Course
from dacore.plugins.registry import load
from dacore.testing import model_suite, run
from dacore.testing.meshes import shuffled_box
from dacore_elastodynamics.model import Elastodynamics
from dacore_elastodynamics.parts import BodyForce, Inclusion, Motion, Traction

REGISTRY = load()
READY = [row.name for row in REGISTRY.table() if row.kind == "backend" and row.status == "ready"]
GRID = TimeGrid(2e-3, 6)
LOADS = ("u_left", "t_side", "t_hole", "f")


def body(dim: int, n: int) -> Mesh:
    """An uneven box of 4 cm with a hole in its middle."""
    box = shuffled_box(dim, n, bumpy=True, hole=True)
    return Mesh(4.0 * box.points, box.cells, box.facets, box.facet_tags, box.roles)


def everything(dim: int, order: int) -> Elastodynamics:
    last = (0.0,) * (dim - 1) + (-1.0,)
    return Elastodynamics(
        order,
        held={"left": tuple(range(1, dim)), "right": (0,)},
        moved={"left": Motion(0.02, 0)},
        tractions={"side": Traction(100.0, last), "hole": Traction(50.0)},
        body_force=BodyForce(30.0, last),
        courses={
            "u_left": Course("sine", frequency=40.0), "t_side": Course("tone_burst", frequency=60.0),
            "t_hole": Course("ramp", duration=0.01),
        },
        inclusions=(Inclusion((1.0,) * dim, 1.0, 3.0, 1.2),),
        ranges={"mass_damping": (0.0, 20.0), "stiffness_damping": (1e-4, 1e-3), "density": (0.9, 1.1),
                "t_hole": (20.0, 80.0)},
        log_uniform=("E", "stiffness_damping"),
    )  # fmt: skip


test_on_reference_elements = model_suite(everything(3, 1), partial(body, 3, 3), GRID, affine_in=LOADS).as_test()
test_plain = model_suite(
    Elastodynamics(tractions={"side": Traction(1.0)}), partial(body, 2, 5), GRID, affine_in=("t_side",)
).as_test()


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize(("dim", "order", "n"), [(2, 1, 5), (2, 2, 4), (3, 1, 3)])
def test_on_every_library(name, dim, order, n):
    made = REGISTRY.get("backend", name)()
    assert run(model_suite(everything(dim, order), partial(body, dim, n), GRID, backend=made, affine_in=LOADS)) == []
