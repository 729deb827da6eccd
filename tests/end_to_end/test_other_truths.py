"""Truths that are not of the estimator's model: each is a change of a scene, and its states reach the scene's space."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dacore
from dacore.studies.errors import ErrorMeter
from dacore.studies.transfer import interpolation

BALL = Path(__file__).resolve().parents[2] / "examples/toy/ball.toml"
SHORT = "time.steps=6"

OTHER = {
    "Skempton's coefficient": ("physics.skempton=0.95",),
    "Biot-Willis": ("physics.alpha=0.95",),
    "density": ("physics.density=1.05",),
    "viscosity": ("physics.viscosity=0.02",),
    "traction": ("physics.xi=-600.0",),
    "frequency": ("physics.frequency=45.0",),
    "neck moved": ("physics.neck_displacement=1e-3",),
    "neck moved up": ("physics.neck_displacement=1e-3", "physics.neck_direction=[0, 0, 1]"),
    "neck height": ("domain.neck_height=2.0",),
    "pressure on the neck": ("physics.pressure_on_neck=csf",),
    "stiff ball": ("physics.inclusions=[{centre=[2.5, 0.0, 6.0], radius=1.5, stiffness=2.0}]",),
    "stabilization": ("physics.stabilization=projected",),
    "shorter steps": ("time.substeps=4",),
    "graded first step": ("time.graded=3",),
    "undamped Newmark": ("time.beta=0.25", "time.gamma=0.5"),
    "other rates": ("time.first_order=newmark",),
    "generalised alpha": ("time.scheme=generalized_alpha",),
    "steady start": ("time.start=steady",),
    "Taylor-Hood": ("physics.displacement_order=2",),
    "finer mesh": ("domain.edge=1.2",),
    "other cavity": ("domain.cavity_radius=1.6",),
}
MOVES_THE_MESH = {"finer mesh", "other cavity"}


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Model of the ball after changes, and its trajectory in the middle of the parameters."""
    folder = tmp_path_factory.mktemp("cache")

    @cache
    def make(changes=()):
        model = dacore.open_scene(BALL, [SHORT, *changes], cache=folder).model
        return model, model.solve(model.parameters.middle).states

    return make


@pytest.mark.parametrize("name", OTHER)
def test_is_a_change_of_a_scene(solved, name):
    base, ours = solved()
    other, states = solved(OTHER[name])
    np.testing.assert_allclose(other.times, base.times, rtol=1e-12)
    there, back = interpolation(other.space, base.space), interpolation(base.space, other.space)
    assert (there.outside > 0 or back.outside > 0) == (name in MOVES_THE_MESH)
    assert max(there.distance, back.distance) < 0.3
    meter = ErrorMeter(base.space, "l2", (), {"u": 1.0, "p": 1.0})
    truth = there(states)
    for label, (gap, size) in meter.errors(truth - ours, meter.reference(truth)).items():
        share = np.sqrt((gap**2).sum() / (size**2).sum())
        assert 1e-5 < share < 1.5, (label, share)


def test_nothing_changes_where_nothing_is_changed(solved):
    base, ours = solved()
    again, states = solved(("physics.skempton=0.99",))
    np.testing.assert_array_equal(interpolation(again.space, base.space)(states), ours)
