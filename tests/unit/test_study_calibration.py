"""Honesty of uncertainties: scores against their definitions, coverage against what is drawn."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from dacore.errors import ShapeError
from dacore.studies.calibration import (
    LEVELS,
    calibrate,
    calibrate_quantiles,
    central_probabilities,
    coverage,
    crps_ensemble,
    crps_gaussian,
    crps_quantiles,
    transform_ensemble,
    transform_quantiles,
)


def claims(rng, count, factor=1.0, shift=0.0):
    """Truths with Gaussian claims that are `factor` times as wide as they should be, and off by `shift` deviations."""
    spread = rng.uniform(0.5, 2.0, count)
    mean = 10 * rng.standard_normal(count)
    return mean + spread * rng.standard_normal(count), mean + shift * spread, factor * spread


@pytest.mark.parametrize(("truth", "mean", "deviation"), [(0.3, 0.0, 1.0), (-4.0, 1.0, 0.5), (2.0, 2.0, 3.0)])
def test_gaussian_score_is_the_integral_of_squared_differences(truth, mean, deviation):
    ends = (min(truth, mean) - 12 * deviation, truth, max(truth, mean) + 12 * deviation)
    below = quad(lambda x: norm.cdf(x, mean, deviation) ** 2, ends[0], ends[1], epsabs=1e-12)[0]
    above = quad(lambda x: (1 - norm.cdf(x, mean, deviation)) ** 2, ends[1], ends[2], epsabs=1e-12)[0]
    (found,) = crps_gaussian(np.array([truth]), np.array([mean]), np.array([deviation]))
    assert found == pytest.approx(below + above, rel=1e-8)


def test_ensemble_score_is_that_of_all_pairs():
    rng = np.random.default_rng(0)
    truth, members = rng.standard_normal(5), rng.standard_normal((7, 5)).round(1)
    near = np.abs(members - truth).mean(axis=0)
    apart = np.abs(members[:, None] - members[None]).sum(axis=(0, 1))
    np.testing.assert_allclose(crps_ensemble(truth, members, fair=False), near - 0.5 * apart / 49, atol=1e-14)
    np.testing.assert_allclose(crps_ensemble(truth, members), near - 0.5 * apart / 42, atol=1e-14)
    # Of one member it is the absolute error.
    np.testing.assert_allclose(crps_ensemble(truth, members[:1], fair=False), np.abs(members[0] - truth))


def test_fair_score_of_draws_has_the_mean_of_the_gaussian_score():
    rng = np.random.default_rng(1)
    truth = np.zeros(4000)
    members = 0.5 + 2 * rng.standard_normal((4, 4000))
    expected = crps_gaussian(truth[:1], np.array([0.5]), np.array([2.0]))[0]
    assert crps_ensemble(truth, members).mean() == pytest.approx(expected, rel=0.05)
    assert crps_ensemble(truth, members, fair=False).mean() > 1.2 * expected


def test_scores_and_transforms_of_gaussian_quantiles_are_those_of_the_gaussian():
    truth, mean, deviation = claims(np.random.default_rng(2), 400)
    chances = central_probabilities()
    quantiles = mean + norm.ppf(chances)[:, None] * deviation
    np.testing.assert_allclose(crps_quantiles(truth, chances, quantiles), crps_gaussian(truth, mean, deviation),
                               rtol=5e-3, atol=1e-3)  # fmt: skip
    np.testing.assert_allclose(
        transform_quantiles(truth, chances, quantiles), norm.cdf((truth - mean) / deviation), atol=1e-12
    )
    one, other = calibrate(truth, mean, deviation), calibrate_quantiles(truth, chances, quantiles, mean, deviation)
    np.testing.assert_allclose(one.coverage.levels, other.coverage.levels)
    np.testing.assert_array_equal(one.coverage.counts, other.coverage.counts)
    np.testing.assert_allclose(one.coverage.width, other.coverage.width)
    assert (one.bias, one.spread, one.sharpness) == pytest.approx((other.bias, other.spread, other.sharpness))


def test_transform_goes_through_the_given_quantiles_and_takes_equal_ones():
    chances = np.array([0.1, 0.5, 0.9])
    skew = np.tile(np.array([[0.0], [1.0], [10.0]]), (1, 3))
    np.testing.assert_allclose(transform_quantiles(np.array([0.0, 1.0, 10.0]), chances, skew), chances)
    between = transform_quantiles(np.array([-5.0, 5.0, 50.0]), chances, skew)
    assert 0 < between[0] < 0.1 < 0.5 < between[1] < 0.9 < between[2] <= 1
    point = np.ones((3, 3))
    np.testing.assert_allclose(
        transform_quantiles(np.array([0.0, 1.0, 2.0]), chances, point)[[0, 2]], [0.0, 1.0], atol=1e-12
    )


def test_right_claims_are_found_right_and_wrong_ones_wrong():
    rng = np.random.default_rng(3)
    right = calibrate(*claims(rng, 2000))
    assert right.coverage.consistent
    assert right.uniformity > 0.01
    assert right.spread == pytest.approx(1.0, abs=0.05)
    assert abs(right.bias) < 0.08
    narrow, wide = calibrate(*claims(rng, 2000, 0.5)), calibrate(*claims(rng, 2000, 2.0))
    assert not narrow.coverage.consistent
    assert not wide.coverage.consistent
    assert (narrow.coverage.empirical < narrow.coverage.levels).all()
    assert (wide.coverage.empirical > wide.coverage.levels).all()
    assert narrow.spread == pytest.approx(2.0, abs=0.1)
    assert wide.spread == pytest.approx(0.5, abs=0.03)
    assert max(narrow.uniformity, wide.uniformity) < 1e-6
    shifted = calibrate(*claims(rng, 2000, 1.0, 0.3))
    assert shifted.bias == pytest.approx(0.3, abs=0.08)
    # The score rewards the right claim over all of them.
    truth, mean, deviation = claims(rng, 2000)
    scores = [calibrate(truth, mean, f * deviation).crps for f in (0.5, 1.0, 2.0)]
    assert scores[1] == min(scores)


def test_coverage_counts_and_its_band_holds_binomial_counts():
    truth = np.array([0.0, 1.0, 2.0, 3.0])
    found = coverage(truth, np.array([[0.5] * 4, [-1.0] * 4]), np.array([[2.0] * 4, [5.0] * 4]), (0.5, 0.9))
    np.testing.assert_array_equal(found.counts, [2, 4])
    np.testing.assert_allclose(found.width, [1.5, 6.0])
    np.testing.assert_allclose(found.error, 0.05)
    low, high = calibrate(*claims(np.random.default_rng(4), 100)).coverage.band
    rng = np.random.default_rng(5)
    for level, a, b in zip(LEVELS, low, high, strict=True):
        share = rng.binomial(100, level, 4000) / 100
        assert 0.94 < ((share >= a - 1e-9) & (share <= b + 1e-9)).mean() < 0.999
    assert found.intervals.shape == (2, 2)


def test_right_claims_are_called_inconsistent_as_rarely_as_said():
    rng = np.random.default_rng(7)
    wrong = sum(not calibrate(*claims(rng, 60)).coverage.consistent for _ in range(400))
    assert wrong < 0.05 * 400 + 3 * np.sqrt(400 * 0.05 * 0.95)
    assert sum(not calibrate(*claims(rng, 60, 0.5)).coverage.consistent for _ in range(50)) > 45


def test_transform_of_an_ensemble_is_uniform_if_truth_is_another_member():
    rng = np.random.default_rng(6)
    members = rng.standard_normal((9, 5000))
    transform = transform_ensemble(rng.standard_normal(5000), members, rng)
    counts = np.histogram(transform, bins=10, range=(0, 1))[0]
    assert counts.min() > 420
    assert counts.max() < 580
    # Ties are spread over their places.
    tied = transform_ensemble(np.zeros(4000), np.zeros((3, 4000)), rng)
    assert tied.mean() == pytest.approx(0.5, abs=0.03)


ONES = np.ones(3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: calibrate(ONES, ONES, 0 * ONES), "3 of 3 are not positive"),
        (lambda: calibrate(ONES, ONES[:2], ONES), "mean: got shape"),
        (lambda: calibrate(ONES, np.nan * ONES, ONES), "mean: got shape"),
        (lambda: calibrate(ONES, ONES, ONES, levels=(1.0,)), "levels: got"),
        (lambda: coverage(ONES, np.ones((1, 3)), np.zeros((1, 3)), (0.5,)), "low ends at or below"),
        (lambda: coverage(ONES, np.ones((1, 3)), np.ones((1, 3)), (0.5,), 1.0), "confidence: got 1.0"),
        (lambda: calibrate_quantiles(ONES, [0.1, 0.8], np.ones((2, 3)), ONES, ONES), "symmetric"),
        (lambda: transform_quantiles(ONES, [0.5, 0.4], np.ones((2, 3))), "at least two, rising"),
        (lambda: transform_quantiles(ONES, [0.4, 0.5], -np.arange(6.0).reshape(2, 3)), "never falling"),
        (lambda: crps_ensemble(ONES, np.ones((1, 3))), "1 member"),
        (lambda: crps_ensemble(ONES, np.ones((2, 2))), "expected \\(members, 3\\)"),
    ],
)
def test_what_cannot_be_judged_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()
