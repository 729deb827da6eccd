"""Variants of a scene: what a scene of its own finds, without training again; the grid of settings and estimators."""

import numpy as np
import pytest

from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.studies.grid import Grid
from tests.study_scenes import counted, found, opened

STUDY = """
[study.s]
kind = "variants"
base = "one slice"
settings = [
    { label = "wide voxels", set = { "observation.slice.size" = 2.0 } },
    { label = "two phases", set = { "observed.phases" = 2 } },
    { label = "step by step", set = { "estimator.mv.window" = "step" } },
]
"""
CHANGES = {
    "one slice": [],
    "wide voxels": ["observation.slice.size=2.0"],
    "two phases": ["observed.phases=2"],
    "step by step": ["estimator.mv.window=step"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("variants")


@pytest.fixture(scope="module")
def session(folder):
    made = opened(folder, STUDY)
    _ = made.validation
    return made


@pytest.fixture(scope="module")
def grid(session):
    return Grid.kept(found(session))


def test_variants_that_only_measure_otherwise_train_nothing_and_solve_no_case(session, monkeypatch):
    counts = counted(monkeypatch)
    _ = found(session)
    assert counts == {}


def test_a_variant_of_the_physics_is_trained_once_and_read_the_second_time(folder, session, monkeypatch):
    study = """
[study.s]
kind = "variants"
settings = [{ label = "less full", set = { "physics.skempton" = 0.9 } }]
"""
    counts = counted(monkeypatch)
    one = found(opened(folder, study))
    assert counts == {"train_reduced": 1, "solve_all": 1}
    # Another study of the same variant, with another label: its findings are made, no trajectory is.
    other = found(opened(folder, study.replace("less full", "with gas")))
    assert counts == {"train_reduced": 1, "solve_all": 1}
    np.testing.assert_array_equal(other.arrays["mean"], one.arrays["mean"])
    assert (one.arrays["mean"][0] != one.arrays["mean"][1]).any()


@pytest.mark.parametrize("setting", CHANGES)
def test_every_setting_is_what_a_scene_of_its_own_finds(folder, grid, setting):
    alone = opened(folder, changes=CHANGES[setting]).validation
    row = grid.settings.index(setting)
    for e, name in enumerate(grid.estimators):
        for k, level in enumerate(grid.levels):
            outcome = alone.outcome(name, level)
            for j, label in enumerate(grid.errors):
                assert grid.mean[row, e, k, j] == outcome.space_time[label].mean()
                assert grid.worst[row, e, k, j] == outcome.space_time[label].max()
            assert grid.rms[row, e, k, 0] == outcome.quantities["cavity_pressure"].rms
            assert grid.largest[row, e, k, 0] == outcome.quantities["cavity_pressure"].worst


def test_the_number_of_functionals_is_told(folder, session):
    counts = found(session).facts["measurements"]
    wide = opened(folder, changes=CHANGES["wide voxels"]).functionals.count
    assert counts == [session.functionals.count, wide, session.functionals.count, session.functionals.count]
    assert wide < session.functionals.count


def test_only_the_chosen_estimators_are_judged(folder, session):
    study = STUDY.replace('base = "one slice"', 'base = ""\nestimators = ["mv"]')
    grid = Grid.kept(found(opened(folder, study)))
    assert grid.estimators == (PRIOR, "mv")
    assert grid.settings == tuple(CHANGES)[1:]


def test_a_grid_is_kept_whole_and_scored(session, grid):
    again = Grid.kept(Grid.findings(grid))
    for name in ("settings", "estimators", "levels", "errors", "quantities"):
        assert getattr(again, name) == getattr(grid, name)
    assert JOINT not in grid.errors
    scores = {(score.setting, score.estimator, score.label): score.value for score in grid.scores()}
    assert len(scores) == 4 * 3 * 2 * 4
    assert scores["wide voxels, 10% noise", "mv", "p − p_csf"] == grid.mean[1, 2, 1, 2]
    assert scores["one slice, no noise", PRIOR, "cavity_pressure"] == grid.rms[0, 0, 0, 0]


def test_the_tables_mark_the_best_and_what_is_worse_than_guessing(session, grid):
    quiet, noisy = grid.tables(Canvas(session))
    assert (quiet.caption, noisy.caption) == ("no noise: mean (worst)", "10% noise: mean (worst)")
    assert quiet.headers[:5] == ["setting", "estimate", "e of u", "e of p", "e of p − p_csf"]
    assert [row[0] for row in quiet.rows] == [text for name in CHANGES for text in (name, "", "")]
    mean, worst = 100 * grid.mean[0, 2, 0, 0], 100 * grid.worst[0, 2, 0, 0]
    cell = quiet.rows[2][2]
    assert cell.tone == "best"
    shown = [float(text.strip("()%")) for text in cell.text.split()]
    np.testing.assert_allclose(shown, [mean, worst], rtol=0.06)
    # PBDW in one uncentred space of three modes misses the pressure altogether.
    assert grid.mean[0, 1, 0, 1] > grid.mean[0, 0, 0, 1]
    assert quiet.rows[1][3].tone == "bad"


def test_what_is_shown_has_a_figure_a_level_and_says_how_much_is_measured(session):
    exhibit = session.builder.studies["s"].show(found(session), Canvas(session))
    figures, tables = exhibit.parts[:2], exhibit.parts[2:]
    assert [each.name for each in figures] == ["no_noise", "noise_10"]
    assert tables[0].rows[0][0] == f"one slice (m = {session.functionals.count:,})"
