"""Minimum variance against the dense Gaussian formulas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dacore.core.noise import CorrelatedNoise, SensorNoise, WhiteNoise
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.testing.backgrounds import Population, Weighted
from tests.spaces import Chain, functionals_of, random_background, random_functionals


def setting(seed, m=11):
    rng = np.random.default_rng(seed)
    space = Chain(14)
    return rng, space, random_background(rng, space), random_functionals(rng, space, m)


def noise_of(rng, kind, m):
    """A noise model and its covariance."""
    if kind == "white":
        return WhiteNoise(0.4), 0.16 * np.eye(m)
    if kind == "sensors":
        sigmas = rng.uniform(0.1, 2.0, m)
        return SensorNoise(sigmas), np.diag(sigmas**2)
    factor = rng.standard_normal((m, m)) + 3 * np.eye(m)
    return CorrelatedNoise(factor @ factor.T), factor @ factor.T


def dense_posterior(states, operator, covariance, data):
    """Mean and covariance of the Gaussian posterior, by the textbook."""
    mean = states.mean(axis=1)
    prior = np.cov(states)
    gain = prior @ operator.T @ np.linalg.inv(operator @ prior @ operator.T + covariance)
    return mean + gain @ (data - operator @ mean), prior - gain @ operator @ prior


@given(
    seed=st.integers(0, 2**31),
    kind=st.sampled_from(["white", "sensors", "correlated"]),
    window=st.sampled_from(["cycle", "step"]),
    scale=st.floats(0.3, 5.0),
)
def test_estimate_and_variance_are_the_gaussian_posterior(seed, kind, window, scale):
    rng, space, background, functionals = setting(seed)
    m, t = functionals.count, 5
    noise, covariance = noise_of(rng, kind, m)
    data = rng.standard_normal((m, t, 1))
    estimate = (
        MinimumVariance(window=window, floor=1e-12, deviations="model")
        .prepare(background, functionals, noise)
        .estimate(data, scale)
    )
    states = background.lift(background.coefficients)
    operator = functionals.matrix.toarray()
    weights = rng.standard_normal(space.n_dofs)
    reduced = background.observe(functionals_of(weights[None]).matrix)
    found = estimate.state(series=0)
    if window == "step":
        for k in range(t):
            mean, posterior = dense_posterior(states[:, k], operator, scale**2 * covariance, data[:, k, 0])
            assert np.allclose(found[:, k], mean, atol=1e-7)
            on_modes = np.zeros((1, t, background.dimension))
            on_modes[0, k] = reduced
            variance = estimate.uncertainty.variance(on_modes, None)[0, 0]
            assert np.isclose(variance, weights @ posterior @ weights, rtol=1e-6)
    else:
        stacked = states.swapaxes(0, 1).reshape(t * space.n_dofs, -1)
        big = np.kron(np.eye(t), operator)
        mean, posterior = dense_posterior(
            stacked, big, np.kron(np.eye(t), scale**2 * covariance), data[:, :, 0].T.ravel()
        )
        assert np.allclose(found.T.ravel(), mean, atol=1e-7)
        along = np.tile(weights / t, t)
        on_modes = np.repeat(reduced[:, None] / t, t, axis=1)
        variance = estimate.uncertainty.variance(on_modes, None)[0, 0]
        assert np.isclose(variance, along @ posterior @ along, rtol=1e-6)


@given(seed=st.integers(0, 2**31))
def test_exact_data_of_a_training_trajectory_recover_it(seed):
    _, _, background, functionals = setting(seed, m=20)
    states = background.lift(background.coefficients[:, :, 3])
    estimate = (
        MinimumVariance(floor=1e-10)
        .prepare(background, functionals, WhiteNoise())
        .estimate(functionals(states)[:, :, None], 0.0)
    )
    assert np.abs(estimate.state(series=0) - states).max() < 1e-5 * np.abs(states).max()


def test_huge_noise_gives_the_prior_mean_and_its_spread():
    rng, _, background, functionals = setting(1)

    class First(QuantityOfInterest):
        over_time = "mean"

        def functionals(self, space):
            return functionals_of(np.eye(space.n_dofs)[-1:])

    data = 100 * rng.standard_normal((functionals.count, 5, 2))
    estimate = MinimumVariance(deviations="model").prepare(background, functionals, WhiteNoise(1e9)).estimate(data)
    prior = background.lift(background.mean())
    assert np.allclose(estimate.state(series=0), prior, atol=1e-5)
    values = background.lift(background.coefficients)[-1].mean(axis=0)
    assert np.allclose(estimate.standard_deviation(First()), values.std(ddof=1), rtol=1e-6)
    low, high = estimate.interval(First(), 0.9)
    assert np.allclose((high - low) / 2, 1.6448536 * values.std(ddof=1), rtol=1e-6)


def test_noise_scale_differs_between_series():
    rng, _, background, functionals = setting(2)
    data = np.repeat(rng.standard_normal((functionals.count, 5, 1)), 2, axis=2)
    prepared = MinimumVariance().prepare(background, functionals, WhiteNoise())
    both = prepared.estimate(data, np.array([0.1, 2.0])).state()
    for k, scale in enumerate((0.1, 2.0)):
        assert np.allclose(both[..., k], prepared.estimate(data[:, :, :1], scale).state(series=0))


@given(seed=st.integers(0, 2**31), kind=st.sampled_from(["white", "sensors", "correlated"]))
def test_masked_estimate_equals_one_prepared_on_the_valid_functionals(seed, kind):
    rng, _, background, functionals = setting(seed)
    noise, _ = noise_of(rng, kind, functionals.count)
    mask = np.arange(functionals.count) % 3 != 0
    data = rng.standard_normal((functionals.count, 5, 1))
    gaps = data.copy()
    gaps[~mask] = np.inf
    found = MinimumVariance().prepare(background, functionals, noise).estimate(gaps, mask=mask)
    fewer = functionals_of(functionals.matrix.toarray()[mask])
    reference = MinimumVariance().prepare(background, fewer, noise.marginal(mask)).estimate(data[mask])
    assert np.allclose(found.state(), reference.state(), atol=1e-9)


def test_observed_steps_may_be_a_subset():
    rng, _, background, functionals = setting(4)
    steps = np.array([1, 3])
    data = rng.standard_normal((functionals.count, 2, 1))
    estimate = MinimumVariance(window="step").prepare(background, functionals, WhiteNoise(), steps).estimate(data)
    full = MinimumVariance(window="step").prepare(background, functionals, WhiteNoise())
    padded = np.zeros((functionals.count, 5, 1))
    padded[:, steps] = data
    assert np.allclose(estimate.state(), full.estimate(padded).state(step=steps))


@given(seed=st.integers(0, 2**31), kind=st.sampled_from(["white", "sensors", "correlated"]))
def test_a_few_observed_steps_tell_of_all(seed, kind):
    """The dense Gaussian posterior of the whole trajectory, given data at two of its five times."""
    rng, space, background, functionals = setting(seed)
    m, t, steps = functionals.count, 5, np.array([3, 1])
    noise, covariance = noise_of(rng, kind, m)
    data = rng.standard_normal((m, 2, 1))
    prepared = MinimumVariance(floor=1e-12, deviations="model").prepare(background, functionals, noise, steps)
    estimate = prepared.estimate(data, 0.8)
    states = background.lift(background.coefficients).swapaxes(0, 1).reshape(t * space.n_dofs, -1)
    rows = np.kron(np.eye(t)[steps], functionals.matrix.toarray())
    mean, posterior = dense_posterior(
        states, rows, np.kron(np.eye(2), 0.64 * covariance), data[:, :, 0].T.ravel()
    )  # fmt: skip
    assert np.array_equal(estimate.steps, np.arange(5))
    assert prepared.inf_sup.shape == (2,)
    assert np.allclose(estimate.state(series=0).T.ravel(), mean, atol=1e-7)
    weights = rng.standard_normal(space.n_dofs)
    quantity = Weighted(weights[None])
    along = np.tile(weights / t, t)
    assert np.isclose(estimate.standard_deviation(quantity)[0, 0] ** 2, along @ posterior @ along, rtol=1e-6)
    ready = prepared.readout(quantity, 0.8)
    assert ready.gain.shape == (1, m, 2)
    assert np.allclose(ready(data), estimate.quantity(quantity), rtol=1e-9, atol=1e-12)
    assert np.isclose(ready.deviation[0], estimate.standard_deviation(quantity)[0, 0], rtol=1e-9)


@pytest.mark.parametrize("window", ["cycle", "step"])
@pytest.mark.parametrize("scale", [0.0, 0.7])
def test_taking_functionals_away_is_preparing_without_them(window, scale):
    """Few and many of them, and such that hardly anything is left; several masks of one estimator."""
    rng, space, _, _ = setting(2)
    background, functionals = random_background(rng, space, samples=20), random_functionals(rng, space, 30)
    noise = SensorNoise(rng.uniform(0.1, 2.0, 30))
    prepared = MinimumVariance(window=window).prepare(background, functionals, noise)
    data = functionals(background.lift(background.coefficients[:, :, :3])) + scale * noise.sample(rng, (30, 5, 3))
    quantity = Weighted(rng.standard_normal((2, space.n_dofs)))
    for mask in (np.arange(30) != 4, np.arange(30) % 3 == 0, np.arange(30) < 2):
        found = prepared.estimate(data, scale, mask)
        alone = MinimumVariance(window=window).prepare(
            background, functionals_of(functionals.matrix.toarray()[mask]), noise.marginal(mask)
        )
        want = alone.estimate(data[mask], scale)
        assert np.allclose(found.state(), want.state(), rtol=1e-6, atol=1e-6)
        assert np.allclose(found.standard_deviation(quantity), want.standard_deviation(quantity), rtol=1e-5)
        assert np.allclose(found.misfit.ratio, want.misfit.ratio, rtol=1e-3)


def test_full_rank_does_not_blow_up():
    """As many directions as samples, every functional twice, no noise: unseen cases are still found."""
    rng = np.random.default_rng(8)
    space = Chain(14)
    population = Population(rng, space)
    for samples in (9, 12, 60):
        background = population.background(rng, samples=samples)
        rows = random_functionals(rng, space, 28).matrix.toarray()
        functionals = functionals_of(np.concatenate([rows, rows, 1e-3 * rows]))
        truth = population.draw(rng, 5)
        for window in ("cycle", "step"):
            prepared = MinimumVariance(window=window).prepare(background, functionals, WhiteNoise())
            found = prepared.estimate(functionals(truth), 0.0).state()
            guess = background.lift(background.mean())[:, :, None]
            assert np.linalg.norm(found - truth) < np.linalg.norm(guess - truth)
            # 45 directions of the whole trajectory, 9 of a step.
            if samples > 45 or (window == "step" and samples > 9):
                assert np.linalg.norm(found - truth) < 1e-4 * np.linalg.norm(guess - truth)


def test_bad_settings_are_refused():
    rng, space, background, functionals = setting(0)
    with pytest.raises(ShapeError, match="floor"):
        MinimumVariance(floor=0.0)
    with pytest.raises(ShapeError, match="at least 2"):
        MinimumVariance().prepare(random_background(rng, space, samples=1), functionals, WhiteNoise())
    with pytest.raises(ShapeError, match="noise_scale"):
        MinimumVariance().prepare(background, functionals, WhiteNoise()).estimate(np.zeros((11, 5, 1)), -1.0)


def test_exact_data_are_trusted_as_far_as_the_training_set_represents_unseen_cases():
    """A trajectory of the training distribution: the claimed deviation is of the size of the error."""
    rng = np.random.default_rng(5)
    space = Chain(14)
    # Rank 9 in all: twelve samples represent unseen ones of the same nine modes exactly, six do not.
    rich, poor = (random_background(np.random.default_rng(6), space, samples=k) for k in (40, 5))
    functionals = random_functionals(rng, space, 20)
    floors = [MinimumVariance().prepare(b, functionals, WhiteNoise()).floors[0] for b in (rich, poor)]
    largest = MinimumVariance().prepare(poor, functionals, WhiteNoise()).factors[0].s[0]
    assert floors[0] < floors[1]
    assert 1e-3 * largest < floors[1] < largest


@given(seed=st.integers(0, 2**31), window=st.sampled_from(["cycle", "step"]), scale=st.floats(0.1, 3.0))
def test_claimed_variance_is_that_of_held_out_errors_and_of_noise(seed, window, scale):
    """Against estimators prepared without the held-out trajectories, and unit errors of each value."""
    rng, _, background, functionals = setting(seed)
    settings = MinimumVariance(window=window, floor=1e-9)
    prepared = settings.prepare(background, functionals, WhiteNoise(0.7))
    probe = functionals_of(rng.standard_normal((2, background.space.n_dofs)))
    weights = np.array([0.2, 0, 0.5, 0, 0.3])
    on_modes = np.einsum("t,sr->str", weights, background.observe(probe.matrix))
    data = rng.standard_normal((functionals.count, 5, 1))
    claimed = prepared.estimate(data, scale).uncertainty.variance(on_modes, None)[:, 0]
    total = np.zeros(2)
    for fold in range(8):
        mask = np.arange(background.n_samples) % 8 == fold
        fewer = replace(
            background, coefficients=background.coefficients[:, :, ~mask], samples=background.samples[~mask]
        )
        without = settings.prepare(fewer, functionals, WhiteNoise(0.7))
        for k in np.flatnonzero(mask):
            states = background.lift(background.coefficients[:, :, k])
            found = without.estimate(functionals(states)[:, :, None], scale).state(series=0)
            total += (probe(states - found) @ weights) ** 2 / background.n_samples
    zero = prepared.estimate(np.zeros((functionals.count, 5, 1)), scale).state(series=0)
    for i in range(functionals.count):
        for t in range(5):
            data = np.zeros((functionals.count, 5, 1))
            data[i, t] = 0.7 * scale
            total += (probe(prepared.estimate(data, scale).state(series=0) - zero) @ weights) ** 2
    assert np.allclose(claimed, total, rtol=1e-5, atol=1e-12)
