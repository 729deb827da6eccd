"""What is seen of a cycle: some of its steps, and fields less their mean."""

import numpy as np
import pytest

from dacore.errors import SceneError
from tests.study_scenes import opened

POSTERIOR = """
[estimator.posterior]
kind = "posterior"
points = 128
"""
# A steady start at each sample's own pressure, which then stays: the cavity's pressure moves nothing.
STATIC = """
[observed]
less_mean = ["u"]

[estimator.posterior]
kind = "posterior"
points = 512

[parameters]
kappa = 1e-8
nu = 0.4
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("observed")


@pytest.mark.parametrize(
    ("change", "steps"),
    [
        ("phases=1", [6]),
        ("phases=2", [3, 6]),
        ("phases=3", [2, 4, 6]),
        ("phases=4", [2, 3, 4, 6]),
        ("phases=6", [1, 2, 3, 4, 5, 6]),
        ("steps=[5]", [5]),
        ("steps=[6, 1]", [1, 6]),
    ],
)
def test_phases_end_equal_parts_of_the_cycle_and_steps_count_from_one(folder, change, steps):
    builder = opened(folder, changes=[f"observed.{change}"]).builder
    assert (builder.observed(6) + 1).tolist() == steps


@pytest.mark.parametrize(("recorded", "phases"), [(20, 5), (40, 7), (41, 40), (1, 1)])
def test_phases_are_different_and_the_last_step_is_one_of_them(folder, recorded, phases):
    chosen = opened(folder, changes=[f"observed.phases={phases}"]).builder.observed(recorded)
    assert len(np.unique(chosen)) == phases
    assert (chosen[-1], chosen.min() >= 0) == (recorded - 1, True)


def test_all_steps_are_observed_without_the_table(folder):
    assert opened(folder).builder.observed(6) is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["observed.phases=7"], r"observed.phases: got 7, but 6 steps are recorded; lower it$"),
        (["observed.phases=0"], r"observed.phases: got 0, expected"),
        (["observed.steps=[3, 7]"], r"observed.steps: got \[3, 7\], expected different numbers from 1 to 6$"),
        (["observed.steps=[3, 3]"], r"observed.steps: got \[3, 3\], expected different numbers from 1 to 6$"),
        (["observed.steps=[0]"], r"observed.steps.0: got 0, expected"),
        (["observed.steps=[]"], r"observed.steps: "),
        (["observed.steps=[3]", "observed.phases=2"], r"observed: got both phases and steps, expected one of them$"),
        (['observed.less_mean=["q"]'], r"observed.less_mean: field 'q': this state has the fields u, p$"),
        (["observed.phase=2"], r"observed.phase: unknown key; did you mean 'phases'"),
    ],
)
def test_what_cannot_be_observed_is_said_in_one_line_before_training(folder, tmp_path, changes, message):
    with pytest.raises(SceneError, match=message) as caught:
        _ = opened(folder, changes=changes, cache=tmp_path).cautions
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.glob("training*"))


def test_estimators_without_a_memory_estimate_the_observed_steps_and_others_the_whole_cycle(folder):
    session = opened(folder, POSTERIOR, ["observed.phases=3"])
    seen = np.array([1, 3, 5])
    shapes = {name: session.prepared(name).estimate(session.runner["noisy"].given(0.1), 1e-4).steps.tolist()
              for name in session.scene.estimator}  # fmt: skip
    assert shapes == {"pbdw": seen.tolist(), "mv": list(range(6)), "posterior": list(range(6))}
    for name in shapes:
        errors = session.validation.outcome(name, 0.1).per_step["p"]
        assert errors.shape == (6, 3)
        unseen = np.isnan(errors).all(axis=1)
        assert np.flatnonzero(~unseen).tolist() == shapes[name]
        assert not np.isnan(errors[~unseen]).any()


def test_the_noise_of_a_step_does_not_depend_on_which_others_are_seen(folder):
    whole, some = (opened(folder, changes=changes).runner["noisy"] for changes in ([], ["observed.steps=[2, 5]"]))
    np.testing.assert_array_equal(some.given(0.1), whole.given(0.1)[:, [1, 4]])
    np.testing.assert_array_equal(some.sigmas[0.1], whole.sigmas[0.1])


def test_all_phases_are_the_same_as_no_table(folder):
    whole, phases = (opened(folder, changes=changes).validation for changes in ([], ["observed.phases=6"]))
    for one, other in zip(whole.outcomes, phases.outcomes, strict=True):
        for label, values in one.space_time.items():
            np.testing.assert_allclose(other.space_time[label], values, rtol=1e-9)


def test_what_is_observed_trains_nothing_again(folder):
    plain, changed = (opened(folder, changes=changes) for changes in ([], ["observed.phases=2"]))
    for stage in ("training", "background", "truth", "measured", "reference"):
        assert plain.runner.pipeline.key(stage) == changed.runner.pipeline.key(stage)
    for stage in ("noisy", "prepared.mv", "judged.mv"):
        assert plain.runner.pipeline.key(stage) != changed.runner.pipeline.key(stage)


@pytest.mark.parametrize("fields", [["u"], ["u", "p"]])
def test_less_mean_takes_the_mean_over_the_steps_from_everything_alike(folder, fields):
    plain = opened(folder)
    session = opened(folder, changes=[f"observed.less_mean={fields!r}"])
    assert session.runner.pipeline.key("training") == plain.runner.pipeline.key("training")
    background, layout = session.background, session.model.space.layout
    truth, whole = session.truth[1].states, plain.truth[1].states
    points = background.samples[:3]
    made = background.forward.coefficients(points)
    for field in ("u", "p"):
        block, rows = layout.block(field), background.block(field)
        expected = whole[block] - (whole[block].mean(axis=1, keepdims=True) if field in fields else 0.0)
        np.testing.assert_allclose(truth[block], expected, atol=1e-12 * np.abs(whole[block]).max())
        coefficients = plain.background.coefficients[plain.background.block(field)]
        expected = coefficients - (coefficients.mean(axis=1, keepdims=True) if field in fields else 0.0)
        np.testing.assert_allclose(background.coefficients[rows], expected, atol=1e-12 * np.abs(coefficients).max())
        # The forward map sees what training saw, of the same parameters.
        np.testing.assert_allclose(made[rows], expected[:, :, :3], atol=1e-8 * np.abs(coefficients).max())
    # What is measured has no mean left, and the errors are small as before.
    np.testing.assert_allclose(
        session.runner["measured"].data.mean(axis=1), 0.0, atol=1e-12 * np.abs(plain.validation.clean).max()
    )
    assert session.validation.outcome("mv", 0.0).space_time["u"].mean() < 0.05


def test_a_static_pressure_leaves_no_trace_in_data_less_their_mean_and_the_stiffness_does(folder):
    session = opened(folder, STATIC, ["time.start=steady", "noise.levels=[0.01]"])
    outcome = session.validation.outcome("posterior", 0.01)
    known = outcome.parameters
    deviation = dict(zip(known.names, known.deviation, strict=True))
    prior = dict(zip(known.names, known.prior, strict=True))
    np.testing.assert_allclose(prior["p_ventricles"], 1e3 / np.sqrt(12.0), rtol=1e-6)
    np.testing.assert_allclose(deviation["p_ventricles"], prior["p_ventricles"], rtol=0.1)
    assert (deviation["E"] < 0.1 * prior["E"]).all()
    seen = opened(folder, STATIC, ["time.start=steady", "noise.levels=[0.01]", "observed.less_mean=[]"])
    learned = seen.validation.outcome("posterior", 0.01).parameters
    assert (learned.deviation[list(learned.names).index("p_ventricles")] < 0.7 * prior["p_ventricles"]).all()
