"""Studies from a scene to the report: sections, tables of them all, numbers, workers, and a stranger's study."""

import json
import re
from importlib.metadata import EntryPoint, entry_points

import pytest

from dacore.errors import SceneError
from dacore.plugins.registry import load
from dacore.workflow import build
from dacore.workflow.run import plan_scene, run_scene
from tests.end_to_end.test_no_mesh import SCENE as RING
from tests.study_scenes import SCENE

STUDIES = """
[[report.published]]
what = "pressure of the whole"
value = "< 5%"
error = "p"
noise = 0.1

[[report.published]]
what = "largest error of the cavity's pressure"
value = "370"
quantity = "cavity_pressure"
statistic = "worst"

[study.data]
kind = "variants"
title = "Amount of data"
about = "Fewer phases of the same."
settings = [{ label = "two phases", set = { "observed.phases" = 2 } }]

[study.wrong]
kind = "mismatch"
truths = [{ label = "moved neck", set = { "physics.neck_displacement" = 1e-4 } }]

[study.patients]
kind = "cohort"
quantity = "cavity_pressure"
groups = [
    { name = "normal", patients = 3, ranges = { p_ventricles = [1e4, 1.02e4] } },
    { name = "raised", patients = 3, ranges = { p_ventricles = [1.08e4, 1.1e4] } },
]

[study.weights]
kind = "weights"
estimator = "pbdw"
field = "p"
count = 3

[study.dimension]
kind = "dimension"
estimator = "pbdw"
largest = 6

[study.places]
kind = "placement"
observation = "slice"
quantity = "cavity_pressure"
positions = [3.5, 5.0, 6.5]
picks = 2
n = 3
random = 2
points = 2
"""
NAMES = ("data", "wrong", "patients", "weights", "dimension", "places")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("studies") / "studied.toml"
    path.write_text(SCENE + STUDIES, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def finished(path):
    out = path.parent / "one"
    return out, run_scene(path, [], out, workers=1)


@pytest.fixture(scope="module")
def results(finished):
    return json.loads((finished[0] / "results.json").read_text(encoding="utf-8"))


def test_every_study_has_its_numbers_in_the_results(results):
    assert tuple(results["studies"]) == NAMES
    one = results["studies"]["data"]
    assert one["kind"] == "variants"
    assert one["settings"]["settings"][0]["label"] == "two phases"
    for e, name in enumerate(one["facts"]["estimators"]):
        for k, level in enumerate(one["facts"]["levels"]):
            outcome = next(
                each for each in results["validation"]
                if each["estimator"] == name and (name == "prior" or each["noise"] == level)
            )  # fmt: skip
            means = [outcome["errors"][label]["mean"] for label in one["facts"]["errors"]]
            assert one["arrays"]["mean"][0][e][k] == means
    # What an estimator does not tell is null, not NaN.
    assert one["arrays"]["alarms"][0][0] == [None, None]


def test_every_study_has_a_section_with_its_figures(finished):
    text = (finished[0] / "report.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h2>(.*?)<", text)
    titles = ["Amount of data", "Model mismatch", "Synthetic patients", "The weight between the fields",
              "Dimension of the background space", "Where to measure"]  # fmt: skip
    assert [each for each in headings if each in titles] == titles
    assert "Fewer phases of the same." in text
    figures = {each.stem for each in (finished[0] / "figures").glob("study_*.png")}
    for name in NAMES:
        if name != "wrong":  # One truth makes no curve.
            assert any(each.startswith(f"study_{name}_") for each in figures), name
    assert {"study_data_no_noise", "study_data_noise_10", "study_dimension_dimension"} <= figures
    assert all(each.stat().st_size > 5_000 for each in (finished[0] / "figures").glob("study_*.png"))


def test_the_table_of_all_studies_has_every_setting(finished):
    _, done = finished
    table = next(each for each in done.tables if each.headers[0] == "study" and "mean" in each.caption)
    settings = {row[1] if isinstance(row[1], str) else row[1].text for row in table.rows}
    asked = ("this scene", "two phases", "moved neck", "the estimator's own model", "3 normal + 3 raised")
    expected = {f"{what}, {noise}" for what in asked for noise in ("no noise", "10% noise")}
    assert expected <= settings


def test_published_figures_stand_beside_those_of_every_estimator(finished, results):
    text = (finished[0] / "report.html").read_text(encoding="utf-8")
    assert "pressure of the whole" in text
    assert "&lt; 5%" in text
    table = next(each for each in finished[1].tables if each.caption == "Beside what was published")
    mv = next(each for each in results["validation"] if each["estimator"] == "mv" and each["noise"] == 0.0)
    largest = mv["quantities"]["cavity_pressure"]["largest_error"]
    shown = [cell if isinstance(cell, str) else cell.text for cell in table.rows[1]]
    assert float(shown[-1].replace(",", "").split()[0]) == pytest.approx(largest, rel=0.05)


def test_two_workers_find_the_same_bit_for_bit(path, finished, results):
    out = path.parent / "two"
    run_scene(path, [], out, workers=2)
    other = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert other["studies"] == results["studies"]


def test_a_second_run_computes_no_study_and_draws_the_same(path, finished, results):
    out, _ = finished
    figures = {each.name: each.read_bytes() for each in (out / "figures").glob("study_*.png")}
    rows = {row.name: row.status for row in plan_scene(path, [], out)}
    assert {rows[f"study.{name}"] for name in NAMES} == {"cached"}
    run_scene(path, [], out, workers=2)
    again = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert {again["stages"][f"study.{name}"] for name in NAMES} == {"cached"}
    assert again["studies"] == results["studies"]
    assert {each.name: each.read_bytes() for each in (out / "figures").glob("study_*.png")} == figures


def test_two_studies_of_one_kind_do_not_draw_over_each_other(path):
    out = path.parent / "twice"
    more = path.parent / "twice.toml"
    study = '[study.{}]\nkind = "dimension"\nestimator = "pbdw"\nlargest = {}\n'
    more.write_text(f"{SCENE}\n{study.format('short', 4)}\n{study.format('long', 6)}", encoding="utf-8")
    run_scene(more, [], out, cache=path.parent / "one/cache", workers=1)
    figures = {each.stem for each in (out / "figures").glob("study_*.png")}
    assert figures == {"study_short_dimension", "study_long_dimension"}


@pytest.fixture
def ring(tmp_path, monkeypatch):
    """A scene of a stranger's model, with a stranger's studies."""
    strangers = [
        EntryPoint("tanks", "tests.graph_plugin", "dacore"),
        EntryPoint("ends", "tests.study_plugin", "dacore"),
    ]
    monkeypatch.setattr(build, "load", lambda: load([*entry_points(group="dacore"), *strangers]))
    path = tmp_path / "ring.toml"
    path.write_text(RING, encoding="utf-8")
    return path


def test_a_study_written_by_a_stranger_is_a_section_of_the_report(ring, tmp_path):
    study = '\n[study.ends]\nkind = "extremes"\ntitle = "From here to there"\nquantity = "far"\n'
    ring.write_text(RING + study, encoding="utf-8")
    out = tmp_path / "out"
    done = run_scene(ring, [], out, workers=1)
    found = json.loads((out / "results.json").read_text(encoding="utf-8"))
    truth = next(each for each in found["validation"] if each["estimator"] == "mv")["quantities"]["far"]["truth"]
    ends = found["studies"]["ends"]["arrays"]["ends"]
    assert ends[0][:2] == [min(map(min, truth)), max(map(max, truth))]
    # The same unseen cases, another training set.
    assert ends[1][:2] == ends[0][:2]
    assert ends[1][2] != ends[0][2]
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "From here to there" in text
    assert "What a stranger asked." in text
    assert re.search(r"<t[dh][^>]*>fewer</t[dh]>", text)
    # Its score is in the table of all studies.
    assert any(each.headers[:2] == ["study", "setting"] and each.rows[0][1] == "all" for each in done.tables)


@pytest.mark.parametrize(
    ("study", "message"),
    [
        ('kind = "extremes"\nquantity = "near"', r"study.s: quantity: got 'near', expected one of far$"),
        ('kind = "extremes"', r"study.s.quantity: missing; expected text"),
        ('kind = "extremes"\nquantity = "far"\nsample = 3', r"study.s.sample: unknown key; did you mean 'samples'\?"),
        ('kind = "extremes"\nquantity = "far"\nsamples = 1', r"study.s: fewer: training.samples: got 1, expected"),
        (
            'kind = "faulty"',
            r"study.s: its plugin failed \(ZeroDivisionError: by nobody\); dacore --debug shows where$",
        ),
    ],
)
def test_what_a_stranger_gets_wrong_is_said_in_one_line(ring, tmp_path, study, message):
    ring.write_text(f"{RING}\n[study.s]\n{study}\n", encoding="utf-8")
    with pytest.raises(SceneError, match=message) as caught:
        run_scene(ring, [], tmp_path / "out", workers=1)
    assert "\n" not in str(caught.value)
