"""Rules for n and λ: what they minimise, by brute force."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.core.noise import WhiteNoise
from dacore.errors import ShapeError
from dacore.estimators.dimension import cross_validated, discrepant, expected_errors
from dacore.estimators.frames import balanced_weights
from dacore.estimators.pbdw import PBDW
from tests.spaces import Chain, random_background, random_functionals

M, SIGMA = 11, 0.3


@pytest.fixture(scope="module")
def stand():
    rng = np.random.default_rng(0)
    space = Chain(14)
    return space, random_background(rng, space, samples=16), random_functionals(rng, space, M)


FITS = {"exact": {}, "plain": {"correction": False}, "regularised": {"fit": "regularised", "missed": 0.8},
        "noise_weighted": {"fit": "noise_weighted"}}  # fmt: skip


def without_modes(prepared):
    """Make the prepared estimator one of n = 0: the offset and its correction."""
    prepared.dimensions = np.zeros_like(prepared.dimensions)


def brute(space, background, functionals, settings, scale, n):
    """Mean squared error, fields balanced, without each trajectory's group, and what unit noise makes."""
    training = background.coefficients
    weights = balanced_weights(background, training - training.mean(axis=2, keepdims=True))
    mass = space.inner_product(weights)
    missed = noise = 0.0
    for fold in range(8):
        mask = np.arange(16) % 8 == fold
        fewer = replace(background, coefficients=training[:, :, ~mask], samples=background.samples[~mask])
        prepared = replace(settings, n=max(n, 1)).prepare(fewer, functionals, WhiteNoise(SIGMA))
        if not n:
            without_modes(prepared)
        states = background.lift(training[:, :, mask])
        away = prepared.estimate(functionals(states), scale).state() - states
        missed += np.einsum("itk,itk->", away, np.tensordot(mass.toarray(), away, axes=1)) / 16
        zero = prepared.estimate(np.zeros((M, 5, 1)), scale).state()
        for i in range(M):
            data = np.zeros((M, 5, 1))
            data[i] = SIGMA
            # Steps do not mix, so one unit at each of them shows all.
            change = (prepared.estimate(data, scale).state() - zero)[:, :, 0]
            noise += np.einsum("it,it->", change, mass @ change) / 8
    return missed, noise


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("spaces", ["cycle", "phase"])
@pytest.mark.parametrize("fit", FITS)
def test_expected_errors_are_those_of_estimators_without_the_trajectory(stand, fit, spaces):
    space, background, functionals = stand
    # One λ, of a power of ten, so that no rounding of it matters.
    settings = PBDW(n="noise", weights={"p": 0.4}, spaces=spaces, max_dimension=5, **FITS[fit])
    scale = 0.8 * np.sqrt(0.1) if fit == "regularised" else 0.5
    prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
    ratio = 0.1 if fit == "regularised" else 0.0
    choice = prepared.choice
    missed, noise = expected_errors(
        prepared.without, choice.observed, choice.coefficients, choice.balance, choice.mend, ratio, 5
    )
    want = np.array([brute(space, background, functionals, settings, scale, n) for n in range(6)])
    assert np.allclose(missed.sum(axis=0), want[:, 0], rtol=1e-6)
    # What the correction makes of noise is counted up to a constant.
    assert np.allclose(np.diff(noise.sum(axis=0)), np.diff(want[:, 1]), rtol=1e-6, atol=1e-9)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("scale", [0.0, 0.3, 3.0, 1e4])
def test_the_rule_takes_the_least_expected_error(stand, scale):
    space, background, functionals = stand
    settings = PBDW(n="noise", weights={"p": 0.4}, spaces="cycle", max_dimension=5)
    prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
    want = np.array([brute(space, background, functionals, settings, scale, n) for n in range(6)])
    chosen = prepared.choose(np.zeros((M, 5, 2)), scale)
    assert chosen.tolist() == [[int(np.argmin(want[:, 0] + scale**2 * want[:, 1]))] * 2]
    assert (scale < 1e4) or not chosen.any()


@pytest.mark.filterwarnings("ignore")
def test_each_series_has_the_dimension_of_its_noise(stand):
    _, background, functionals = stand
    prepared = PBDW(n="noise", weights={"p": 0.4}).prepare(background, functionals, WhiteNoise(SIGMA))
    rng = np.random.default_rng(1)
    data, scale = rng.standard_normal((M, 5, 3)), np.array([0.0, 10.0, 0.3])
    chosen = prepared.choose(data, scale)
    assert (chosen[:, 1] <= chosen[:, 2]).all()
    assert (chosen[:, 2] <= chosen[:, 0]).all()
    assert chosen[:, 1].sum() < chosen[:, 0].sum()
    whole = prepared.estimate(data, scale).state()
    for k in range(3):
        alone = prepared.estimate(data[:, :, [k]], scale[k]).state()
        assert np.allclose(alone[..., 0], whole[..., k], atol=1e-10)


@pytest.mark.filterwarnings("ignore")
def test_cross_validation_and_discrepancy_follow_their_definitions(stand):
    """Residuals of dense least squares, of each n, at the noise that is there."""
    _, background, functionals = stand
    rng = np.random.default_rng(2)
    data = functionals(background.lift(background.coefficients[:, :, :4])) + SIGMA * rng.standard_normal((M, 5, 4))
    for rule in ("gcv", "discrepancy"):
        settings = PBDW(n=rule, weights={"p": 0.4}, spaces="cycle", centring="phase", max_dimension=6)
        prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
        modes = functionals.matrix @ background.lift(prepared.frames[0].modes)
        shifted = (data - functionals(background.lift(prepared.offset))[:, :, None]).reshape(M, -1) / SIGMA
        left = np.empty((6, 4))
        for n in range(1, 7):
            c, *_ = np.linalg.lstsq(modes[:, :n], shifted, rcond=None)
            left[n - 1] = ((shifted - modes[:, :n] @ c) ** 2).reshape(M, 5, 4).sum(axis=(0, 1))
        free = (M - np.arange(1, 7))[:, None]
        if rule == "gcv":
            want = np.argmin(left / free**2, axis=0) + 1
        else:
            meets = left <= 5 * free + 4 * np.sqrt(10 * free)
            want = np.where(meets.any(axis=0), np.argmax(meets, axis=0) + 1, 6)
        assert prepared.choose(data, 1.0)[0].tolist() == want.tolist()


def test_discrepancy_takes_the_largest_where_none_is_good_enough():
    squares = np.array([9.0, 8.0, 7.0, 6.0])[:, None, None] * np.ones((4, 2, 2))
    assert discrepant(squares, 11, 3, np.array([0.0, 5.0])).tolist() == [3, 1]
    assert cross_validated(squares, 11, 3).tolist() == [1, 1]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("rule", ["gcv", "discrepancy"])
def test_weights_from_the_data_follow_their_definitions(stand, rule):
    """Misfit and trace of the dense influence matrix, for every λ that is tried."""
    _, background, functionals = stand
    rng = np.random.default_rng(3)
    n, scale = 3, 1.3
    data = functionals(background.lift(background.coefficients[:, :, :2])) + SIGMA * rng.standard_normal((M, 5, 2))
    settings = PBDW(n=n, fit="regularised", missed=rule, weights={"p": 0.4}, tails="training")
    prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
    turned = prepared.projection.turned(data)
    found = prepared.ratios(np.full((5, 2), n), np.full(2, scale), turned)
    gram = prepared.riesz.gram / SIGMA**2
    ratios = np.logspace(-8.0, 4.0, 25) * np.linalg.eigvalsh(gram).max()
    squares, free = np.zeros((25, 2)), np.zeros(25)
    for number, ratio in enumerate(ratios):
        for step in range(5):
            seen = functionals.matrix @ background.lift(prepared.frames[step].modes[:, :n]) / SIGMA
            right = (data[:, step] - functionals(background.lift(prepared.offset[:, step]))[:, None]) / SIGMA
            inverse = np.linalg.inv(gram + ratio * np.eye(M))
            influence = ratio * (inverse - inverse @ seen @ np.linalg.solve(seen.T @ inverse @ seen, seen.T @ inverse))
            squares[number] += ((influence @ right) ** 2).sum(axis=0)
            free[number] += np.trace(influence)
    if rule == "gcv":
        want = ratios[np.argmin(squares / free[:, None] ** 2, axis=0)]
    else:
        meets = squares <= 5 * (M - n) * scale**2
        want = np.array([ratios[np.flatnonzero(column).max(initial=0)] for column in meets.T])
    assert np.allclose(found, want[None], rtol=1e-10)


@pytest.mark.filterwarnings("ignore")
def test_a_family_of_estimates_is_that_of_each_dimension(stand):
    _, background, functionals = stand
    data = np.random.default_rng(4).standard_normal((M, 5, 2))
    mask = np.arange(M) % 4 != 0
    settings = PBDW(n="noise", weights={"p": 0.4}, max_dimension=6)
    prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
    for flags in (None, mask):
        family = dict(prepared.estimate_each(data, 0.5, [1, 3, 5], flags))
        assert list(family) == [1, 3, 5]
        for n, estimate in family.items():
            alone = replace(settings, n=n).prepare(background, functionals, WhiteNoise(SIGMA))
            want = alone.estimate(data, 0.5, flags)
            assert np.allclose(estimate.state(), want.state(), atol=1e-9)
            assert np.allclose(estimate.misfit.statistic, want.misfit.statistic, rtol=1e-6)
    with pytest.raises(ShapeError, match="dimensions: got 7"):
        prepared.estimate_each(data, 0.5, [7])


def test_too_few_trajectories_to_hold_out_are_refused():
    rng = np.random.default_rng(5)
    space = Chain(14)
    background, functionals = random_background(rng, space, samples=2), random_functionals(rng, space, M)
    with pytest.raises(ShapeError, match="n: got 'noise' with 2"):
        PBDW(n="noise", weights={"p": 1.0}).prepare(background, functionals, WhiteNoise())
    with pytest.raises(ShapeError, match="missed: got 'held_out'"):
        PBDW(n=1, fit="regularised", weights={"p": 1.0}).prepare(background, functionals, WhiteNoise()).estimate(
            np.zeros((M, 5, 1))
        )


@pytest.mark.filterwarnings("ignore")
def test_noise_alone_leaves_the_mean_in_a_box_too(stand):
    _, background, functionals = stand
    data = 1e4 * np.random.default_rng(3).standard_normal((M, 5, 2))
    for box in (None, 1.0):
        settings = PBDW(n="noise", weights={"p": 0.4}, correction=False, box=box)
        prepared = settings.prepare(background, functionals, WhiteNoise(SIGMA))
        estimate = prepared.estimate(data, 1e4 / SIGMA)
        mean = background.lift(background.mean()[:, :, None])
        assert np.allclose(estimate.state(), mean, atol=1e-9), box
