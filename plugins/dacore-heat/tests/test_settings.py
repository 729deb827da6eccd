"""Settings: what is refused, in one line; which parameters there are; what meets what."""

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Course
from dacore.errors import ConvergenceError, MeshError, SceneError, ShapeError
from dacore.plugins.settings import build
from dacore_heat.model import Heat
from dacore_heat.parts import Exchange, Inclusion, Source

WALL = {"skin": Exchange(1e4, -10.0)}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Heat(order=3), "order: got 3, expected 1 or 2"),
        (lambda: Heat(held={"skin": 1.0}, convection=WALL), "convection: got skin, whose temperature is held"),
        (lambda: Heat(held={"skin": 1.0}, fluxes={"skin": 1.0}), "fluxes: got skin, whose temperature is held"),
        (lambda: Heat(sources={"a b": Source((0.0, 0.0), 1.0, 1.0)}), "sources: got the name 'a b'"),
        (lambda: Heat(courses={"T_core": Course()}), "courses: got T_core, expected any of none"),
        (lambda: Heat(held={"core": 1.0}, courses={"core": Course()}), "courses: got core, expected any of T_core"),
        (lambda: Heat(ranges={"k": (1, 2)}), "heat parameters: got k, expected any of conductivity, perfusion"),
        (lambda: Heat(log_uniform=("initial",)), "heat parameters: got initial"),
        (lambda: Heat(ranges={"conductivity": (0.0, 1.0)}), "conductivity: got 0, expected a number above 0"),
        (lambda: Heat(ranges={"perfusion": (-1e-3, 1.0)}), "perfusion: got -0.001, expected a number of at least 0"),
        (lambda: Heat(convection=WALL, ranges={"h_skin": (-1.0, 1.0)}), "h_skin: got -1, expected a number of at le"),
        (lambda: Heat(ranges={"conductivity": (2.0, 1.0)}), "low <= high"),
        (lambda: Heat(log_uniform=("arterial",)), "arterial: log_uniform needs low > 0"),
        (lambda: Exchange(-1.0, 0.0), "convection: got h -1.0"),
        (lambda: Exchange(1.0, np.inf), "convection: got ambient inf"),
        (lambda: Source((0.0, np.nan), 1.0, 1.0), r"source: got the centre \[0.0, nan\]"),
        (lambda: Source((0.0, 0.0), 0.0, 1.0), "source: got width 0.0"),
        (lambda: Source((0.0, 0.0), 1.0, np.inf), "source: got power inf"),
        (lambda: Inclusion((0.0, 0.0), 0.0), "inclusion: got radius 0.0"),
        (lambda: Inclusion((0.0, 0.0), 1.0, conductivity=0.0), "inclusion: got conductivity 0.0"),
        (lambda: Inclusion((0.0, 0.0), 1.0, perfusion=-1.0), "inclusion: got perfusion -1.0"),
        (lambda: Inclusion((0.0, np.inf), 1.0), "inclusion: got the centre"),
    ],
)
def test_settings_are_checked_when_made(make, message):
    with pytest.raises(ShapeError, match=message):
        make()


def test_a_scene_is_told_where_it_is_wrong():
    with pytest.raises(SceneError, match=r"^physics\.convection\.skin\.ambient: missing"):
        build(Heat, {"convection": {"skin": {"h": 1e4}}}, "physics")
    with pytest.raises(SceneError, match=r"^physics\.courses\.T_core\.kind: got 'sinus'"):
        build(Heat, {"held": {"core": 1.0}, "courses": {"T_core": {"kind": "sinus"}}}, "physics")
    with pytest.raises(SceneError, match="course ramp: duration is missing"):
        build(Heat, {"held": {"core": 1.0}, "courses": {"T_core": {"kind": "ramp"}}}, "physics")


def test_parameters_are_those_of_the_settings():
    physics = Heat(
        held={"core": 1.0}, fluxes={"side": 2.0}, convection=WALL, sources={"p": Source((0.0,) * 2, 1.0, 3.0)}
    )
    assert physics.parameters.names == (
        "conductivity", "perfusion", "capacity", "blood_capacity", "arterial", "T_core", "q_side", "h_skin",
        "ambient_skin", "P_p",
    )  # fmt: skip
    assert [p.name for p in physics.parameters.free] == ["conductivity", "perfusion"]
    assert "initial" in Heat(initial=0.0, log_uniform=("perfusion",)).parameters.names
    assert Heat(log_uniform=("perfusion",)).parameters["perfusion"].distribution == "log_uniform"


def test_units_are_known_to_pint():
    import pint

    registry = pint.UnitRegistry()
    physics = Heat(fluxes={"side": 2.0}, convection=WALL, sources={"p": Source((0.0,) * 2, 1.0, 3.0)})
    units = {p.name: p.unit for p in physics.parameters.parameters}
    assert registry.Quantity(0.5, "W/m/K").to(units["conductivity"]).m == pytest.approx(5e4)
    assert registry.Quantity(10.0, "W/m^2/K").to(units["h_skin"]).m == pytest.approx(1e4)
    assert registry.Quantity(1.0, "W").to(units["P_p"]).m == pytest.approx(1e7)
    assert registry.Quantity(1.0, "W/m^2").to(units["q_side"]).m == pytest.approx(1e3)
    assert registry.Quantity(3.8, "MJ/m^3/K").to(units["capacity"]).m == pytest.approx(3.8e7)


def test_what_does_not_fit_the_mesh_is_refused(slab, on):
    with pytest.raises(MeshError, match="heat: the mesh has no role lid; it has core"):
        Heat(held={"lid": 1.0}).build(on(slab()))
    with pytest.raises(ShapeError, match="a centre of 3 coordinates, expected 2"):
        Heat(sources={"p": Source((0.0,) * 3, 1.0, 1.0)}).build(on(slab()))
    with pytest.raises(ShapeError, match="nowhere near the mesh"):
        Heat(sources={"p": Source((90.0, 0.0), 0.1, 1.0)}).build(on(slab()))
    with pytest.raises(ShapeError, match="inclusion 0: no cell's centroid lies within"):
        Heat(inclusions=(Inclusion((90.0, 0.0), 0.1, 2.0),)).build(on(slab()))
    with pytest.raises(ShapeError, match="inclusion 0: got a centre of 3"):
        Heat(inclusions=(Inclusion((0.0,) * 3, 9.0, 2.0),)).build(on(slab()))


def test_where_two_roles_meet_the_first_named_counts(slab, on):
    mesh = slab(2, 6, across=6)
    both = np.intersect1d(mesh.boundary_nodes("side"), mesh.boundary_nodes("skin"))
    assert both.size == 2
    for held in ({"side": 3.0, "skin": 1.0}, {"skin": 1.0, "side": 3.0}):
        model = Heat(held=held).build(on(mesh))
        states = MarchedModel(model, TimeGrid(5.0, 2)).solve(model.parameters.middle).states
        first, second = held
        assert np.all(states[mesh.boundary_nodes(first)] == held[first])
        assert np.all(states[np.setdiff1d(mesh.boundary_nodes(second), both)] == held[second])


def test_starts(slab, on):
    """Steady needs something that holds a temperature, and excludes an initial one."""
    ranges = {"perfusion": (0.0, 0.0)}
    loose = Heat(fluxes={"skin": 1.0}, ranges=ranges).build(on(slab()))
    with pytest.raises(ConvergenceError, match="T is held nowhere"):
        MarchedModel(loose, TimeGrid(1.0, 1), start="steady").solve(loose.parameters.middle)
    both = Heat(convection=WALL, initial=0.0).build(on(slab()))
    with pytest.raises(ShapeError, match="start: got 'steady' and the initial state of initial"):
        MarchedModel(both, TimeGrid(1.0, 1), start="steady")
    model = Heat(convection=WALL, ranges=ranges).build(on(slab()))
    steady = MarchedModel(model, TimeGrid(1.0, 2), start="steady").solve(model.parameters.middle).states
    np.testing.assert_allclose(steady, -10.0, rtol=1e-8)
