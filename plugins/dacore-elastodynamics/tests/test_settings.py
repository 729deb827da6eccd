"""Settings: what is refused, in one line; which parameters there are; what a scene is warned of."""

import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Course
from dacore.errors import MeshError, SceneError, ShapeError
from dacore.plugins.settings import build
from dacore_elastodynamics.analytic import StandingWave
from dacore_elastodynamics.model import Elastodynamics
from dacore_elastodynamics.parts import BodyForce, Inclusion, Motion, Traction

PULL = {"tip": Traction(1.0)}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Elastodynamics(3, tractions=PULL), "order: got 3, expected 1 or 2"),
        (Elastodynamics, "loads: got none, expected something that moves the solid"),
        (lambda: Elastodynamics(held={"base": ()}, tractions=PULL), r"held: got \[\] on base, expected different axes"),
        (lambda: Elastodynamics(held={"base": (1, 1)}, tractions=PULL), r"held: got \[1, 1\] on base"),
        (lambda: Elastodynamics(held={"base": (3,)}, tractions=PULL), r"held: got \[3\] on base"),
        (lambda: Elastodynamics(held={"base": (0,)}, moved={"base": Motion(1.0, 0)}), "moved: axis 0 of base is held"),
        (lambda: Elastodynamics(tractions=PULL, courses={"tip": Course()}), "courses: got tip, expected any of t_tip"),
        (
            lambda: Elastodynamics(tractions=PULL, ranges={"mu": (1, 2)}),
            "elastic parameters: got mu, expected any of E",
        ),
        (lambda: Elastodynamics(tractions=PULL, log_uniform=("G",)), "elastic parameters: got G"),
        (lambda: Elastodynamics(tractions=PULL, ranges={"nu": (0.4, 0.5)}), r"nu: got 0.5, expected .* \(-1, 0.5\)"),
        (lambda: Elastodynamics(tractions=PULL, ranges={"E": (0.0, 1.0)}), r"E: got 0, expected a value in \(0, inf\)"),
        (
            lambda: Elastodynamics(tractions=PULL, ranges={"stiffness_damping": (-1.0, 1.0)}),
            "stiffness_damping: got -1",
        ),
        (lambda: Elastodynamics(tractions=PULL, ranges={"E": (2.0, 1.0)}), "low <= high"),
        (lambda: Traction(float("nan")), "traction: got nan"),
        (lambda: Traction(1.0, (0.0, 0.0)), r"traction: got the direction \[0.0, 0.0\]"),
        (lambda: BodyForce(float("inf"), (1.0, 0.0)), "body_force: got inf"),
        (lambda: BodyForce(1.0, ()), r"body_force: got the direction \[\]"),
        (lambda: Motion(float("inf"), 0), "moved: got inf"),
        (lambda: Motion(1.0, 3), "moved: got axis 3, expected 0, 1 or 2"),
        (lambda: Inclusion((0.0, 0.0), 1.0, stiffness=0.0), "inclusion: got stiffness 0.0"),
        (lambda: Inclusion((0.0, 0.0), 1.0, density=-1.0), "inclusion: got density -1.0"),
        (lambda: Inclusion((0.0, float("nan")), 1.0), "inclusion: got the centre"),
        (lambda: StandingWave(1.0, 1.0, mass_damping=50.0), "it cannot swing"),
    ],
)
def test_settings_are_checked_when_made(make, message):
    with pytest.raises(ShapeError, match=message):
        make()


def test_a_scene_is_told_where_it_is_wrong():
    with pytest.raises(SceneError, match=r"^physics\.tractions\.tip\.size: missing"):
        build(Elastodynamics, {"tractions": {"tip": {"direction": [1.0, 0.0]}}}, "physics")
    with pytest.raises(SceneError, match=r"^physics\.moved\.tip\.axis: got 'x'"):
        build(Elastodynamics, {"moved": {"tip": {"axis": "x", "by": 1.0}}}, "physics")


def test_parameters_are_those_of_the_settings():
    physics = Elastodynamics(
        moved={"base": Motion(0.1, 1)}, tractions={"tip": Traction(5.0)}, body_force=BodyForce(981.0, (0.0, -1.0))
    )
    assert physics.parameters.names == (
        "E", "nu", "density", "mass_damping", "stiffness_damping", "u_base", "t_tip", "f",
    )  # fmt: skip
    assert [p.name for p in physics.parameters.free] == ["E", "nu"]
    assert {p.name: p.unit for p in physics.parameters.parameters}["f"] == "dyn/cm^3"
    assert Elastodynamics(tractions=PULL, log_uniform=("E",)).parameters["E"].distribution == "log_uniform"


def test_what_does_not_fit_the_mesh_is_refused(bar, on):
    made = on(bar())
    with pytest.raises(MeshError, match="elastodynamics: the mesh has no role lid; it has base"):
        Elastodynamics(tractions={"lid": Traction(1.0)}).build(made)
    with pytest.raises(ShapeError, match="held: got axis 2 on base, expected 0 to 1"):
        Elastodynamics(held={"base": (2,)}, tractions=PULL).build(made)
    with pytest.raises(ShapeError, match="moved: got axis 2 on base, expected 0 to 1"):
        Elastodynamics(moved={"base": Motion(1.0, 2)}).build(made)
    with pytest.raises(ShapeError, match="traction on tip: got a direction of 3 numbers, expected 2"):
        Elastodynamics(tractions={"tip": Traction(1.0, (1.0, 0.0, 0.0))}).build(made)
    with pytest.raises(ShapeError, match="body_force: got a direction of 3 numbers"):
        Elastodynamics(body_force=BodyForce(1.0, (1.0, 0.0, 0.0))).build(made)
    with pytest.raises(ShapeError, match="inclusion 0: no cell's centroid lies within"):
        Elastodynamics(tractions=PULL, inclusions=(Inclusion((90.0, 0.0), 0.1, 2.0),)).build(made)
    with pytest.raises(ShapeError, match="moved: every node of side is held or moved by another role"):
        Elastodynamics(moved={"base": Motion(1.0, 0), "side": Motion(1.0, 0)}, held={"tip": (0,)}).build(
            on(bar(cells=1))
        )


@pytest.mark.parametrize(
    ("changes", "cells", "step", "says"),
    [
        ({}, 40, 5e-4, ""),
        ({}, 10, 5e-4, "the shortest shear wave, 1.9 cm, has .* nodes"),
        ({}, 40, 2e-3, "a period has 10 steps"),
        ({"order": 2}, 20, 5e-4, ""),
        ({"inclusions": (Inclusion((1.0, 0.0), 0.9, 0.04),)}, 40, 5e-4, "the shortest shear wave, 0.37 cm"),
        ({"ranges": {"E": (1e5, 1e5), "nu": (0.3, 0.49)}}, 40, 5e-4, "nu goes up to 0.49"),
        ({"courses": {}}, 2, 1.0, ""),
    ],
)  # fmt: skip
def test_what_a_scene_is_warned_of(bar, on, changes, cells, step, says):
    import re

    settings = {
        "tractions": PULL, "courses": {"t_tip": Course("sine", frequency=50.0)},
        "ranges": {"E": (2.5e4, 1e5), "nu": (0.3, 0.44)},
    }  # fmt: skip
    model = Elastodynamics(**(settings | changes)).build(on(bar(2, cells)))
    said = MarchedModel(model, TimeGrid(step, 2)).cautions(model.parameters)
    if says:
        assert re.search(says, " ".join(said))
    else:
        assert said == ()
