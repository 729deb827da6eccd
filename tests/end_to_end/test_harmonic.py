"""Amplitude and phase of one slice, from a scene to its report; and what a scene of one frequency may not say."""

import json
from pathlib import Path

import numpy as np
import pytest

from dacore.dynamics.harmonic import HarmonicModel, amplitude
from dacore.errors import SceneError
from dacore.workflow.open import open_scene
from dacore.workflow.run import run_scene

SCENE = Path(__file__).resolve().parents[2] / "examples" / "toy" / "harmonic.toml"
SMALL = ["training.samples=64", "validation.cases=6", "training.reduction=2e-2", "estimator.posterior.solves=600"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("harmonic")
    run_scene(SCENE, SMALL, out, workers=1)
    return out


def test_phases_of_hidden_pressure_are_recovered(finished):
    results = json.loads((finished / "results.json").read_text())
    found = {(o["estimator"], o["noise"]): o for o in results["validation"]}
    exact, noisy = found["minimum_variance", 0.0], found["minimum_variance", 0.05]
    for label, factor in (("u", 20), ("p", 2)):
        assert exact["errors"][label]["mean"] < exact["errors"][label]["of_the_training_mean"] / factor
        assert noisy["errors"][label]["mean"] < 0.6 * noisy["errors"][label]["of_the_training_mean"]
    pressure = noisy["quantities"]["cavity_pressure"]
    truth = np.array(pressure["truth"])
    assert truth.shape == (2, 6)
    # The cavity's pressure is in phase 0 here: nothing a quarter of a period later.
    assert np.abs(truth[1]).max() < 1e-6 * np.abs(truth[0]).max()
    assert (finished / "report.html").exists()
    assert (finished / "fields" / "worst_case_no_noise.xdmf").exists()


def test_a_part_is_solved_in_full_and_the_rest_is_as_accurate_as_it_says(finished):
    scene = open_scene(SCENE, SMALL, finished)
    training, unseen = scene.reduced, scene.unseen_errors
    assert len(training.solved) < 50
    assert training.estimates.max() <= 2e-2
    for name in ("u", "p"):
        assert unseen.true[name].max() < 2e-2
        assert unseen.effectivity[name].min() > 0.5
    told = json.loads((finished / "results.json").read_text())["reduced_training"]
    assert told["solved_in_full"] == len(training.solved)


def test_the_posterior_finds_stiffness_and_loss_in_noise(finished):
    results = json.loads((finished / "results.json").read_text())
    found = {(o["estimator"], o["noise"]): o for o in results["validation"]}
    mine, linear = found["posterior", 0.05]["errors"], found["minimum_variance", 0.05]["errors"]
    assert mine["u"]["mean"] < 0.7 * linear["u"]["mean"]
    assert mine["p"]["mean"] < linear["p"]["mean"]
    scene = open_scene(SCENE, SMALL, finished)
    data, samples = scene.runner["noisy"], scene.runner["truth"].samples
    parameters = scene.prepared("posterior").estimate(data.given(0.05), noise_scale=data.sigmas[0.05]).parameters
    for name in ("E", "loss"):
        row, wanted = parameters.names.index(name), samples[:, scene.parameters.names.index(name)]
        assert parameters.learned[row].mean() > 0.95
        assert (np.abs(parameters.values[row] - wanted) < 4 * parameters.deviation[row]).all()


def test_the_same_from_python(finished):
    scene = open_scene(SCENE, SMALL, finished)
    assert isinstance(scene.model, HarmonicModel)
    assert np.allclose(scene.model.times, [0.0, 0.005])
    truth = scene.truth[0]
    data = scene.functionals(truth.states)
    assert data.shape[1] == 2
    complex_data = amplitude(data)
    # What a scanner gives as v: Re(v e^{iωt}) at the two times is what an estimator takes.
    turns = np.exp(2j * np.pi * scene.model.frequency * scene.model.times)
    assert np.allclose((complex_data[:, None] * turns).real, data)
    estimate = scene.prepared("minimum_variance").estimate(data[:, :, None], noise_scale=0.0)
    found, true = amplitude(estimate.state(0)), amplitude(truth.states)
    rows = scene.model.space.layout.block("u")
    assert np.linalg.norm(found[rows] - true[rows]) < 0.1 * np.linalg.norm(true[rows])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("time={step=1e-3}", r"time: biot_harmonic .* remove the \[time\] table"),
        ("training.most=7", r"training.most: got 7"),
        ('training.method="full"', "reduction: of method = 'reduced', but the method is 'full'"),
        ("validation.refine_time=2", "validation.refine_time"),
        ('observed.less_mean=["u"]', "observed.less_mean: the two steps are the phases of a motion whose mean is zero"),
        ('quantity.cavity_pressure.over_time="mean"', r"quantity.cavity_pressure.over_time: got 'mean', .* 'each'"),
        ("observed.phases=3", "observed.phases: got 3, but 2 steps"),
        ("physics.ramp=0.1", r"physics\.ramp: unknown key"),
        ("physics.frequency=0.0", "frequency: got 0.0"),
        ("parameters.loss=[-0.1, 0.2]", "loss: got -0.1"),
        (
            "parameters.phase_csf={low=0.0, high=10.0, unit='kg'}",
            "got the unit 'kg', expected one that converts to 'rad'",
        ),
    ],
)
def test_what_does_not_fit_is_said_in_a_line_before_training(tmp_path, change, message):
    with pytest.raises(SceneError, match=message) as caught:
        run_scene(SCENE, [*SMALL, change], tmp_path / "out", workers=1)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "out").glob("cache/training*/*.h5"))


def test_phases_may_be_given_in_degrees():
    scene = open_scene(SCENE, [*SMALL, "parameters.phase_ventricles={low=-90.0, high=90.0, unit='deg'}"])
    phase = scene.parameters["phase_ventricles"]
    assert (phase.low, phase.high) == (pytest.approx(-np.pi / 2), pytest.approx(np.pi / 2))
