"""A run with estimators that claim deviations and find parameters, from few of the cycle's phases."""

import json
from pathlib import Path

import numpy as np
import pytest

from dacore.workflow.canvas import Canvas
from dacore.workflow.open import open_scene
from dacore.workflow.output import quantity_cards, tables
from dacore.workflow.pictures_fields import draw_worst
from dacore.workflow.pictures_parameters import parameter_tables
from dacore.workflow.run import run_scene

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "examples" / "toy" / "ball.toml"
CHANGES = [
    "training.samples=40", "training.sampling='sobol'", "training.method='reduced'", "training.reduction=1e-2",
    "time.steps=8", "validation.cases=3", "validation.refine_time=0", "observed.phases=3",
    "estimator.posterior.kind='posterior'", "estimator.posterior.posterior='laplace'",
]  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("claims")
    run_scene(SCENE, CHANGES, out, workers=1)
    return out, open_scene(SCENE, CHANGES, out / "cache")


@pytest.fixture(scope="module")
def results(finished):
    return json.loads((finished[0] / "results.json").read_text())


def test_results_hold_parameters_misfits_and_what_was_learned(results):
    for each in results["validation"]:
        for quantity in each["quantities"].values():
            claimed, learned = quantity["standard_deviation"][0], quantity["variance_learned"][0]
            assert (claimed[0] is None) == (learned[0] is None)
        assert ("parameters" in each) == (each["estimator"] == "posterior")
        if each["estimator"] == "posterior":
            assert len(each["misfit"]["ratio"]) == len(each["misfit"]["alarm"]) == 3
            for name, found in each["parameters"].items():
                table = results["parameters"][name]
                assert all(table["low"] <= value <= table["high"] for value in found["truth"])
                expected = 1 - (np.array(found["standard_deviation"]) / found["deviation_of_the_prior"]) ** 2
                np.testing.assert_allclose(found["variance_learned"], expected)
    prior = next(each for each in results["validation"] if each["estimator"] == "prior")
    np.testing.assert_allclose(prior["quantities"]["cavity_pressure"]["variance_learned"], 0.0)


def test_report_has_the_sections_and_figures(finished):
    text = (finished[0] / "report.html").read_text(encoding="utf-8")
    assert ">Parameters<" in text
    assert "Do the data contradict the estimators?" in text
    assert "90% interval:" in text
    names = {path.stem for path in (finished[0] / "figures").glob("*.png")}
    assert {"parameters_posterior", "learned_posterior", "worst_p_no_noise"} <= names


def test_fields_are_compared_at_a_step_that_every_estimate_is_of(finished):
    session = finished[1]
    canvas = Canvas(session)
    estimates = [outcome.estimate for outcome in canvas.outcomes(0.1)]
    assert {len(estimate.steps) for estimate in estimates} == {3, 8}
    step = canvas.shown_step(estimates)
    assert all(step in estimate.steps for estimate in estimates)
    truth = session.truth[0].states[:, step]
    best = session.validation.best(["minimum_variance"], 0.1).estimate
    error = np.linalg.norm(canvas.state(best, 0, step) - truth) / np.linalg.norm(truth)
    others = [np.linalg.norm(canvas.state(best, 0, k) - truth) / np.linalg.norm(truth) for k in range(8) if k != step]
    assert error < min(others)


def test_every_row_shows_a_deviation_and_counts_what_it_holds(finished):
    canvas = Canvas(finished[1])
    for drawn in draw_worst(canvas, 0.1):
        rows = drawn.figure.given[1]
        assert "standard deviation" in drawn.caption
        for row in rows:
            assert row.deviation.shape == row.truth.shape
            assert (row.deviation >= 0).all()  # 0 where the neck is held
            assert np.median(row.deviation) > 0
            assert 0.0 <= row.inside <= 1.0
            if row.name != "|u|":
                np.testing.assert_allclose(row.inside, (np.abs(row.error) <= 2 * row.deviation).mean())


def test_deviations_of_points_are_those_of_a_quantity_that_sees_one(finished):
    session = finished[1]
    canvas = Canvas(session)
    view = canvas.view()
    outcome = session.validation.outcome("minimum_variance", 0.1)
    claimed = canvas.deviation(view, outcome.estimate, 1, 5, "p")
    points = canvas.points(view, "p")
    assert points.shape == (claimed.shape[1], session.background.space.n_dofs)
    reduced = session.background.observe(points[:3])
    on_modes = np.zeros((3, 8, session.background.dimension))
    on_modes[:, 5] = reduced
    wanted = outcome.estimate.uncertainty.variance(on_modes, None)[:, 1]
    np.testing.assert_allclose(claimed[0, :3], np.sqrt(wanted), rtol=1e-8)


def test_tables_and_cards_say_what_is_known_of_parameters_data_and_numbers(finished):
    session = finished[1]
    (exact, noisy) = parameter_tables(session)
    assert exact.headers[-1] == noisy.headers[-1] == "variance learned"
    assert [row[0] for row in exact.rows] == [row[0] for row in noisy.rows]
    assert any("not seen" in row[-1].text for row in noisy.rows) or all(row[-1].tone == "" for row in noisy.rows)
    misfits = next(table for table in tables(session) if "contradict" in table.caption)
    assert len(misfits.headers) == 1 + 2 * len(session.scene.noise.levels)
    (card,) = quantity_cards(session.builder, session.model.space, session.validation)
    assert "median case" in card.label
    assert "true: " in card.note
    assert "90% interval: " in card.note
