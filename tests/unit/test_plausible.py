"""Data that cannot be what they are taken for: told or refused; right ones pass in silence."""

import logging

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.algebra.compress import compress
from dacore.algebra.pod import pod
from dacore.core.model import Trajectory
from dacore.core.noise import SensorNoise, WhiteNoise
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.testing.backgrounds import Population, functionals_of, random_functionals
from dacore.testing.spaces import Chain

STEPS = 4
ESTIMATORS = [MinimumVariance(), PBDW(n=3, weights={"p": 1.0}), PBDW(n=3, weights={"p": 1.0}, correction=False)]


@pytest.fixture
def setting():
    rng = np.random.default_rng(0)
    space = Chain(20)
    population = Population(rng, space, STEPS)
    population.mean *= 5.0
    functionals = random_functionals(rng, space)
    return population.background(rng, 12), functionals, functionals(population.draw(rng, 7))


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("noise", [0.0, 0.3, 1e9])
def test_unseen_cases_with_noise_pass_in_silence(setting, estimator, noise, caplog):
    background, functionals, data = setting
    sigma = noise * np.abs(data).max()
    noisy = data + sigma * np.random.default_rng(1).standard_normal(data.shape)
    estimator.prepare(background, functionals, WhiteNoise()).estimate(noisy, sigma)
    assert not caplog.records


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(
    ("factor", "word"), [(10.0, "unit"), (0.1, "unit"), (1e150, "unit"), (0.0, "unit"), (-1.0, "sign")]
)
@pytest.mark.parametrize("mask", [None, np.arange(11) < 8])
def test_a_wrong_unit_or_sign_is_told(setting, estimator, factor, word, mask, caplog):
    background, functionals, data = setting
    with caplog.at_level(logging.WARNING):
        estimator.prepare(background, functionals, WhiteNoise()).estimate(factor * data, 0.0, mask)
    (record,) = caplog.records
    assert word in record.getMessage()
    assert "7 of 7 series" in record.getMessage()


def test_units_of_sensors_count_alike(setting, caplog):
    """One sensor in volts, the others in centimetres: the noise says how much of each is much."""
    background, functionals, data = setting
    sigmas = np.where(np.arange(functionals.count) == 0, 1e8, 1.0)
    rows = csr_array(functionals.matrix * sigmas[:, None])
    scaled = functionals_of(rows.toarray())
    MinimumVariance().prepare(background, scaled, SensorNoise(sigmas)).estimate(data * sigmas[:, None, None], 0.1)
    assert not caplog.records


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(
    "mask", [np.ones(11, dtype=int), np.arange(5), np.ones(10, dtype=bool), [1.0] * 11, np.zeros(11, dtype=bool)]
)
def test_what_is_no_mask_is_refused(setting, estimator, mask):
    background, functionals, data = setting
    prepared = estimator.prepare(background, functionals, WhiteNoise())
    with pytest.raises(ShapeError, match=r"^mask: .*expected"):
        prepared.estimate(data, 0.0, mask)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_list_of_booleans_is_a_mask_and_masked_data_may_be_anything(setting, estimator):
    background, functionals, data = setting
    prepared = estimator.prepare(background, functionals, WhiteNoise())
    mask = [True] * 8 + [False] * 3
    broken = data.copy()
    broken[8:] = np.nan
    expected = prepared.estimate(data, 0.0, np.array(mask)).state()
    np.testing.assert_allclose(prepared.estimate(broken, 0.0, mask).state(), expected, rtol=1e-9, atol=1e-11)
    with pytest.raises(ShapeError, match="data: got shape"):
        prepared.estimate(data[:, 0], 0.0, mask)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("dtype", [complex, object, "U4"])
def test_data_that_are_no_real_numbers_are_refused(setting, estimator, dtype):
    background, functionals, data = setting
    prepared = estimator.prepare(background, functionals, WhiteNoise())
    with pytest.raises(ShapeError, match="expected real numbers"):
        prepared.estimate(data.astype(dtype), 0.0)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_no_series_give_no_states(setting, estimator):
    background, functionals, data = setting
    found = estimator.prepare(background, functionals, WhiteNoise()).estimate(data[:, :, :0], 0.1)
    assert found.state().shape == (background.space.n_dofs, STEPS, 0)


def test_functionals_that_see_nothing_or_nan_are_refused():
    rows = np.ones((3, 6))
    stored = csr_array((np.array([1.0, 0.0, 0.0]), (np.array([0, 1, 1]), np.array([0, 1, 2]))), shape=(2, 6))
    wide = functionals_of(rows)
    with pytest.raises(ShapeError, match=r"1 see nothing .*first: l1"):
        type(wide)(stored, ("l0", "l1"), "cm", np.zeros((2, 1)), np.zeros((2, 1)), np.arange(2))
    rows[2, 4] = np.inf
    with pytest.raises(ShapeError, match=r"1 hold NaN or infinite weights \(first: l2\)"):
        functionals_of(rows)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf, 1e-200, 1e200])
def test_noise_that_cannot_be_squared_is_refused(sigma):
    with pytest.raises(ShapeError, match="standard deviation"):
        WhiteNoise(sigma)
    with pytest.raises(ShapeError, match="standard deviation"):
        SensorNoise(np.array([1.0, sigma]))


def test_equal_trajectories_have_no_covariance(setting):
    background, functionals, _ = setting
    equal = type(background)(
        **{
            **{name: getattr(background, name) for name in background.__dataclass_fields__},
            "coefficients": np.repeat(background.coefficients[:, :, :1], background.n_samples, axis=2),
        }
    )
    with pytest.raises(ShapeError, match="no covariance"):
        MinimumVariance().prepare(equal, functionals, WhiteNoise())


def test_few_samples_make_the_model_deviations_suspect(setting, caplog):
    background, functionals, _ = setting
    MinimumVariance(deviations="held_out").prepare(background, functionals, WhiteNoise())
    assert not caplog.records
    MinimumVariance(deviations="model").prepare(background, functionals, WhiteNoise())
    assert "12 samples" in caplog.text
    caplog.clear()
    rng = np.random.default_rng(3)
    many = Population(rng, background.space, 1).background(rng, 400)
    MinimumVariance(deviations="model").prepare(many, functionals, WhiteNoise())
    assert not caplog.records


@pytest.mark.parametrize(("constant", "told"), [(0.0, False), (1e3, False), (1e6, True)])
def test_variation_lost_beside_a_constant_is_told(constant, told, caplog):
    rng = np.random.default_rng(4)
    space = Chain(20)
    states = Population(rng, space, STEPS).draw(rng, 9) + constant
    trajectories = [Trajectory(states[:, :, k], np.arange(1.0, STEPS + 1)) for k in range(9)]
    compress(space, trajectories, ParameterSpace((Parameter("a", "1", 0.0, 1.0),)), rng.random((9, 1)), 1e-6)
    assert ("what varies between samples" in caplog.text) == told


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e200])
def test_snapshots_whose_squares_leave_double_are_refused(size):
    product = csr_array(np.eye(5))
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(ShapeError, match="sum of their squares"):
        pod(np.full((5, 3), size), product)
