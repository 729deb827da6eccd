"""Scenes of heat and of waves: what the toolkit does for one field, for two, for whatever a plugin solves."""

import json
import re
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from dacore import open_scene
from dacore.plugins.registry import load
from dacore.workflow.comparison.run import compare
from dacore.workflow.comparison.variants import Axis
from dacore.workflow.run import run_scene

ROOT = Path(__file__).resolve().parents[2]
# Scene, changes that make it small, its field, its unit, a quantity that no sensor touches.
SCENES = {
    "heat/applicator": (["domain.divisions=[4,4,6]", "time.steps=10", "training.samples=16"], "T", "K", "plate"),
    "heat/probe": (["domain.divisions=[12,8]", "time.steps=10", "training.samples=16"], "T", "K", "skin"),
    "waves/gel": (["domain.divisions=[6,4,4]", "time.steps=30", "training.samples=16"], "u", "cm", "knocked_side"),
    "waves/layer": (["domain.divisions=[12,6]", "time.steps=30", "training.samples=24"], "u", "cm", "plate"),
}


@pytest.fixture(scope="module", params=SCENES)
def finished(request, tmp_path_factory):
    changes, field, unit, quantity = SCENES[request.param]
    out = tmp_path_factory.mktemp("run")
    run_scene(ROOT / "examples" / f"{request.param}.toml", [*changes, "validation.cases=4"], out, workers=1)
    return out, field, unit, quantity


def outcome(results, estimator, noise):
    return next(o for o in results["validation"] if o["estimator"] == estimator and o["noise"] == noise)


def test_state_and_hidden_number_are_found_far_better_than_by_guessing(finished):
    out, field, _, quantity = finished
    results = json.loads((out / "results.json").read_text())
    names = {o["estimator"] for o in results["validation"]} - {"prior"}
    assert {"pbdw", "minimum_variance"} <= names
    guess = outcome(results, "prior", 0.0)
    for name in names:
        assert outcome(results, name, 0.0)["errors"][field]["mean"] < 0.8 * guess["errors"][field]["mean"], name
    for name in names - {"pbdw"}:
        level = max(o["noise"] for o in results["validation"])
        for noise, factor in ((0.0, 0.1), (level, 0.9)):
            found = outcome(results, name, noise)
            assert found["errors"][field]["mean"] < factor * guess["errors"][field]["mean"], (name, noise)
            of_guess = guess["quantities"][quantity]["rms_error"]
            assert found["quantities"][quantity]["rms_error"] < factor * of_guess, (name, noise)


def test_report_and_fields_are_of_this_physics_alone(finished):
    out, field, unit, _ = finished
    report = re.sub(r"base64,[A-Za-z0-9+/=]+", "", (out / "report.html").read_text())
    foreign = ("ventric", "csf", *(("dyn/cm", "pressure", "displacement") if field == "T" else ()))
    assert [word for word in foreign if word in report] == []
    assert (out / "figures" / f"worst_{field}_no_noise.png").exists()
    assert unit in report
    modes = meshio.read(out / "fields" / "modes.vtu")
    assert all(name.startswith(field) or field in name for name in modes.point_data), sorted(modes.point_data)
    kept = next((out / "fields").glob("worst_case_no_noise.h5"))
    with h5py.File(kept) as file:
        arrays = []
        file.visititems(lambda name, item: arrays.append(item[()]) if isinstance(item, h5py.Dataset) else None)
    assert arrays
    assert all(np.isfinite(each).all() for each in arrays if each.dtype.kind == "f")


def test_every_scene_is_planned_without_work(tmp_path):
    from typer.testing import CliRunner

    from dacore.cli.main import app

    for name in SCENES:
        done = CliRunner().invoke(app, ["plan", str(ROOT / "examples" / f"{name}.toml"), "--out", str(tmp_path)])
        assert done.exit_code == 0, done.output
        assert "judged" in done.output


def test_full_and_reduced_training_agree(tmp_path):
    """An initial temperature, fluxes and exchanges whose amplitudes vary beside the material."""
    changes, *_ = SCENES["heat/applicator"]
    text = (ROOT / "examples/heat/applicator.toml").read_text()
    text = re.sub(r"\[estimator\.posterior\]\n(?:\S.*\n)*", "", text)  # which asks for a reduced model
    scenes = []
    for name, made in (("reduced", text), ("full", text.replace('method = "reduced"\nreduction = 1e-3\n', ""))):
        file = tmp_path / f"{name}.toml"
        file.write_text(made)
        scenes.append(open_scene(file, [*changes, "training.tolerance=1e-10"], cache=tmp_path / name))
    assert [scene.scene.training.method for scene in scenes] == ["reduced", "full"]
    truth = scenes[0].truth[0]
    data = scenes[0].functionals(truth.states)
    one, other = (
        scene.prepared("minimum_variance").estimate(data[:, :, None], noise_scale=0.05).state() for scene in scenes
    )
    assert np.abs(one - other).max() < 5e-3 * np.abs(one).max()


def test_libraries_are_compared_on_reduced_training_too(tmp_path):
    """What is solved in full counts as solved; the others are marched by the reduced model."""
    changes = (*SCENES["heat/applicator"][0], "validation.cases=2")
    scene = ROOT / "examples/heat/applicator.toml"
    ready = [row.name for row in load().table() if row.kind == "backend" and row.status == "ready"]
    done = compare(scene, [Axis("backends", tuple(ready))], changes, tmp_path, rounds=1, workers=1)
    for variant in done.variants:
        assert variant.error == ""
        assert variant.facts["trajectories"]["of"] == 18
        assert 10 <= variant.facts["trajectories"]["solved"] < 18
        if variant.agreement is not None:
            groups = variant.agreement.groups()
            assert max(groups[name] for name in ("matrices", "loads", "functionals")) < 1e-12
            assert groups["trajectory"] < 1e-8
