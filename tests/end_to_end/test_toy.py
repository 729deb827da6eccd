"""The whole demo at toy size: from a scene to results, figures, fields and a report."""

import json
from html.parser import HTMLParser
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from dacore.workflow.run import run_scene

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "examples" / "toy" / "ball.toml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("toy")
    return out, run_scene(SCENE, ["training.samples=14", "time.steps=10", "validation.cases=4"], out, workers=1)


@pytest.fixture(scope="module")
def results(finished):
    return json.loads((finished[0] / "results.json").read_text())


def outcome(results, estimator, noise):
    return next(o for o in results["validation"] if o["estimator"] == estimator and o["noise"] == noise)


def test_unmeasured_pressure_is_recovered_far_better_than_by_guessing(results):
    for name, factor in (("pbdw_per_phase", 3), ("minimum_variance", 5)):
        error = outcome(results, name, 0.0)["errors"]["p − p_csf"]
        assert error["mean"] < error["of_the_training_mean"] / factor
    noisy = outcome(results, "minimum_variance", 0.1)["errors"]["p − p_csf"]
    assert noisy["mean"] < 0.6 * noisy["of_the_training_mean"]


def test_every_error_stands_beside_the_error_of_guessing(results):
    prior = outcome(results, "prior", 0.0)
    for each in results["validation"]:
        for label, error in each["errors"].items():
            assert error["of_the_training_mean"] == prior["errors"][label]["mean"]
            assert error["worst"] >= error["mean"] > 0
            assert len(error["cases"]) == 4


def test_quantity_has_truth_estimate_and_deviation(results):
    q = outcome(results, "minimum_variance", 0.1)["quantities"]["cavity_pressure"]
    assert q["rms_error"] < q["rms_error_of_the_training_mean"]
    assert all(1e4 <= value <= 1.1e4 for value in q["truth"][0])
    assert all(0 < value < 1e3 for value in q["standard_deviation"][0])


def test_results_say_where_they_come_from(results):
    assert "same mesh" in results["reference"]
    assert results["seeds"] == {"training": 1, "validation": 2, "noise": 3}
    assert {"dacore", "dacore-biot", "numpy", "python"} <= set(results["versions"])
    assert {"domain", "model", "training", "background", "validation", "total"} <= set(results["timings"])
    assert results["peak_memory_mib"]["main"] > 10
    assert results["discretisation_error_in_time"]["relative_difference"]["p"] > 0.01
    assert results["scene"]["training"]["samples"] == 14


def test_what_to_beware_of_is_in_results_and_report(finished, results):
    (caution,) = results["cautions"]
    assert "set physics.stabilization" in caution
    report = (finished[0] / "report.html").read_text(encoding="utf-8")
    assert "<strong>Beware:</strong> pressure may oscillate" in report


def test_figures_are_there_and_not_empty(finished):
    names = {path.stem for path in (finished[0] / "figures").glob("*.png")}
    expected = {
        "singular_values", "inf_sup", "bound", "modes", "measured_slice", "errors_no_noise", "errors_noise_10",
        "summary", "worst_u_no_noise", "worst_p_no_noise", "worst_p_noise_10", "quantity_cavity_pressure", "hero",
    }  # fmt: skip
    assert expected <= names
    assert all(path.stat().st_size > 10_000 for path in (finished[0] / "figures").glob("*.png"))


def test_fields_open_in_meshio_and_agree_with_the_errors(finished, results):
    path = finished[0] / "fields" / "worst_case_no_noise.xdmf"
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
        assert reader.num_steps == 10
        time, data, _ = reader.read_data(9)
    assert np.isclose(time, 10 * 5e-4)
    assert points.shape[1] == 3
    assert cells[0].type == "tetra"
    assert np.allclose(data["difference_p"], data["estimate_p"] - data["truth_p"], atol=2e-2)
    assert data["truth_u"].shape == points.shape
    with h5py.File(path.with_suffix(".h5")) as file:
        assert len(file["truth_p"]) == 10
    modes = meshio.read(finished[0] / "fields" / "modes.vtu")
    assert modes.point_data["mode1_u"].shape == points.shape


def test_report_is_one_self_contained_page(finished):
    text = (finished[0] / "report.html").read_text(encoding="utf-8")

    found = []

    class Sources(HTMLParser):
        def handle_starttag(self, tag, attrs):
            found.extend(value for name, value in attrs if name in ("src", "href") and value)

    Sources().feed(text)
    assert found
    assert all(source.startswith(("data:", "#")) for source in found)
    assert "guessing the training mean" in text
    assert "training.samples=14" in text


def test_same_seeds_give_the_same_numbers(finished, results, tmp_path):
    again = tmp_path / "again"
    run_scene(SCENE, ["training.samples=14", "time.steps=10", "validation.cases=4"], again, workers=2)
    repeated = json.loads((again / "results.json").read_text())
    for one, other in zip(results["validation"], repeated["validation"], strict=True):
        for label in one["errors"]:
            assert np.allclose(one["errors"][label]["cases"], other["errors"][label]["cases"], rtol=1e-6)
