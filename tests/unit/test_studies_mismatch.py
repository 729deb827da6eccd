"""Truths of another model: nothing changes where nothing is wrong, masks, meshes, alarms that rise."""

import numpy as np
import pytest

from dacore.studies.noisy import NoisyData
from dacore.studies.transfer import interpolation
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn
from dacore.workflow.studies.grid import Grid
from tests.study_scenes import counted, found, opened

STUDY = """
[study.s]
kind = "mismatch"
truths = [
    { label = "nothing", set = {} },
    { label = "another mesh", set = { "domain.edge" = 2.2 } },
    { label = "fewer voxels", set = { "observation.slice.coverage" = 0.9 } },
    { label = "1e-6", set = { "physics.neck_displacement" = 1e-6 }, series = "neck", size = 1e-6 },
    { label = "1e-2", set = { "physics.neck_displacement" = 1e-2 }, series = "neck", size = 1e-2 },
    { label = "1e-4", set = { "physics.neck_displacement" = 1e-4 }, series = "neck", size = 1e-4 },
]
"""
CHANGES = {
    "nothing": [],
    "another mesh": ["domain.edge=2.2"],
    "fewer voxels": ["observation.slice.coverage=0.9"],
    "1e-4": ["physics.neck_displacement=1e-4"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mismatch")


@pytest.fixture(scope="module")
def session(folder):
    made = opened(folder, STUDY)
    _ = made.validation
    return made


@pytest.fixture(scope="module")
def grid(session):
    return Grid.kept(found(session))


def test_truths_are_solved_and_nothing_is_trained(session, monkeypatch):
    counts = counted(monkeypatch)
    _ = found(session)
    # One set of unseen cases for each other model; other voxels are measured on the scene's own.
    assert counts == {"solve_all": 4}


def test_an_identical_truth_gives_exactly_the_errors_of_the_scene(session, grid):
    row = grid.settings.index("nothing")
    for each in (grid.mean, grid.worst, grid.rms, grid.largest):
        np.testing.assert_array_equal(each[row], each[0])
    mv = session.validation.outcome("mv", 0.1)
    assert grid.mean[0, 2, 1, 0] == mv.space_time["u"].mean()
    assert session.runner["study.s"].facts["lost"][row] == 0.0


@pytest.mark.parametrize("label", ["another mesh", "fewer voxels", "1e-4"])
@pytest.mark.parametrize("level", [0, 1])
def test_errors_are_those_of_the_estimate_lifted_to_states(folder, session, grid, label, level):
    other = opened(folder, changes=CHANGES[label])
    rows = [other.functionals.labels.index(name) if name in other.functionals.labels else -1
            for name in session.functionals.labels]  # fmt: skip
    mask = np.array(rows) >= 0
    measured = np.stack([other.functionals(truth.states) for truth in other.truth], axis=-1)
    data = np.where(mask[:, None, None], measured[rows], 0.0)
    noisy = NoisyData.drawn(data, [0.0, 0.1], 3)
    scale = list(noisy.sigmas.values())[level]
    estimate = session.prepared("mv").estimate(list(noisy.data.values())[level], scale, None if mask.all() else mask)
    move, expected = interpolation(other.model.space, session.model.space), []
    for case, truth in enumerate(other.truth):
        states = move(truth.states)
        gap = states - estimate.state(series=case)
        block = session.model.space.layout.block("p")
        product = session.model.space.field_product("p")

        def norm(x, block=block, product=product):
            return np.sqrt(np.einsum("it,it->", x[block], product @ x[block]))

        expected.append([norm(gap) / norm(states), norm(gap) / norm(states - 1e4)])
    row = grid.settings.index(label)
    np.testing.assert_allclose(grid.mean[row, 2, level, 1:], np.mean(expected, axis=0), rtol=1e-6)
    assert found(session).facts["missing"][row] == (~mask).sum()
    assert mask.all() == (label != "fewer voxels")


def test_constant_and_linear_states_reach_the_other_mesh_unchanged(folder, session):
    other = opened(folder, changes=CHANGES["another mesh"]).model.space
    move, ours = interpolation(other, session.model.space), session.model.space

    def linear(space):
        x = space.cells().points
        return np.concatenate([x[:, 0], 2 * x[:, 1] - 3, x.sum(axis=1), np.full(len(x), 7.0)])

    moved, expected = move(linear(other)), linear(ours)
    np.testing.assert_allclose(moved[ours.layout.block("p")], 7.0, rtol=1e-12)
    inside = np.linalg.norm(ours.cells().points - [0.0, 0.0, 5.0], axis=1)
    # Well between the two curved boundaries every node lies in a cell of the other mesh.
    inside = np.tile((inside > 2.0) & (inside < 4.0), 3)
    np.testing.assert_allclose(moved[: inside.size][inside], expected[: inside.size][inside], atol=1e-12)
    assert inside.sum() > 30


def test_the_share_lost_between_the_meshes_is_told(session):
    facts = found(session).facts
    lost = dict(zip(facts["settings"], facts["lost"], strict=True))
    assert 1e-4 < lost.pop("another mesh") < 0.1
    assert set(lost.values()) == {0.0}


def test_alarms_and_errors_rise_with_the_displacement_of_the_neck(grid):
    rows = [grid.settings.index(label) for label in ("1e-6", "1e-4", "1e-2")]
    alarms = grid.alarms[rows][:, 1:]  # (sizes, estimators, levels)
    assert (np.diff(alarms, axis=0) >= 0).all()
    np.testing.assert_array_equal(alarms[-1], 1.0)
    assert alarms[0].max() == 0.0
    assert np.isnan(grid.alarms[:, 0]).all()
    assert (np.diff(grid.mean[rows, 2], axis=0) > 0).all()


def test_the_curve_of_a_series_rises_by_size_whatever_the_order_of_its_truths(session):
    exhibit = session.builder.studies["s"].show(found(session), Canvas(session))
    figures = [each for each in exhibit.parts if isinstance(each, Drawn)]
    assert [each.name for each in figures] == ["neck_no_noise", "neck_noise_10"]
    sizes = figures[0].figure.given[0]
    largest = np.abs(session.validation.clean).max()
    np.testing.assert_allclose(sizes, np.array([1e-6, 1e-4, 1e-2]) / largest)


def test_what_is_not_measured_there_and_what_is_lost_is_told_in_words(session):
    text = session.builder.studies["s"].show(found(session), Canvas(session)).text
    missing = found(session).facts["missing"][found(session).facts["settings"].index("fewer voxels")]
    assert f"fewer voxels: {missing} functionals of the scene are not measured there." in text
    assert "another mesh: " in text
    assert "nothing: " not in text
