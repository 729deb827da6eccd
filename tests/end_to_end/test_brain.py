"""The scenes of the brain: all are valid, the demo runs at a small size, and at full size it reaches its figures."""

import json
from pathlib import Path

import pytest

from dacore import open_scene
from dacore.workflow.run import plan_scene, run_scene

BRAIN = Path(__file__).resolve().parents[2] / "examples" / "brain"
SMALL = ["training.samples=8", "time.steps=5", "validation.cases=2", "validation.refine_time=0"]


@pytest.mark.parametrize("path", sorted(BRAIN.glob("*.toml")), ids=lambda path: path.stem)
def test_every_scene_of_the_brain_plans(path, tmp_path):
    names = [row.name for row in plan_scene(path, [], tmp_path)]
    assert names[0] == "domain"
    assert not list(tmp_path.iterdir())


def test_the_demo_at_a_small_size(tmp_path):
    changes = [*SMALL, "estimator.pbdw_per_phase.n=3"]
    run_scene(BRAIN / "demo.toml", changes, tmp_path, workers=2)
    results = json.loads((tmp_path / "results.json").read_text())
    assert 4500 < results["mesh"]["nodes"] < 5500
    assert results["mesh"]["extent_cm"][1] == pytest.approx(16.86, abs=0.05)
    assert 430 < results["observation"]["functionals"] < 470
    assert (tmp_path / "report.html").stat().st_size > 500_000


def test_the_published_protocol_is_the_published_one():
    scene = open_scene(BRAIN / "as-published.toml", workers=1)
    model = scene.builder.physics
    assert (model.frequency, model.xi, model.pressure_on_neck) == (25.0, -1e3, "csf")
    time = scene.scene.time
    assert (time.step, time.steps, time.spin_up) == (1e-3, 40, 120)
    assert time.step * time.steps * model.frequency == pytest.approx(1.0)


@pytest.mark.slow
def test_the_demo_reaches_its_figures(tmp_path):
    """The figures of the README and of docs/results.md, with room for another machine's rounding."""
    run_scene(BRAIN / "demo.toml", [], tmp_path, workers=2)
    results = json.loads((tmp_path / "results.json").read_text())

    def error(estimator, noise, label):
        (found,) = [o for o in results["validation"] if o["estimator"] == estimator and o["noise"] == noise]
        return found["errors"][label]["mean"]

    assert error("prior", 0.0, "p") == pytest.approx(0.018, rel=0.1)
    assert error("pbdw_per_phase", 0.0, "p") < 1e-3
    assert error("minimum_variance", 0.0, "p") < 8e-4
    assert error("minimum_variance", 0.0, "p − p_csf") < 0.015
    assert error("minimum_variance", 0.1, "p") < 6e-3
    assert error("minimum_variance", 0.1, "p − p_csf") < 0.13
    assert error("pbdw_one_space", 0.0, "p") > 0.1
    assert 30 <= results["estimators"]["pbdw_one_space"]["n"][0] <= 45
