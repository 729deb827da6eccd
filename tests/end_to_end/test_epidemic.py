"""The example without a finite element library, from its scene to its report, as it stands."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dacore import open_scene
from dacore.errors import ConvergenceError, SceneError
from dacore.workflow.run import run_scene

SCENE = Path(__file__).resolve().parents[2] / "examples/epidemic/epidemic.toml"


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("epidemic")
    run_scene(SCENE, [], folder, workers=1)
    return folder


@pytest.fixture(scope="module")
def outcomes(out):
    results = json.loads((out / "results.json").read_text())
    return {(each["estimator"], each["noise"]): each for each in results["validation"]}


def test_hidden_fields_are_found_beside_guessing(outcomes):
    """Nobody reports who is immune, and most towns report nothing."""
    found = outcomes["minimum_variance", 0.05]["errors"]
    for field, share in (("new", 0.1), ("infected", 0.35), ("recovered", 0.4)):
        assert found[field]["mean"] < share * found[field]["of_the_training_mean"], field
    # Published for what it is: one linear space for a nonlinear epidemic does not find who is immune.
    plain = outcomes["pbdw", 0.05]["errors"]
    assert plain["infected"]["mean"] < 0.4 * plain["infected"]["of_the_training_mean"]
    assert plain["recovered"]["mean"] > found["recovered"]["mean"]


def test_the_town_that_nobody_observes_is_told_with_an_interval(outcomes):
    for name, inside in (("infected", 0.8), ("immune", 0.7)):
        found = outcomes["minimum_variance", 0.05]["quantities"][name]
        truth, estimate = np.array(found["truth"]), np.array(found["estimate"])
        assert found["rms_error"] < 0.5 * np.std(truth)
        deviation = np.array(found["standard_deviation"])
        assert np.mean(np.abs(estimate - truth) <= 1.645 * deviation) >= inside
    # The peak of the wave, in a town without a doctor: within a fifth of the largest in the median case.
    found = outcomes["minimum_variance", 0.05]["quantities"]["infected"]
    truth, estimate = (np.array(found[key]).max(axis=0) for key in ("truth", "estimate"))
    assert np.median(np.abs(estimate - truth)) < 0.1 * truth.max()


def test_its_report_speaks_of_no_mesh_and_counts_weeks(out):
    text = re.sub(r"<[^>]*>|data:[^\"]*", " ", (out / "report.html").read_text())
    assert "Epidemic in thirty towns" in text
    assert "truth computed by the same model: errors are those of the reconstruction alone" in text
    shown = text.partition("The scene")[0]
    for word in ("mesh", "brain", "nodes", "ventricular", "time scheme"):
        assert not re.search(rf"\b{word}\b", shown), word
    results = json.loads((out / "results.json").read_text())
    assert results["mesh"] is None
    assert results["versions"]["epidemic.py"].startswith("source ")
    assert not any(name.startswith("backend") for name in results["versions"])


def test_what_needs_a_reduced_model_says_so_before_any_work(tmp_path):
    with pytest.raises(SceneError, match="posterior needs the map from parameters to trajectories"):
        open_scene(SCENE, ['estimator.posterior={kind="posterior"}'], tmp_path)
    scene = open_scene(SCENE, ['training.method="reduced"'], tmp_path)
    with pytest.raises(SceneError, match=r"training.method: got 'reduced', .* expected 'full'"):
        scene.runner["checks"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fault_in_its_solve_names_the_line_wherever_it_is_solved(tmp_path, workers):
    text = SCENE.with_suffix(".py").read_text(encoding="utf-8")
    wrong = text.replace("        if not solved.success:", "        _ = {}['absent']\n        if not solved.success:")
    line = wrong[: wrong.index("_ = {}")].count("\n") + 1
    (tmp_path / "epidemic.py").write_text(wrong, encoding="utf-8")
    (tmp_path / "epidemic.toml").write_text(SCENE.read_text(encoding="utf-8"), encoding="utf-8")
    scene = open_scene(tmp_path / "epidemic.toml", ["training.samples=4"], tmp_path / "cache", workers)
    with pytest.raises(ConvergenceError) as told:
        scene.runner["training"]
    assert str(told.value).startswith("sample ")
    assert str(told.value).endswith(f"KeyError: 'absent' (epidemic.py line {line})")
    assert "\n" not in str(told.value)
