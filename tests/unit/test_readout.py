"""A readout is the estimate's quantity without the estimate."""

import numpy as np
import pytest

from dacore.core.estimator import PreparedEstimator
from dacore.core.noise import CorrelatedNoise, SensorNoise, WhiteNoise
from dacore.errors import CapabilityError, ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.testing.backgrounds import Weighted, functionals_of, random_background
from tests.spaces import Chain

M = 11
ESTIMATORS = {
    "pbdw": PBDW(n=4, weights={"p": 3.0}),
    "pbdw, one space": PBDW(n=4, weights={"p": 3.0}, spaces="cycle", centring="none"),
    "pbdw, no correction": PBDW(n=4, weights={"p": 3.0}, correction=False),
    "pbdw, regularised": PBDW(n="noise", weights={"p": 3.0}, fit="regularised", max_dimension=8),
    "pbdw, weighted by noise": PBDW(n=4, weights={"p": 3.0}, fit="noise_weighted", spaces="cycle", centring="phase"),
    "mv": MinimumVariance(),
    "mv, step": MinimumVariance(window="step"),
    "mv, model": MinimumVariance(deviations="model", floor=1e-3),
}


def noises():
    rng = np.random.default_rng(2)
    factor = 0.1 * rng.standard_normal((M, M)) + 0.3 * np.eye(M)
    return {
        "white": WhiteNoise(0.3),
        "sensors": SensorNoise(rng.uniform(0.1, 0.6, M)),
        "correlated": CorrelatedNoise(factor @ factor.T),
    }


@pytest.fixture(scope="module")
def stand():
    rng = np.random.default_rng(0)
    space = Chain(14)
    background = random_background(rng, space, samples=20)
    functionals = functionals_of(rng.standard_normal((M, space.n_dofs)))
    return background, functionals, rng.standard_normal((M, 5, 3)), rng.standard_normal((2, space.n_dofs))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("over", ["mean", "each"])
@pytest.mark.parametrize("noise", ["white", "sensors", "correlated"])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_value_and_deviation_are_those_of_the_estimate(stand, name, noise, over):
    background, functionals, data, rows = stand
    prepared = ESTIMATORS[name].prepare(background, functionals, noises()[noise])
    quantity = Weighted(rows, over)
    mask = np.arange(M) % 4 != 1
    for flags in (None, mask):
        given = data if flags is None else np.where(mask[:, None, None], data, np.nan)
        estimate = prepared.estimate(given, 0.7, flags)
        ready = prepared.readout(quantity, 0.7, flags)
        assert np.allclose(ready(given), estimate.quantity(quantity), rtol=1e-10, atol=1e-10)
        assert np.allclose(ready.deviation, estimate.standard_deviation(quantity)[:, 0], rtol=1e-10)
        assert ready.gain.shape == (len(ready.offset), M, 5)
        assert flags is None or not ready.gain[:, ~mask].any()


def test_some_steps_observed(stand):
    background, functionals, data, rows = stand
    for estimator in (ESTIMATORS["pbdw"], ESTIMATORS["mv"], ESTIMATORS["mv, step"]):
        prepared = estimator.prepare(background, functionals, WhiteNoise(), np.array([3, 1]))
        wanted = prepared.estimate(data[:, :2], 0.2).quantity(Weighted(rows))
        assert np.allclose(prepared.readout(Weighted(rows), 0.2)(data[:, :2]), wanted, rtol=1e-10)


def test_wrong_data_are_refused_as_by_estimate(stand):
    background, functionals, data, rows = stand
    ready = ESTIMATORS["mv"].prepare(background, functionals, WhiteNoise()).readout(Weighted(rows))
    spoiled = data.copy()
    spoiled[0, 0, 0] = np.nan
    for wrong in (data[1:], data[:, 0, 0], spoiled):
        with pytest.raises(ShapeError, match="data"):
            ready(wrong)
    with pytest.raises(ShapeError, match="noise_scale"):
        ESTIMATORS["mv"].prepare(background, functionals, WhiteNoise()).readout(Weighted(rows), -1.0)


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_data_of_one_series_need_no_axis_of_series(stand, name):
    background, functionals, data, _ = stand
    prepared = ESTIMATORS[name].prepare(background, functionals, WhiteNoise())
    flat, whole = prepared.estimate(data[:, :, 1], 0.1), prepared.estimate(data[:, :, 1:2], 0.1)
    assert flat.n_series == 1
    np.testing.assert_array_equal(flat.coefficients, whole.coefficients)


def test_an_estimator_without_a_readout_says_what_to_do(stand):
    class Own(PreparedEstimator):
        inf_sup = np.zeros(5)

        def estimate(self, data, noise_scale=1.0, mask=None):
            raise AssertionError

    with pytest.raises(CapabilityError, match=r"Own has no readout; use estimate\(data\).quantity"):
        Own().readout(Weighted(stand[3]))
