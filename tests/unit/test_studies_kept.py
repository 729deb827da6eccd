"""Findings are kept: what makes them anew and what does not, damage, interruption, one clear line for a mistake."""

import re

import h5py
import numpy as np
import pytest

from dacore import open_scene
from dacore.errors import DacoreError, SceneError, StoreError
from dacore.workflow.canvas import Canvas
from dacore.workflow.studies import cohort, variants
from dacore.workflow.studies.stage import _read, _write
from dacore.workflow.studies.study import Findings
from tests.study_scenes import SCENE, counted, found, opened

STUDIES = """
[study.data]
kind = "variants"
settings = [{ label = "two phases", set = { "observed.phases" = 2 } }]

[study.patients]
kind = "cohort"
quantity = "cavity_pressure"
groups = [{ name = "all", patients = 4 }]

[study.wrong]
kind = "mismatch"
truths = [{ label = "neck", set = { "physics.neck_displacement" = 1e-4 } }]
"""
NAMES = ("data", "patients", "wrong")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder whose cache has everything."""
    path = tmp_path_factory.mktemp("kept")
    session = opened(path, STUDIES)
    for name in NAMES:
        found(session, name)
    return path


def made(session):
    """What state each study's result is in after it was asked for."""
    for name in NAMES:
        found(session, name)
    return {name: session.runner.states[f"study.{name}"] for name in NAMES}


def test_a_second_run_reads_every_study_and_nothing_else(folder, monkeypatch):
    counts = counted(monkeypatch)
    session = opened(folder, STUDIES)
    assert made(session) == dict.fromkeys(NAMES, "cached")
    assert set(session.runner.states) == {f"study.{name}" for name in NAMES}
    assert counts == {}


def test_what_is_read_is_what_was_found(folder):
    one, other = opened(folder, STUDIES, fresh=["study.patients"]), opened(folder, STUDIES)
    for name in NAMES:
        made_, read = found(one, name), found(other, name)
        assert read.facts == made_.facts
        assert read.arrays.keys() == made_.arrays.keys()
        for key, values in made_.arrays.items():
            np.testing.assert_array_equal(read.arrays[key], values)


@pytest.mark.parametrize(
    ("old", "new", "again"),
    [
        ("patients = 4", "patients = 5", {"patients"}),
        ('"observed.phases" = 2', '"observed.phases" = 3', {"data"}),
        ("1e-4", "2e-4", {"wrong"}),
        ('label = "neck"', 'label = "the neck"', {"wrong"}),
        ('kind = "cohort"', 'kind = "cohort"\ntitle = "Patients"', set()),
    ],
)
def test_a_changed_setting_makes_its_own_study_anew_and_a_title_none(folder, old, new, again):
    assert old in STUDIES
    states = made(opened(folder, STUDIES.replace(old, new)))
    assert {name for name, state in states.items() if state == "run"} == again


@pytest.mark.parametrize(
    ("change", "again"),
    [
        ("title=Other", set()),
        ("estimator.mv.title=Other", set()),
        ("quantity.cavity_pressure.title=Other", set()),
        ("report.plane=y", set()),
        ("noise.seed=7", {"data", "wrong", "patients"}),
        ("estimator.mv.window=step", set(NAMES)),
    ],
)
def test_a_change_of_the_scene_makes_those_anew_that_ask_for_what_it_changes(folder, change, again):
    states = made(opened(folder, STUDIES, [change]))
    assert {name for name, state in states.items() if state == "run"} == again


def test_plan_says_what_a_change_costs(folder):
    runner = opened(folder, STUDIES.replace("patients = 4", "patients = 6")).runner
    rows = {row.name: row for row in runner.plan([f"study.{name}" for name in NAMES])}
    assert [rows[f"study.{name}"].status for name in NAMES] == ["cached", "run", "cached"]
    assert [runner.needed(f"study.{name}") for name in NAMES] == [False, True, False]
    assert rows["study.patients"].purpose == cohort.CohortStudy.heading
    assert rows["training"].status in ("cached", "skipped")


@pytest.mark.parametrize("damage", ["cut", "empty", "other"])
def test_a_damaged_file_is_made_again_and_said(folder, caplog, damage):
    session = opened(folder, STUDIES)
    before = found(session, "patients")
    path = session.runner.path(session.runner.pipeline["study.patients"])
    content = path.read_bytes()
    path.write_bytes({"cut": content[: len(content) // 2], "empty": b"", "other": b"a text"}[damage])
    again = opened(folder, STUDIES)
    assert made(again) == {"data": "cached", "patients": "run", "wrong": "cached"}
    assert path.name in caplog.text
    np.testing.assert_array_equal(found(again, "patients").arrays["estimate"], before.arrays["estimate"])
    assert made(opened(folder, STUDIES)) == dict.fromkeys(NAMES, "cached")


def test_findings_of_every_shape_are_kept(tmp_path):
    arrays = {"none": np.zeros((2, 0)), "nan": np.array([np.nan, np.inf]), "whole": np.arange(6).reshape(2, 3)}
    facts = {"names": ["p − p_csf", ""], "nested": {"a": [1, 2.5, None, True]}, "levels": [0.0, 0.1]}
    _write(Findings(arrays, facts), tmp_path / "one.h5")
    again = _read(tmp_path / "one.h5")
    assert again.facts == facts
    for name, values in arrays.items():
        np.testing.assert_array_equal(again.arrays[name], values)
        assert again.arrays[name].shape == values.shape
    (tmp_path / "two.h5").write_bytes(b"nothing")
    with pytest.raises(StoreError):
        _read(tmp_path / "two.h5")


def test_an_interrupted_study_leaves_no_file_and_is_made_by_the_next_run(folder, monkeypatch):
    study = STUDIES.replace('"observed.phases" = 2', '"observed.phases" = 4')
    session = opened(folder, study)

    class Interrupted(variants.Grid):
        @classmethod
        def of(cls, *_given):
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(variants, "Grid", Interrupted)
        with pytest.raises(KeyboardInterrupt):
            found(session, "data")
    path = session.runner.path(session.runner.pipeline["study.data"])
    assert not path.exists()
    assert made(opened(folder, study)) == {"data": "run", "patients": "cached", "wrong": "cached"}
    assert path.exists()


def test_an_interruption_while_findings_are_written_leaves_no_half_of_a_file(folder, monkeypatch):
    study = STUDIES.replace("patients = 4", "patients = 7")
    session = opened(folder, study)
    _ = session.prepared("mv"), session.prepared("pbdw"), session.validation
    before = {path.name for path in (folder / "cache").rglob("*")}
    real, calls = h5py.Group.create_dataset, []

    def create(self, *given, **options):
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(self, *given, **options)

    with monkeypatch.context() as patch:
        patch.setattr(h5py.Group, "create_dataset", create)
        with pytest.raises(KeyboardInterrupt):
            found(session, "patients")
    assert len(calls) == 3
    left = {path.name for path in (folder / "cache").rglob("*")} - before
    assert not {name for name in left if name.startswith("study")}, left
    assert made(opened(folder, study))["patients"] == "run"


VARIANT = 'kind = "variants"\nsettings = [{{ label = "a", set = {{ {} }} }}]'
TRUTH = 'kind = "mismatch"\ntruths = [{{ label = "a", set = {{ {} }} }}]'
GROUP = 'kind = "cohort"\nquantity = "cavity_pressure"\ngroups = [{{ name = "a", patients = 3, ranges = {{ {} }} }}]'

# What [study.s] says, and what is answered; some is known when the scene is read, some when the study is run.
MISTAKES = {
    "unknown key in set": (VARIANT.format('"training.sample" = 3'), "a: training.sample: unknown key; did you mean"),
    "no table in set": (VARIANT.format('"title.x" = 3'), "a: title.x: title is not a table"),
    "a plugin's key in set": (VARIANT.format('"physics.skemptn" = 0.9'), "a: physics.skemptn: unknown key; did"),
    "a plugin in set": (VARIANT.format('"domain.kind" = "bal"'), "a: domain: domain 'bal' is not installed"),
    "a slice outside": (VARIANT.format('"observation.slice.slices" = [{ axis = "z", position = 66.0 }]'), "a: observa"),
    "too many phases": (VARIANT.format('"observed.phases" = 9'), "a: observed.phases: got 9, but 6 steps"),
    "no settings": ('kind = "variants"\nsettings = []', "settings: got the labels this scene; expected at least one"),
    "a label twice": (
        'kind = "variants"\nsettings = [{ label = "a", set = {} }, { label = "a", set = {} }]',
        "settings: got the labels this scene, a, a; expected at least one and each once",
    ),
    "the label of the base": ('kind = "variants"\nsettings = [{ label = "this scene", set = {} }]', "settings: got"),
    "unknown estimator": (VARIANT.format("") + '\nestimators = ["x"]', "estimators: got 'x', expected some of pbdw"),
    "unknown estimator of truths": (TRUTH.format("") + '\nestimators = ["x"]', "estimators: got 'x', expected some"),
    "no truths": ('kind = "mismatch"\ntruths = []', "truths: got the labels ; expected at least one and each once"),
    "other times": (TRUTH.format('"time.steps" = 4'), "truths: 'a' records other times than the scene, by time.steps"),
    "another step": (TRUTH.format('"time.step" = 4e-4'), "truths: 'a' records other times than the scene"),
    "nothing measured": (
        TRUTH.format('"observation.slice.slices" = [{ axis = "z", position = 3.5 }]'),
        "truths: 'a' measures nothing that the scene measures; keep its observations",
    ),
    "other fields": (TRUTH.format('"physics.displacement_order" = 7'), "a: physics"),
    "unknown quantity": (GROUP.format("").replace("cavity_pressure", "x"), "quantity: got 'x', expected one of cavity"),
    "unknown estimator of patients": (GROUP.format("") + '\nestimators = ["x"]', "estimators: got 'x'"),
    "a range outside": (GROUP.format("E = [1.0, 2.0]"), "group 'a': got E in [1, 2], expected a part of the range of"),
    "an unknown parameter": (GROUP.format("Q = [1.0, 2.0]"), "parameter 'Q': this model has kappa, E,"),
    "three groups": (
        'kind = "cohort"\nquantity = "cavity_pressure"\ngroups = [' + 3 * '{ name = "a", patients = 1 }, ' + "]",
        "groups: got"
    ),
    "no patients": (
        GROUP.format("").replace("patients = 3", "patients = 0"),
        "groups[0].patients: got 0, expected greater than or equal to 1",
    ),
    "not a PBDW estimator": ('kind = "weights"\nestimator = "mv"\nfield = "p"', "got 'mv', expected one of kind"),
    "unknown field": ('kind = "weights"\nestimator = "pbdw"\nfield = "q"', "field 'q': this state has the fields u, p"),
    "falling weights": (
        'kind = "weights"\nestimator = "pbdw"\nfield = "p"\nlowest = 1.0\nhighest = 0.5',
        "weights: got 13 from 1 to 0.5, expected at least 2 that rise",
    ),
    "dimension of another estimator": ('kind = "dimension"\nestimator = "mv"', "got 'mv', expected one of kind"),
    "unknown rule": ('kind = "dimension"\nestimator = "pbdw"\nrules = ["x"]', "rules[0]: got 'x', expected 'bound' or"),
    "limit of no estimator": ('kind = "limits"\nestimator = "x"', "estimator: got 'x', expected one of kind"),
    "limit of another estimator": ('kind = "limits"\nestimator = "mv"', "estimator: got 'mv', expected one of kind"),
    "places of no observation": (
        'kind = "placement"\nobservation = "x"\nquantity = "cavity_pressure"\npositions = [5.0, 6.5]\npicks = 1',
        "observation: got 'x', expected one of slice",
    ),
    "wrong kind": ('kind = "variant"\nsettings = []', "study 'variant' is not installed (did you mean 'variants'?)"),
    "unknown key": ('kind = "variants"\nsetting = []', "setting: unknown key; did you mean 'settings'?"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_answered_in_one_line_that_names_the_study(folder, mistake):
    table, message = MISTAKES[mistake]
    with pytest.raises(DacoreError) as caught:
        found(opened(folder, f"\n[study.s]\n{table}\n"))
    text = str(caught.value)
    assert isinstance(caught.value, SceneError)
    assert "\n" not in text
    assert re.match(r"\S+\.toml: study\.s[:.]", text), text
    assert message in text


def test_a_scene_without_quantities_is_studied_by_its_fields_alone(folder):
    more = '\n[study.s]\nkind = "variants"\nsettings = [{ label = "a", set = { "observed.phases" = 2 } }]\n'
    more += '[study.d]\nkind = "dimension"\nestimator = "pbdw"\nlargest = 4\n'
    path = folder / "without.toml"
    start, end = SCENE.index("[quantity"), SCENE.index("[noise]")
    path.write_text(SCENE[:start] + SCENE[end:] + more, encoding="utf-8")
    session = open_scene(path, cache=folder / "cache")
    assert found(session).arrays["rms"].shape == (2, 3, 2, 0)
    assert found(session, "d").arrays["rms"].shape == (2, 4, 0)
    for name, study in session.builder.studies.items():
        assert study.show(found(session, name), Canvas(session)).parts
    asked = '\n[study.s]\nkind = "cohort"\nquantity = "cavity_pressure"\ngroups = [{ name = "a", patients = 3 }]\n'
    path.write_text(SCENE[:start] + SCENE[end:] + asked, encoding="utf-8")
    with pytest.raises(SceneError, match=r"study.s: quantity: got 'cavity_pressure', expected one of none"):
        open_scene(path, cache=folder / "cache")


def test_patients_need_a_map_from_parameters_to_trajectories(folder):
    path = folder / "full.toml"
    full = SCENE.replace('method = "reduced"\nreduction = 1e-2\n', "").replace("samples = 16", "samples = 4")
    path.write_text(full + f"\n[study.s]\n{GROUP.format('')}\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"study.s: this training set has no map from parameters to trajectories"):
        found(open_scene(path, ["estimator.pbdw.n=2"], folder / "cache"))


@pytest.mark.parametrize(
    "table", ['kind = "dimension"\nestimator = "pbdw"', 'kind = "weights"\nestimator = "pbdw"\nfield = "p"']
)
def test_errors_of_fields_are_not_asked_of_a_scene_of_numbers_alone(folder, table):
    message = r"study.s: got report.states = false, but this study measures errors of fields; set it to true$"
    with pytest.raises(SceneError, match=message):
        found(opened(folder, f"\n[study.s]\n{table}\n", ["report.states=false"]))


def test_a_scene_of_numbers_alone_is_studied_by_these(folder):
    plain, numbers = (
        found(opened(folder, STUDIES, changes), "data") for changes in ([], ["report.states=false"])
    )  # fmt: skip
    assert numbers.facts["errors"] == []
    np.testing.assert_array_equal(numbers.arrays["rms"], plain.arrays["rms"])
