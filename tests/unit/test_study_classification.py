"""Two groups told apart: areas, intervals and limits against counting and simulation."""

import numpy as np
import pytest
from scipy.stats import norm

from dacore.errors import ShapeError
from dacore.studies.calibration import central_probabilities
from dacore.studies.classification import (
    Proportion,
    attainable,
    best_threshold,
    classify,
    expected_correct,
    group_probability,
    middle,
    operating_curve,
    rule,
)
from dacore.studies.group_posterior import group_probability_quantiles

NORMAL, RAISED = (1.0e4, 1.02e4), (1.08e4, 1.1e4)


def two_groups(rng, normal, raised, shift):
    scores = np.concatenate([rng.standard_normal(normal), shift + rng.standard_normal(raised)])
    return scores, np.arange(normal + raised) >= normal


def test_area_counts_pairs_and_ties_half():
    rng = np.random.default_rng(0)
    scores = rng.integers(0, 6, 40).astype(float)
    raised = rng.random(40) < 0.4
    high, low = scores[raised][:, None], scores[~raised][None]
    pairs = (high > low).mean() + 0.5 * (high == low).mean()
    curve = operating_curve(scores, raised)
    assert curve.area == pytest.approx(pairs, abs=1e-14)
    steps = np.diff(curve.false_positive), 0.5 * (curve.true_positive[1:] + curve.true_positive[:-1])
    assert float(steps[0] @ steps[1]) == pytest.approx(pairs, abs=1e-14)
    assert (curve.false_positive[0], curve.true_positive[0]) == (0.0, 0.0)
    assert (curve.false_positive[-1], curve.true_positive[-1]) == (1.0, 1.0)


def test_delong_deviation_is_that_of_the_placements():
    rng = np.random.default_rng(1)
    scores, raised = two_groups(rng, 13, 9, 0.8)
    above = scores[raised][:, None] > scores[~raised][None]
    expected = above.mean(axis=1).var(ddof=1) / 9 + above.mean(axis=0).var(ddof=1) / 13
    assert operating_curve(scores, raised).deviation == pytest.approx(np.sqrt(expected))


@pytest.mark.parametrize("shift", [0.0, 1.0, 2.5])
def test_interval_of_the_area_holds_the_true_area_as_often_as_it_says(shift):
    rng = np.random.default_rng(2)
    true = norm.cdf(shift / np.sqrt(2))
    intervals = np.array([operating_curve(*two_groups(rng, 12, 16, shift), level=0.9).interval for _ in range(600)])
    held = ((intervals[:, 0] <= true) & (true <= intervals[:, 1])).mean()
    assert 0.86 < held < 0.97


def test_groups_apart_have_an_interval_nonetheless():
    scores, raised = np.arange(16.0), np.arange(16) >= 8
    curve = operating_curve(scores, raised)
    assert (curve.area, curve.deviation, curve.interval[1]) == (1.0, 0.0, 1.0)
    assert 0.6 < curve.interval[0] < 0.95
    more = operating_curve(np.arange(160.0), np.arange(160) >= 80)
    assert more.interval[0] > curve.interval[0]
    mirrored = operating_curve(-scores, raised)
    assert mirrored.area == 0.0
    np.testing.assert_allclose(mirrored.interval, (0.0, 1.0 - curve.interval[0]), atol=1e-9)


def test_wilson_interval_solves_its_quadratic():
    for count in (0, 1, 7, 16):
        low, high = Proportion(count, 16, 0.95).interval
        for end in (low, high):
            if 0 < end < 1:
                gap = abs(count / 16 - end) - norm.ppf(0.975) * np.sqrt(end * (1 - end) / 16)
                assert gap == pytest.approx(0.0, abs=1e-12)
        assert 0 <= low < high <= 1
    assert str(Proportion(16, 16)) == "16 of 16"


def test_best_threshold_has_the_largest_youden_index_and_the_widest_gap():
    rng = np.random.default_rng(3)
    for _ in range(30):
        scores, raised = two_groups(rng, 8, 7, 1.0)
        everywhere = np.concatenate([scores - 1e-9, scores + 1e-9])
        assert rule(scores, raised, best_threshold(scores, raised)).youden == pytest.approx(
            max(0.0, *(rule(scores, raised, each).youden for each in everywhere))
        )
    assert best_threshold(np.array([0.0, 1.0, 5.0, 6.0]), np.array([False, False, True, True])) == 3.0
    # A number that runs the wrong way is of no use: all alike.
    assert rule(np.arange(4.0), np.arange(4) < 2, best_threshold(np.arange(4.0), np.arange(4) < 2)).youden == 0.0


def test_sixteen_of_sixteen():
    rng = np.random.default_rng(4)
    pressure = np.concatenate([rng.uniform(*NORMAL, 8), rng.uniform(*RAISED, 8)])
    raised = np.arange(16) >= 8
    found = classify(pressure + 50 * rng.standard_normal(16), raised, middle(NORMAL, RAISED))
    assert middle(NORMAL, RAISED) == 1.05e4
    assert str(found.fixed.correct) == str(found.best.correct) == str(found.left_out) == "16 of 16"
    assert found.fixed.sensitivity.total == found.fixed.specificity.total == 8


def test_leaving_out_does_not_flatter_a_number_that_says_nothing():
    rng = np.random.default_rng(5)
    chosen, left_out = [], []
    for _ in range(40):
        scores, raised = two_groups(rng, 10, 10, 0.0)
        found = classify(scores, raised, 0.0)
        chosen.append(found.best.correct.value)
        left_out.append(found.left_out.value)
    assert np.mean(chosen) > 0.6
    assert np.mean(left_out) < 0.55


def test_bayes_limit_is_what_the_best_rule_does_in_simulation():
    rng = np.random.default_rng(6)
    for deviation in (150.0, 400.0, 1500.0):
        raised = rng.random(200_000) < 0.5
        true = np.where(raised, rng.uniform(*RAISED, raised.size), rng.uniform(*NORMAL, raised.size))
        seen = true + deviation * rng.standard_normal(true.size)
        limit = attainable(deviation, NORMAL, RAISED)
        assert ((seen > 1.05e4) == raised).mean() == pytest.approx(limit.correct, abs=4e-3)
        assert operating_curve(seen, raised).area == pytest.approx(limit.area, abs=5e-3)
        # The posterior of such an estimate says the same.
        chance = group_probability(seen, np.full(seen.shape, deviation), NORMAL, RAISED)
        assert expected_correct(chance) == pytest.approx(limit.correct, abs=3e-3)
        assert ((chance > 0.5) == raised).mean() == pytest.approx(limit.correct, abs=4e-3)


def test_limit_of_tiny_and_of_huge_deviations():
    tiny, huge = attainable(1e-6, NORMAL, RAISED), attainable(1e8, NORMAL, RAISED)
    assert (tiny.correct, tiny.area) == pytest.approx((1.0, 1.0), abs=1e-4)
    assert (huge.correct, huge.area) == pytest.approx((0.5, 0.5), abs=1e-4)
    assert attainable(1e8, NORMAL, RAISED, 0.1).correct == pytest.approx(0.9, abs=1e-4)


def test_group_probability_is_bayes_formula_and_stays_in_range_in_the_tails():
    mean, deviation = np.array([1.05e4, 1.03e4]), np.array([200.0, 300.0])
    mass = [norm.cdf(b, mean, deviation) - norm.cdf(a, mean, deviation) for a, b in (NORMAL, RAISED)]
    expected = 0.2 * mass[1] / (0.8 * mass[0] + 0.2 * mass[1])
    np.testing.assert_allclose(group_probability(mean, deviation, NORMAL, RAISED, 0.2), expected, rtol=1e-10)
    far = group_probability(np.array([0.0, 2e4]), np.array([1.0, 1.0]), NORMAL, RAISED)
    np.testing.assert_allclose(far, [0.0, 1.0], atol=1e-12)


def test_group_probability_of_quantiles_is_that_of_the_posterior_behind_them():
    rng = np.random.default_rng(7)
    mean, deviation = rng.uniform(1.0e4, 1.1e4, 50), rng.uniform(100, 400, 50)
    chances = central_probabilities()
    gaussian = mean + norm.ppf(chances)[:, None] * deviation
    np.testing.assert_allclose(
        group_probability_quantiles(chances, gaussian, NORMAL, RAISED, 0.3),
        group_probability(mean, deviation, NORMAL, RAISED, 0.3), rtol=1e-6, atol=1e-12,
    )  # fmt: skip
    points = np.array([[9e3, 1.01e4, 1.05e4, 1.06e4, 1.2e4]] * 2) + np.array([[-0.1], [0.1]])
    found = group_probability_quantiles([0.4, 0.6], points, NORMAL, RAISED)
    np.testing.assert_allclose(found[[0, 1, 3, 4]], [0.0, 0.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: classify(np.arange(3.0), np.zeros(3, dtype=bool), 1.0), "one group only"),
        (lambda: classify(np.array([1.0, np.nan]), np.array([True, False]), 1.0), "1 of 2 are not finite"),
        (lambda: classify(np.arange(3.0), np.array([0, 1, 1]), 1.0), "one boolean for each"),
        (lambda: middle(RAISED, NORMAL), "the first below"),
        (lambda: attainable(0.0, NORMAL, RAISED), "positive number"),
        (lambda: attainable(1.0, (1.0, 1.0), RAISED), "positive width"),
        (lambda: group_probability(np.ones(2), np.zeros(2), NORMAL, RAISED), "positive standard deviation"),
        (lambda: group_probability_quantiles([0.4, 0.6], np.ones(2), NORMAL, RAISED), "quantiles: got shape"),
        (lambda: group_probability_quantiles([0.4, 0.6], np.ones((2, 1)), NORMAL, RAISED, 1.0), "prevalence: got"),
        (lambda: expected_correct(np.array([1.2])), "from 0 to 1"),
        (lambda: Proportion(3, 2), "3 of 2"),
    ],
)
def test_what_cannot_be_judged_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()
