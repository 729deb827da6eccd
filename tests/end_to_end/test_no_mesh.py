"""A model of its own kind runs from a scene: no mesh, no backend, one field, a plugin nobody here ships."""

import json
from importlib.metadata import EntryPoint, entry_points

import numpy as np
import pytest

from dacore.errors import SceneError
from dacore.plugins.registry import load
from dacore.workflow import build
from dacore.workflow.run import run_scene

SCENE = """
title = "Ring of tanks"
[physics]
kind = "ring"
[training]
samples = 12
[observation.some]
kind = "thermometers"
[quantity.far]
kind = "tank"
[noise]
levels = [0.0, 0.01]
[estimator.pbdw]
kind = "pbdw"
n = 2
[estimator.mv]
kind = "minimum_variance"
[validation]
cases = 4
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    points = [*entry_points(group="dacore"), EntryPoint("tanks", "tests.graph_plugin", "dacore")]
    monkeypatch.setattr(build, "load", lambda: load(points))
    path = tmp_path / "ring.toml"
    path.write_text(SCENE)
    return path


def test_a_model_without_a_mesh_runs_to_its_report(scene, tmp_path):
    out = tmp_path / "out"
    run_scene(scene, ["estimator.pbdw.centring='none'", "estimator.pbdw.spaces='cycle'"], out, workers=1)
    results = json.loads((out / "results.json").read_text())
    assert results["mesh"] is None
    best = next(o for o in results["validation"] if o["estimator"] == "mv" and o["noise"] == 0.0)
    assert best["errors"]["T"]["mean"] < 0.2 * best["errors"]["T"]["of_the_training_mean"]
    # The field is zero at the first steps: no relative error there, and none invented.
    assert best["errors"]["T"]["mean_over_steps"] is not None
    # One number for each step: all of them are judged.
    truth = np.array(best["quantities"]["far"]["truth"])
    assert truth.shape == (8, 4)
    estimate = np.array(best["quantities"]["far"]["estimate"])
    assert np.isclose(best["quantities"]["far"]["rms_error"], np.sqrt(np.mean((truth - estimate) ** 2)))
    text = (out / "report.html").read_text()
    assert "brain" not in text
    assert not (out / "fields").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("physics.kind='biot'", r"\[domain\]: missing; biot needs one"),
        ("time={step=0.1}", "ring steps by itself"),
        ("validation.refine_time=2", "steps by itself"),
        ("observation.some.kind='points'", "PointSensors|observation.some"),
        ("estimator.pbdw.n=40", "estimator.pbdw: n: got 40"),
        ("validation.contrasts=[{field='q', minus='rate'}]", "validation.contrasts: field 'q'"),
        ("validation.contrasts=[{field='T', minus='rate'}]", "rate varies"),
        ("parameters.speed=3.0", "parameters: parameter 'speed'"),
    ],
)
def test_what_does_not_fit_is_said_before_training(scene, tmp_path, change, message):
    out = tmp_path / "out"
    with pytest.raises(SceneError, match=message):
        run_scene(scene, [change], out, workers=1)
    assert not list(out.glob("cache/training*/*.h5"))


def test_reduced_training_of_a_model_of_its_own_kind_is_refused(scene, tmp_path):
    with pytest.raises(SceneError, match=r"training.method: got 'reduced', .* expected 'full'"):
        run_scene(scene, ['training.method="reduced"'], tmp_path / "out")
