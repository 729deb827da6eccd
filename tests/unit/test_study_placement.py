"""Placement: criteria against their definitions, greedy against trying everything."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from dacore.algebra.gram import RieszMap, lower_solve, orthonormaliser
from dacore.algebra.stability import inf_sup_constants
from dacore.core.background import ParametricMap
from dacore.core.noise import WhiteNoise
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.studies.placement import by_plane, by_site, groups_of, place, values_of
from dacore.studies.placement_stability import Stability, stability_of
from dacore.studies.placement_variance import (
    LocalModel,
    PosteriorDeviation,
    parameter_models,
    training_model,
    typical_sigma,
)
from dacore.testing.backgrounds import Weighted
from tests.spaces import Chain, functionals_of, random_background, random_functionals

GROUPS = groups_of(np.repeat(np.arange(6), 2))


class Case:
    def __init__(self, seed=0, m=12, samples=14):
        rng = np.random.default_rng(seed)
        self.space = Chain(14)
        self.background = random_background(rng, self.space, samples)
        self.functionals = random_functionals(rng, self.space, m)
        self.quantities = {"q": Weighted(rng.standard_normal((1, self.space.n_dofs))),
                           "each": Weighted(rng.standard_normal((1, self.space.n_dofs)), "each")}  # fmt: skip


def variance_criterion(case, sigma=0.5, groups=GROUPS):
    return PosteriorDeviation([training_model(case.background, case.functionals, groups, case.quantities, sigma)])


def stable(case, n=4):
    return stability_of(case.background, case.functionals, GROUPS, n, {"p": 2.0})


def beta_of(case, chosen, n):
    """β_n of some groups from the estimator's own parts."""
    rows = np.sort(np.concatenate([GROUPS[c] for c in chosen]))
    functionals = functionals_of(case.functionals.matrix.toarray()[rows])
    (space,) = PBDW(n=n, weights={"p": 2.0}, centring="cycle", spaces="cycle").prepare(
        case.background, functionals, WhiteNoise(1.0)
    ).spaces()  # fmt: skip
    return space.inf_sup[n - 1]


@pytest.mark.parametrize("seed", range(3))
def test_stability_is_that_of_the_estimator(seed):
    case = Case(seed)
    criterion = stable(case)
    for order in ([0, 3, 5], [5, 1, 0, 2], range(6)):
        values = values_of(criterion, order)
        for count in range(2, len(order) + 1):
            assert values[count] == pytest.approx(beta_of(case, list(order)[:count], 4), rel=1e-8)
        assert (values[:2] == 0).all()


def test_stability_of_leading_modes_decides_until_there_are_as_many_functionals_as_modes():
    rng = np.random.default_rng(1)
    observed = rng.standard_normal((12, 5))
    observed /= np.linalg.norm(observed, 2) * 1.1
    root = rng.standard_normal((12, 12))
    gram = root @ root.T + np.eye(12)
    criterion = Stability(gram, observed, GROUPS)

    def leading(chosen, n):
        rows = np.concatenate([GROUPS[c] for c in chosen])
        factor = orthonormaliser(gram[np.ix_(rows, rows)], tuple(map(str, rows)))
        return inf_sup_constants(lower_solve(factor, observed[rows]))[n - 1]

    state = criterion.nothing()
    for chosen, n in (((), 2), ((2,), 4), ((2, 0), 5)):
        for candidate in set(range(6)) - set(chosen):
            assert criterion.merit(state, candidate) == pytest.approx(leading((*chosen, candidate), n), rel=1e-9)
        state = criterion.add(state, {0: 2, 1: 0}.get(len(chosen), 1))


def test_a_small_candidate_does_not_hide_that_a_large_one_sees_the_whole_space():
    case = Case()
    groups = groups_of(np.repeat(np.arange(4), [1, 5, 1, 5]))
    criterion = stability_of(case.background, case.functionals, groups, 4, {"p": 2.0})
    placed = place(criterion, 2)
    assert placed.values[1] == placed.best[1] > 0
    assert placed.choices[1] == (placed.order[0],)


def test_a_repeated_or_almost_repeated_measurement_adds_nothing():
    rng = np.random.default_rng(2)
    observed, root = rng.standard_normal((4, 3)) / 10, rng.standard_normal((4, 4))
    twice = np.concatenate([np.arange(4), np.arange(4)])
    gram = (root @ root.T + np.eye(4))[np.ix_(twice, twice)]
    gram = gram * np.outer(1e-9 ** (twice % 2), 1e-9 ** (twice % 2))
    observed = observed[twice] * (1e-9 ** (twice % 2))[:, None]
    criterion = Stability(gram, observed, groups_of(np.arange(8) // 4))
    values = values_of(criterion, [0, 1])
    assert values[2] == pytest.approx(values[1], rel=1e-9)
    assert criterion.add(criterion.add(criterion.nothing(), 0), 1).rank == 4


@pytest.mark.parametrize("make", [stable, variance_criterion])
@pytest.mark.parametrize("seed", range(3))
def test_greedy_is_monotone_its_first_pick_the_best_and_no_choice_beats_the_best(make, seed):
    case = Case(seed)
    criterion = make(case)
    placed = place(criterion, 6, random=12, rng=np.random.default_rng(3))
    sign = 1.0 if criterion.larger_is_better else -1.0
    assert sorted(placed.order) == list(range(6))
    np.testing.assert_array_equal(placed.values, values_of(criterion, placed.order))
    assert (np.diff(sign * placed.values) >= -1e-9).all()
    assert (np.diff(sign * placed.random, axis=1) >= -1e-9).all()
    assert (sign * placed.best >= sign * placed.values - 1e-9).all()
    assert (sign * placed.best >= sign * placed.random - 1e-9).all()
    for size in range(1, 7):
        every = {choice: values_of(criterion, choice)[-1] for choice in combinations(range(6), size)}
        best = max(sign * value for value in every.values())
        assert sign * placed.best[size] == pytest.approx(best, rel=1e-9)
        assert sign * every[placed.choices[size]] == pytest.approx(best, rel=1e-9)
    merits = [criterion.merit(criterion.nothing(), c) for c in range(6)]
    assert placed.order[0] == int(np.argmax(merits))
    if make is variance_criterion:
        assert placed.values[1] == pytest.approx(placed.best[1])
        # Better than random ones on the whole, and the merit of a candidate is what the value falls by.
        assert placed.values[1:5].sum() < np.median(placed.random[:, 1:5].sum(axis=1))
        state = criterion.add(criterion.nothing(), 2)
        for c in (0, 5):
            fall = criterion.value(state) ** 2 - criterion.value(criterion.add(state, c)) ** 2
            assert criterion.merit(state, c) == pytest.approx(fall, rel=1e-6)
    np.testing.assert_allclose(placed.random[:, -1], placed.values[-1], rtol=1e-8)


def test_too_many_choices_are_not_tried():
    placed = place(variance_criterion(Case()), 3, exhaustive=10)
    assert np.isfinite(placed.best[:2]).all()
    assert np.isnan(placed.best[2:]).all()
    assert placed.choices[2:] == ((), ())
    assert placed.random.shape == (0, 4)


def test_deviation_is_the_posterior_of_minimum_variance():
    case = Case()
    sigma = 0.5
    criterion = variance_criterion(case, sigma)
    settings = MinimumVariance(floor=1e-12, deviations="model")
    rows = np.sort(np.concatenate([GROUPS[1], GROUPS[4]]))
    functionals = functionals_of(case.functionals.matrix.toarray()[rows])
    prepared = settings.prepare(case.background, functionals, WhiteNoise(1.0))
    data = functionals(case.background.lift(case.background.mean()))[:, :, None]
    estimate = prepared.estimate(data, sigma)
    expected = np.concatenate([estimate.standard_deviation(q)[:, 0] for q in case.quantities.values()])
    state = criterion.add(criterion.add(criterion.nothing(), 4), 1)
    np.testing.assert_allclose(criterion.deviations(state), expected, rtol=1e-6)
    prior = criterion.deviations(criterion.nothing())
    np.testing.assert_allclose(criterion.prior, prior)
    assert criterion.value(state) == pytest.approx(np.sqrt(np.mean((expected / prior) ** 2)))
    assert values_of(criterion, [])[0] == pytest.approx(1.0)


class Quadratic(ParametricMap):
    """Trajectories of a, ln b and their product; central differences of it are exact."""

    def __init__(self, pieces):
        self.pieces = pieces

    def coefficients(self, points):
        a, b = points[:, 0], np.log(points[:, 1])
        return np.tensordot(self.pieces, np.stack([a, b, a * b, a**2]), axes=1)

    @property
    def accuracy(self):
        return {}


def test_information_of_parameters_is_that_of_the_derivatives():
    case = Case()
    parameters = ParameterSpace(
        (Parameter("a", "1", 1.0, 3.0), Parameter("c", "1", 5.0, 5.0), Parameter("b", "1", 1.0, 100.0, "log_uniform"))
    )
    background = replace(case.background, parameters=parameters, samples=np.ones((14, 3)))
    rng = np.random.default_rng(4)
    pieces = rng.standard_normal((background.dimension, 5, 4))
    forward = Quadratic(pieces)
    forward.coefficients = lambda points: Quadratic(pieces).coefficients(points[:, [0, 2]])
    points = np.array([[2.0, 5.0, 10.0], [1.0, 5.0, 100.0]])
    models = parameter_models(background, forward, case.functionals, GROUPS, case.quantities, 0.3, points)
    a_unit, b_unit = 2.0 / np.sqrt(12), np.log(100.0) / np.sqrt(12)
    observed = background.observe(case.functionals.matrix)
    for model, (a, b) in zip(models, ((2.0, np.log(10.0)), (1.0 + 1e-2 * a_unit, np.log(100.0) - 1e-2 * b_unit))):
        slopes = np.stack(
            [(pieces @ [1, 0, b, 2 * a]) * a_unit, (pieces @ [0, 1, a, 0]) * b_unit], axis=-1
        )  # fmt: skip
        for group, factor in zip(GROUPS, model.factors, strict=True):
            jacobian = np.tensordot(observed[group], slopes, axes=1).reshape(-1, 2) / 0.3
            np.testing.assert_allclose(factor.T @ factor, jacobian.T @ jacobian, rtol=1e-8)
    criterion = PosteriorDeviation(models)
    state = criterion.add(criterion.nothing(), 3)
    total = [np.linalg.inv(np.eye(2) + m.factors[3].T @ m.factors[3]) for m in models]
    expected = np.mean([np.einsum("sd,de,se->s", m.targets, c, m.targets) for m, c in zip(models, total)], axis=0)
    np.testing.assert_allclose(criterion.deviations(state), np.sqrt(expected), rtol=1e-8)


def test_a_candidate_that_says_nothing_is_taken_last():
    rng = np.random.default_rng(5)
    factors = (np.zeros((3, 4)), rng.standard_normal((2, 4)), rng.standard_normal((9, 4)))
    criterion = PosteriorDeviation([LocalModel(factors, rng.standard_normal((2, 4)))])
    placed = place(criterion, 3)
    assert placed.order[-1] == 0
    assert placed.values[2] == placed.values[3] < placed.values[1] < 1.0


def test_candidates_are_sites_or_planes():
    case = Case()
    centres = np.array([[0.0, 1.0], [0.0, 2.0], [0.0, 1.0 + 1e-9], [0.0, 2.0]])
    some = replace(
        functionals_of(case.functionals.matrix.toarray()[:4]), centres=centres, directions=0 * centres,
        sites=np.array([7, 5, 7, 6]),
    )  # fmt: skip
    assert [list(each) for each in by_site(some)] == [[1], [3], [0, 2]]
    positions, planes = by_plane(some, 1)
    np.testing.assert_allclose(positions, [1.0, 2.0])
    assert [list(each) for each in planes] == [[0, 2], [1, 3]]


def test_typical_sigma_is_the_level_of_the_largest_value():
    case = Case()
    values = case.functionals(case.background.lift(case.background.coefficients))
    expected = 0.1 * np.median(np.abs(values).max(axis=(0, 1)))
    assert typical_sigma(case.background, case.functionals, 0.1) == pytest.approx(expected)


def test_gram_of_the_helper_is_that_of_the_representers():
    case = Case()
    criterion = stable(case)
    gram = RieszMap(case.space, case.functionals, {"u": 1.0, "p": 2.0}).gram
    np.testing.assert_allclose(criterion.nothing().gram, gram)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: place(variance_criterion(c), 7), "picks: got 7, expected 1 to 6"),
        (lambda c: place(variance_criterion(c), 1, random=2), "need a random generator"),
        (lambda c: variance_criterion(c, 0.0), "sigma: got"),
        (lambda c: variance_criterion(c, groups=(np.array([0, 1]), np.array([1]))), "none of them twice"),
        (lambda c: variance_criterion(c, groups=(np.array([12]),)), "numbers from 0 to 11"),
        (lambda c: variance_criterion(c, groups=()), "or an empty one"),
        (lambda c: stability_of(c.background, c.functionals, GROUPS, 99), "dimension: got 99"),
        (lambda c: Stability(np.eye(3), np.ones((4, 2)), GROUPS), "gram: got shape"),
        (lambda c: values_of(stable(c), [1, 1]), "is chosen already"),
        (lambda c: by_plane(c.functionals, 1), "axis: got 1"),
        (lambda c: PosteriorDeviation([]), "at least one model"),
        (lambda c: PosteriorDeviation([LocalModel((np.ones((1, 2)),), np.ones((1, 3)))]), "matrices with 3 columns"),
        (lambda c: PosteriorDeviation([LocalModel((np.ones((1, 2)),), np.zeros((1, 2)))]), "does not vary"),
        (lambda c: training_model(c.background, c.functionals, GROUPS, {}, 1.0), "quantities: got none"),
    ],
)
def test_what_cannot_be_placed_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make(Case())
