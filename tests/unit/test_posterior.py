"""The posterior of state and parameters against closed formulas, quadrature, and a sampler of another kind."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from dacore.algebra.compress import compress
from dacore.core.background import ParametricMap
from dacore.core.model import Trajectory
from dacore.core.noise import CorrelatedNoise, WhiteNoise
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import CapabilityError, ShapeError
from dacore.estimators.posterior import Posterior
from dacore.estimators.posterior_information import fisher
from dacore.studies.limits import Chain, limits, posterior_by_chain
from dacore.testing.backgrounds import ParametricPopulation, Weighted, random_functionals
from dacore.testing.spaces import Chain as Points

STEPS, M = 4, 9


class Formula(ParametricMap):
    """A function of the parameters, on the bases of a background."""

    def __init__(self, function, background):
        self.function, self.background = function, background

    def coefficients(self, points):
        return self.background.project(self.function(points))

    @property
    def accuracy(self):
        return {"u": 1e-10, "p": 1e-10}


def background_of(function, parameters, seed=1, samples=60):
    """A training set of a formula (k, n_parameters) -> (n_dofs, steps, k), with the formula as its forward map."""
    space, points = Points(14), parameters.sample(np.random.default_rng(seed), samples, "latin_hypercube")
    states = function(points)
    trajectories = [Trajectory(each, np.arange(1.0, STEPS + 1)) for each in np.moveaxis(states, 2, 0)]
    made = compress(space, trajectories, parameters, points, 1e-12)
    return replace(made, forward=Formula(function, made))


def affine(ranges, seed=0):
    """Trajectories that are affine in all parameters."""
    rng = np.random.default_rng(seed)
    parameters = ParameterSpace(tuple(Parameter(f"a{k}", "1", *ends) for k, ends in enumerate(ranges)))
    mean, modes = rng.standard_normal((42, STEPS)), rng.standard_normal((42, STEPS, len(ranges)))

    def function(points):
        return mean[:, :, None] + np.tensordot(modes, points.T, axes=1)

    return background_of(function, parameters), function


def curved(seed=0, bend=1.3):
    """Trajectories of one parameter with a wide range, which they bend in."""
    rng = np.random.default_rng(seed)
    parameters = ParameterSpace((Parameter("stiffness", "1", 1.0, 12.0), Parameter("load", "1", 0.0, 2.0)))
    mean, one, two = rng.standard_normal((3, 42, STEPS, 1))

    def function(points):
        stiffness, load = points.T
        return mean + one * np.sin(bend * np.log(stiffness)) * load + two / stiffness

    return background_of(function, parameters), function


def grid_posterior(function, functionals, parameters, data, sigma, count=200):
    """Points, weights and states of the posterior on a grid that is uniform in the parameters."""
    ends = [(p.low, p.high) for p in parameters.parameters]
    axes = [low + (high - low) * (np.arange(count) + 0.5) / count for low, high in ends]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(ends))
    states = function(points)
    misfit = ((functionals(states) - data[:, :, None]) ** 2).sum(axis=(0, 1)) / sigma**2
    weights = np.exp(-0.5 * (misfit - misfit.min()))
    return points, weights / weights.sum(), states


@pytest.fixture(scope="module")
def functionals():
    return random_functionals(np.random.default_rng(3), Points(14), M)


@pytest.mark.parametrize("kind", ["sampled", "laplace"])
def test_far_from_the_ends_of_the_ranges_an_affine_map_has_the_gaussian_posterior(kind, functionals):
    b, function = affine([(-50.0, 50.0), (-80.0, 90.0), (-60.0, 70.0)])
    rng = np.random.default_rng(4)
    factor = rng.standard_normal((M, M)) + 3 * np.eye(M)
    noise = CorrelatedNoise(factor @ factor.T)
    points = rng.uniform(-5, 5, (6, 3))
    truth = function(points)
    data = functionals(truth) + noise.sample(rng, (M, STEPS, 6))
    prepared = Posterior(kind, points=4096).prepare(b, functionals, noise)
    np.testing.assert_array_equal(prepared.emulator.affine, [0, 1, 2])
    estimate = prepared.estimate(data)
    design = noise.whiten(functionals(function(np.eye(3)) - function(np.zeros((3, 3))))).reshape(-1, 3)
    right = noise.whiten(data - functionals(function(np.zeros((1, 3))))).reshape(-1, 6)
    covariance = np.linalg.inv(design.T @ design)
    mean = covariance @ design.T @ right
    assert np.sqrt(np.diag(covariance)).max() < 3  # the ends are far
    tolerance = 0.02 if kind == "sampled" else 0.01
    deviation = np.sqrt(np.diag(covariance))
    assert np.abs((estimate.parameters.values - mean) / deviation[:, None]).max() < 2 * tolerance
    np.testing.assert_allclose(estimate.parameters.deviation, np.repeat(deviation[:, None], 6, 1), rtol=tolerance)
    np.testing.assert_allclose(
        estimate.parameters.covariance, np.repeat(covariance[None], 6, 0), atol=2 * tolerance * covariance.max()
    )
    # The state is affine in the parameters, and so are its quantities.
    # Reported means have the prior itself in place of its Gaussian, which pulls a little.
    apart = 1e-8 if kind == "sampled" else 1e-4
    np.testing.assert_allclose(
        estimate.state(), function(estimate.parameters.values.T), atol=apart * np.abs(truth).max()
    )
    quantity = Weighted(rng.standard_normal((2, 42)))
    along = quantity.weights @ (function(np.eye(3)) - function(np.zeros((3, 3)))).mean(axis=1)
    dense = np.sqrt(np.einsum("sp,pq,sq->s", along, covariance, along))
    np.testing.assert_allclose(estimate.standard_deviation(quantity), np.repeat(dense[:, None], 6, 1), rtol=tolerance)
    low, high = estimate.interval(quantity, 0.9)
    np.testing.assert_allclose((high - low) / 2, np.repeat(1.645 * dense[:, None], 6, 1), rtol=0.04)
    residual = ((right - design @ mean) ** 2).sum(axis=0)
    np.testing.assert_allclose(estimate.misfit.statistic, residual, rtol=0.02)
    np.testing.assert_allclose(estimate.misfit.freedom, M * STEPS - 3, rtol=1e-5)


@pytest.mark.parametrize("sigma", [1.0, 5.0])
def test_a_curved_posterior_is_that_of_quadrature(sigma, functionals):
    b, function = curved()
    rng = np.random.default_rng(5)
    truth = function(b.parameters.sample(rng, 2))
    data = functionals(truth) + sigma * rng.standard_normal((M, STEPS, 2))
    prepared = Posterior(points=4096, tolerance=1e-5).prepare(b, functionals, WhiteNoise(1.0))
    np.testing.assert_array_equal(prepared.emulator.affine, [1])
    estimate = prepared.estimate(data, sigma)
    quantity = Weighted(rng.standard_normal((1, 42)))
    low, high = estimate.interval(quantity, 0.8)
    for k in range(2):
        points, weights, states = grid_posterior(
            function, functionals, b.parameters, data[:, :, k], sigma, 900 if sigma < 1 else 300
        )
        mean = weights @ points
        covariance = (weights[:, None] * (points - mean)).T @ (points - mean)
        deviation = np.sqrt(np.diag(covariance))
        assert np.abs((estimate.parameters.values[:, k] - mean) / deviation).max() < 0.04
        np.testing.assert_allclose(
            estimate.parameters.covariance[k], covariance, atol=0.1 * np.outer(deviation, deviation).max()
        )
        np.testing.assert_allclose(estimate.parameters.deviation[:, k], deviation, rtol=0.06)
        values = np.einsum("d,dtk->k", quantity.weights[0], states) / STEPS
        mean, spread = weights @ values, np.sqrt(weights @ (values - weights @ values) ** 2)
        assert estimate.quantity(quantity)[0, k] == pytest.approx(mean, abs=0.03 * spread)
        assert estimate.standard_deviation(quantity)[0, k] == pytest.approx(spread, rel=0.05)
        order = values.argsort()
        heights = np.cumsum(weights[order])
        for found, level in ((low, 0.1), (high, 0.9)):
            assert found[0, k] == pytest.approx(values[order][np.searchsorted(heights, level)], abs=0.1 * spread)
        # The mean of the states, not the state of the mean.
        wanted = np.tensordot(states, weights, axes=1)
        assert (
            np.abs(estimate.state()[:, :, k] - wanted).max()
            < 0.05 * np.sqrt((weights * (states - wanted[:, :, None]) ** 2).sum(axis=2)).max()
        )


def test_nothing_is_learned_of_logarithms_that_nothing_pins(functionals):
    b, function = curved()
    data = functionals(function(np.array([[3.0, 1.0], [11.0, 0.4]])))
    estimate = Posterior("laplace").prepare(b, functionals, WhiteNoise(1.0)).estimate(data, 1e6)
    np.testing.assert_allclose(estimate.parameters.values, np.array([[6.5], [1.0]]) * np.ones(2), rtol=0.01)
    np.testing.assert_allclose(estimate.parameters.learned, 0.0, atol=0.01)
    half = Posterior("laplace").prepare(b, functionals, WhiteNoise(1.0)).estimate(data, 5.0)
    assert half.parameters.learned.min() >= 0


def test_what_nothing_pins_keeps_its_range(functionals):
    b, function = affine([(-1.0, 1.0), (2.0, 5.0)])
    prepared = Posterior().prepare(b, functionals, WhiteNoise(1.0))
    data = functionals(function(np.array([[0.3, 4.0]])))
    estimate = prepared.estimate(data, 1e6)
    np.testing.assert_allclose(estimate.parameters.values[:, 0], [0.0, 3.5], atol=0.02)
    np.testing.assert_allclose(estimate.parameters.deviation[:, 0], [2 / 12**0.5, 3 / 12**0.5], rtol=0.02)
    np.testing.assert_allclose(estimate.parameters.learned, 0.0, atol=0.03)
    # Quantiles of a uniform distribution.
    row = np.random.default_rng(6).standard_normal((1, 42))
    values = [Weighted(row).weights @ function(np.array([p]))[:, :, 0].mean(axis=1) for p in ([-1, 3.5], [1, 3.5])]
    assert estimate.uncertainty.points.min() >= -1
    assert estimate.uncertainty.points.max() <= 1
    assert np.isfinite(values).all()


def test_exact_data_give_the_truth_back(functionals):
    b, function = curved()
    points = b.parameters.sample(np.random.default_rng(7), 20)
    truth = function(points)
    for kind in ("sampled", "laplace"):
        estimate = (
            Posterior(kind, tolerance=1e-6).prepare(b, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.0)
        )
        np.testing.assert_allclose(estimate.parameters.values, points.T, rtol=1e-4, atol=1e-4)
        assert np.abs(estimate.state() - truth).max() < 1e-4 * np.abs(truth).max()
        assert np.isfinite(estimate.standard_deviation(Weighted(np.eye(42)[:2]))).all()


def test_deviations_are_right_on_average(functionals):
    b, function = curved()
    rng = np.random.default_rng(8)
    count, sigma = 250, 1.5
    points = b.parameters.sample(rng, count)
    truth = function(points)
    data = functionals(truth) + sigma * rng.standard_normal((M, STEPS, count))
    estimate = Posterior(points=1024).prepare(b, functionals, WhiteNoise(1.0)).estimate(data, sigma)
    quantity = Weighted(rng.standard_normal((3, 42)))
    want = np.einsum("sd,dtk->sk", quantity.weights, truth) / STEPS
    error = estimate.quantity(quantity) - want
    ratio = (error / estimate.standard_deviation(quantity)) ** 2
    assert np.abs(np.sqrt(ratio.mean(axis=1)) - 1).max() < 0.12
    low, high = estimate.interval(quantity, 0.9)
    assert np.abs(((low <= want) & (want <= high)).mean(axis=1) - 0.9).max() < 0.05
    z = (estimate.parameters.values - points.T) / estimate.parameters.deviation
    assert np.abs(np.sqrt((z**2).mean(axis=1)) - 1).max() < 0.12
    assert estimate.misfit.ratio.mean() == pytest.approx(1, abs=0.03)
    assert not estimate.misfit.alarm.any()


def test_intervals_do_not_depend_on_what_was_asked_before(functionals):
    b, function = curved()
    data = functionals(function(b.parameters.sample(np.random.default_rng(19), 3)))
    prepared = Posterior(points=128).prepare(b, functionals, WhiteNoise(1.0))
    one, other = Weighted(np.eye(42)[:2]), Weighted(np.eye(42)[30:32])
    estimate = prepared.estimate(data, 2.0)
    asked = [estimate.interval(each, level) for each, level in ((one, 0.9), (other, 0.9), (one, 0.5), (one, 0.9))]
    fresh = prepared.estimate(data, 2.0).interval(other, 0.9)
    np.testing.assert_array_equal(asked[0], asked[3])
    np.testing.assert_array_equal(asked[1], fresh)
    assert (asked[2][0] > asked[0][0]).all()
    assert (asked[2][1] < asked[0][1]).all()


def test_data_of_another_model_raise_an_alarm(functionals):
    b, function = curved()
    truth = function(b.parameters.sample(np.random.default_rng(9), 3))
    truth[::3] *= 1.4
    estimate = Posterior("laplace").prepare(b, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.05)
    assert estimate.misfit.alarm.all()


def test_all_times_are_estimated_from_some(functionals):
    b, function = curved()
    points = b.parameters.sample(np.random.default_rng(10), 5)
    truth = function(points)
    prepared = Posterior("laplace", tolerance=1e-6).prepare(b, functionals, WhiteNoise(1.0), np.array([3, 1]))
    estimate = prepared.estimate(functionals(truth)[:, [3, 1]], 1e-3)
    np.testing.assert_array_equal(estimate.steps, np.arange(STEPS))
    assert np.abs(estimate.state() - truth).max() < 1e-2
    assert prepared.inf_sup.shape == (2,)


def test_series_beyond_one_piece_are_estimated_as_alone(functionals):
    b, function = curved()
    rng = np.random.default_rng(11)
    data = functionals(function(b.parameters.sample(rng, 600))) + rng.standard_normal((M, STEPS, 600))
    scales = rng.uniform(0.5, 2, 600)
    prepared = Posterior("laplace").prepare(b, functionals, WhiteNoise(1.0))
    every = prepared.estimate(data, scales)
    some = prepared.estimate(data[:, :, [0, 255, 256, 599]], scales[[0, 255, 256, 599]])
    np.testing.assert_allclose(every.coefficients[:, :, [0, 255, 256, 599]], some.coefficients, rtol=1e-6, atol=1e-7)
    quantity = Weighted(np.eye(42)[:1])
    np.testing.assert_allclose(
        every.standard_deviation(quantity)[:, [0, 255, 256, 599]], some.standard_deviation(quantity), rtol=1e-6
    )


def test_two_sets_of_parameters_that_fit_are_both_found_and_said(functionals, caplog):
    rng = np.random.default_rng(12)
    parameters = ParameterSpace((Parameter("a", "1", -1.0, 1.0),))
    mean, even, odd = rng.standard_normal((3, 42, STEPS, 1))
    odd[:28] = 0.0  # what is measured, u, does not see the sign

    def function(points):
        return mean + even * points[:, 0] ** 2 + odd * points[:, 0]

    b = background_of(function, parameters)
    prepared = Posterior().prepare(b, functionals, WhiteNoise(1.0))
    with caplog.at_level(logging.WARNING):
        estimate = prepared.estimate(functionals(function(np.array([[0.7]]))), 0.05)
    assert "1 of 1 series have more than one set of parameters" in caplog.text
    assert estimate.parameters.values[0, 0] == pytest.approx(0, abs=0.05)
    assert estimate.parameters.deviation[0, 0] == pytest.approx(0.7, abs=0.02)


def test_the_emulation_that_stops_early_says_so_and_claims_less(functionals, caplog):
    b, function = curved(bend=6.0)
    with caplog.at_level(logging.WARNING):
        rough = Posterior("laplace", solves=3).prepare(b, functionals, WhiteNoise(1.0))
    assert "raise solves" in caplog.text
    fine = Posterior("laplace").prepare(b, functionals, WhiteNoise(1.0))
    data = functionals(function(b.parameters.sample(np.random.default_rng(13), 4)))
    quantity = Weighted(np.eye(42)[:3])
    claimed = [each.estimate(data, 1e-3).standard_deviation(quantity) for each in (rough, fine)]
    assert (claimed[0] > 5 * claimed[1]).all()


def test_a_background_without_a_forward_map_is_refused(functionals):
    b, _ = curved()
    for ask in (
        lambda: Posterior().prepare(replace(b, forward=None), functionals, WhiteNoise(1.0)),
        lambda: fisher(replace(b, forward=None), functionals, WhiteNoise(1.0), b.samples),
    ):
        with pytest.raises(CapabilityError, match=r"train with training\.method = 'reduced'"):
            ask()


@pytest.mark.parametrize(
    ("settings", "says"),
    [({"points": 10}, "points: got 10"), ({"starts": 0}, "starts: got 0"), ({"tolerance": 1.5}, "tolerance: got 1.5")],
)
def test_wrong_settings_are_refused(settings, says):
    with pytest.raises(ShapeError, match=says):
        Posterior(**settings)


def test_fisher_information_is_that_of_the_dense_formula(functionals):
    b, function = affine([(-1.0, 1.0), (2.0, 5.0), (0.0, 3.0)])
    noise = WhiteNoise(0.4)
    points = np.array([[0.2, 3.0, 1.0], [1.0, 5.0, 0.0]])  # the second at the ends of the ranges
    made = fisher(b, functionals, noise, points, np.array([1.0, 3.0]), np.array([0, 2]))
    design = functionals(function(np.eye(3)) - function(np.zeros((3, 3))))[:, [0, 2]].reshape(-1, 3) / 0.4
    for k, scale in enumerate((1.0, 3.0)):
        dense = design.T @ design / scale**2
        bound = np.sqrt(np.diag(np.linalg.inv(dense)))
        np.testing.assert_allclose(made.deviations(prior=False)[:, k], bound, rtol=1e-6)
        prior = np.array([2.0, 3.0, 3.0]) / 12**0.5
        covariance = np.linalg.inv(dense + np.diag(prior**-2.0))
        np.testing.assert_allclose(made.deviations()[:, k], np.sqrt(np.diag(covariance)), rtol=1e-6)
        quantity = Weighted(np.eye(42)[20:22])
        along = quantity.weights @ (function(np.eye(3)) - function(np.zeros((3, 3)))).mean(axis=1)
        want = np.sqrt(np.einsum("sp,pq,sq->s", along, covariance, along))
        np.testing.assert_allclose(made.quantity_deviations(quantity)[:, k], want, rtol=1e-6)


def test_directions_that_no_data_see_are_named(functionals):
    rng = np.random.default_rng(14)
    parameters = ParameterSpace(tuple(Parameter(name, "1", -1.0, 1.0) for name in "ab"))
    seen, hidden = rng.standard_normal((2, 42, STEPS, 1))

    def function(points):  # only a + b moves anything that is measured
        return (
            seen * (points[:, 0] + points[:, 1])
            + np.where(np.arange(42) < 28, 0, 1)[:, None, None] * hidden * points[:, 0]
        )

    b = background_of(function, parameters)
    made = fisher(b, functionals, WhiteNoise(0.1), np.zeros((1, 2)))
    (unseen,) = made.unseen()
    np.testing.assert_allclose(np.abs(unseen), [[0.5**0.5, 0.5**0.5]], rtol=1e-6)
    assert unseen[0, 0] * unseen[0, 1] < 0
    assert np.isinf(made.deviations(prior=False)).all()
    with pytest.raises(ShapeError, match="noise_scale: got 0"):
        fisher(b, functionals, WhiteNoise(0.1), np.zeros((1, 2)), 0.0)


@pytest.mark.parametrize("density", ["emulated", "exact"])
def test_a_chain_finds_the_same_posterior(density, functionals):
    b, function = curved()
    rng = np.random.default_rng(15)
    points = b.parameters.sample(rng, 2)
    truth, sigma = function(points), 2.0
    data = functionals(truth) + sigma * rng.standard_normal((M, STEPS, 2))
    prepared = Posterior(points=4096, tolerance=1e-5).prepare(b, functionals, WhiteNoise(1.0))
    ours = prepared.estimate(data, sigma)
    chain = Chain(walkers=40, steps=700, discard=150, thin=2, density=density)
    theirs = posterior_by_chain(prepared, data, sigma, 1, chain)
    off = (ours.parameters.values - theirs.parameters.values) / theirs.parameters.deviation
    assert np.abs(off).max() < 0.2
    np.testing.assert_allclose(ours.parameters.deviation, theirs.parameters.deviation, rtol=0.15)
    short = Chain(walkers=8, steps=20, discard=5, thin=1, density=density)
    first, again, other = (posterior_by_chain(prepared, data, sigma, seed, short).coefficients for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_limits_say_what_the_best_estimate_could_do(functionals):
    b = ParametricPopulation(np.random.default_rng(16), Points(14), STEPS).background(np.random.default_rng(17), 40)
    rng = np.random.default_rng(18)
    points = b.parameters.sample(rng, 4)
    truth = b.forward.population.trajectories(points)
    sigma = 0.3
    data = functionals(truth) + sigma * rng.standard_normal((M, STEPS, 4))
    prepared = Posterior().prepare(b, functionals, WhiteNoise(1.0))
    row = Weighted(rng.standard_normal((1, 42)))
    values = {"row": np.einsum("sd,dtk->sk", row.weights, truth) / STEPS}
    found = limits(prepared, data, sigma, points, {"row": row}, values, 1, Chain(32, 300, 100, 2))
    assert found.parameters.shape == (4, 4)
    assert len(found.unseen) == 4
    ours = np.sqrt(((prepared.estimate(data, sigma).quantity(row) - values["row"]) ** 2).mean())
    assert ours == pytest.approx(found.rms("row"), rel=0.15)
    claimed = found.posterior.standard_deviation(row)
    assert 0.5 < (found.bounds["row"] / claimed).mean() < 2


def test_a_chain_that_keeps_nothing_is_refused(functionals):
    for wrong in ({"walkers": 3}, {"discard": 2000}, {"thin": 0}):
        with pytest.raises(ShapeError, match="expected"):
            Chain(**wrong)
