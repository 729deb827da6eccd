"""Misfits of linear estimates: quiet on right data, loud on wrong ones."""

import numpy as np
import pytest

from dacore.core.misfit import Misfit
from dacore.core.noise import CorrelatedNoise, SensorNoise, WhiteNoise
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.estimators.surprise import matched, of_steps
from dacore.testing.backgrounds import Population, random_functionals
from tests.spaces import Chain

M, CASES = 24, 200
ESTIMATORS = {
    "mv": MinimumVariance(),
    "mv, step": MinimumVariance(window="step"),
    "pbdw": PBDW(n=8, weights={"p": 0.3}),
    "pbdw, one space": PBDW(n=8, weights={"p": 0.3}, spaces="cycle", centring="phase"),
    "regularised": PBDW(n="noise", fit="regularised", weights={"p": 0.3}, max_dimension=8),
    "noise weighted": PBDW(n=7, fit="noise_weighted", weights={"p": 0.3}),
}


@pytest.fixture(scope="module")
def stand():
    rng = np.random.default_rng(0)
    space = Chain(14)
    population = Population(rng, space)
    background = population.background(rng, samples=120)
    functionals = random_functionals(rng, space, M)
    return background, functionals, population.draw(rng, CASES)


def noises():
    rng = np.random.default_rng(1)
    factor = 0.1 * rng.standard_normal((M, M)) + 0.3 * np.eye(M)
    return {
        "white": WhiteNoise(0.3),
        "sensors": SensorNoise(rng.uniform(0.1, 0.6, M)),
        "correlated": CorrelatedNoise(factor @ factor.T),
    }


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["white", "sensors", "correlated"])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_right_data_are_not_contradicted(stand, name, kind):
    """Probabilities of unseen cases of the training distribution are nearly uniform, with a mask and without."""
    background, functionals, truth = stand
    noise = noises()[kind]
    rng = np.random.default_rng(2)
    prepared = ESTIMATORS[name].prepare(background, functionals, noise)
    for flags in (None, np.arange(M) % 5 != 2):
        for scale in (0.3, 3.0):
            data = functionals(truth) + scale * noise.sample(rng, (M, 5, CASES))
            misfit = prepared.estimate(data, scale, flags).misfit
            assert misfit.alarm.mean() <= 0.01
            below = [float((misfit.probability < level).mean()) for level in (0.05, 0.25, 0.75)]
            assert np.allclose(below, (0.05, 0.25, 0.75), atol=0.12), below


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ESTIMATORS)
def test_wrong_data_are_contradicted(stand, name):
    background, functionals, truth = stand
    noise = WhiteNoise(0.3)
    rng = np.random.default_rng(3)
    prepared = ESTIMATORS[name].prepare(background, functionals, noise)
    clean, errors = functionals(truth), noise.sample(rng, (M, 5, CASES))
    lifted = functionals.matrix @ np.ones(functionals.matrix.shape[1])
    wrong = {
        "twice the noise": clean + 2.0 * errors,
        "the whole body displaced": clean + errors + 0.5 * lifted[:, None, None],
        "functionals in another order": np.roll(clean, 3, axis=0) + errors,
    }
    for what, data in wrong.items():
        misfit = prepared.estimate(data, 1.0).misfit
        assert misfit.alarm.mean() > 0.9, what
        assert (misfit.ratio > 1.0).mean() > 0.9, what


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ESTIMATORS)
def test_exact_data_are_held_against_what_training_leaves_out(stand, name):
    """What n modes leave of right data is expected; a state of another kind is seen at once."""
    background, functionals, truth = stand
    prepared = ESTIMATORS[name].prepare(background, functionals, WhiteNoise(0.3))
    right = prepared.estimate(functionals(truth), 0.0).misfit
    assert right.alarm.mean() <= 0.01
    other = np.random.default_rng(4).standard_normal(truth.shape)
    assert prepared.estimate(functionals(truth + 0.3 * other), 0.0).misfit.alarm.mean() > 0.9


def test_scaling_keeps_mean_and_variance():
    misfit = matched(np.array([3.0, 8.0]), np.array([4.0, 4.0]), np.array([8.0, 2.0]))
    assert np.allclose(misfit.freedom, [4.0, 16.0])
    assert np.allclose(misfit.ratio**2, [0.75, 2.0])


def test_residuals_of_pure_noise_are_chi_squared():
    """Without anything missed, the statistic is the classical one."""
    squares = np.array([[18.0], [30.0]])
    count = np.array([[9.0], [12.0]])
    found = of_steps(squares, np.zeros((2, 5, 1)), count, np.array([2.0]), 0.0)
    assert np.allclose(found.statistic, 48.0 / 4.0)
    assert np.allclose(found.freedom, 21.0)
    assert of_steps(squares, np.zeros((2, 5, 1)), 0.0 * count, np.array([2.0]), 0.0) is None
    assert isinstance(found, Misfit)
