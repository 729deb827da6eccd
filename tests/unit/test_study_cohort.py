"""Cohorts: independent streams, errors against lifted states, numbers that depend on no worker and no chunk."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.algebra.compress import compress
from dacore.core.background import ParametricMap
from dacore.core.estimator import Estimate, Estimator, ParameterEstimate, PreparedEstimator, Uncertainty
from dacore.core.misfit import Misfit
from dacore.core.model import Trajectory
from dacore.core.noise import WhiteNoise
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.errors import CapabilityError, ShapeError, WorkerError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.studies.cohort import Group, draw_patients, measured
from dacore.studies.cohort_estimates import estimate_cohort
from dacore.studies.errors import Contrast, ErrorMeter
from dacore.studies.span_errors import SpanErrors
from dacore.studies.validation import joint_weights
from dacore.testing.backgrounds import Weighted
from tests.spaces import Chain, functionals_of, random_functionals

PARAMETERS = ParameterSpace(
    (Parameter("a", "1", 1.0, 2.0), Parameter("b", "1", 0.1, 10.0, "log_uniform"), Parameter("c", "1", 3.0, 3.0))
)
LOW, HIGH = Group("low", {"a": (1.0, 1.2)}), Group("high", {"a": (1.8, 2.0)})
CONTRAST = Contrast("p − c", "p", 25.0)


class Polynomial(ParametricMap):
    """Trajectories that are polynomials of the parameters."""

    def __init__(self, pieces):
        self.pieces = pieces

    def coefficients(self, points):
        a, b = points[:, 0], np.log(points[:, 1])
        return np.tensordot(self.pieces, np.stack([np.ones_like(a), a, b, a * b, a**2]), axes=1)

    @property
    def accuracy(self):
        return {"u": 1e-3, "p": 2e-3}


class Case:
    def __init__(self, seed=0, samples=24, steps=5):
        rng = np.random.default_rng(seed)
        self.space = Chain(14)
        states = rng.standard_normal((self.space.n_dofs, steps, 5))
        states[:, :, 0] += np.repeat([0.0, 30.0], [28, 14])[:, None]
        points = PARAMETERS.sample(rng, samples)
        times = np.arange(1.0, steps + 1)
        whole = Polynomial(states).coefficients(points)
        training = compress(self.space, [Trajectory(whole[:, :, k], times) for k in range(samples)], PARAMETERS, points,
                            1e-12)  # fmt: skip
        self.background = replace(training, forward=Polynomial(training.project(states)))
        self.functionals = random_functionals(rng, self.space)
        self.quantities = {"q": Weighted(rng.standard_normal((2, self.space.n_dofs)), "each"),
                           "mean": Weighted(rng.standard_normal((1, self.space.n_dofs)))}  # fmt: skip

    def prepared(self, settings, steps=None):
        return settings.prepare(self.background, self.functionals, WhiteNoise(1.0), steps)

    def run(self, prepared, patients, levels=(0.0, 0.1), **options):
        return estimate_cohort(
            self.background, self.functionals, prepared, patients, self.quantities, levels, [CONTRAST], **options
        )


@pytest.fixture(scope="module")
def case():
    return Case()


def everything(cohort):
    for outcome in cohort.outcomes:
        yield outcome.sigmas
        yield from outcome.errors.values()
        yield from outcome.guess_errors.values()
        for claims in outcome.quantities.values():
            yield from (claims.truth, claims.estimate, claims.deviation, claims.quantiles)
        if outcome.misfit is not None:
            yield from (outcome.misfit.statistic, outcome.misfit.freedom)
        if outcome.parameters is not None:
            yield from (outcome.parameters.values, outcome.parameters.covariance, outcome.parameters.prior)


def test_groups_narrow_ranges_and_more_patients_change_nobody():
    few, more = (draw_patients(PARAMETERS, [LOW, HIGH], counts, 7) for counts in ((4, 3), (9, 8)))
    assert few.names == ("low",) * 4 + ("high",) * 3
    np.testing.assert_array_equal(few.samples[few.members("low")], more.samples[more.members("low")][:4])
    np.testing.assert_array_equal(few.samples[few.members("high")], more.samples[more.members("high")][:3])
    assert (more.samples[more.members("low"), 0] <= 1.2).all()
    assert (more.samples[more.members("high"), 0] >= 1.8).all()
    assert np.ptp(np.log(more.samples[:, 1])) > 2
    assert (more.samples[:, 2] == 3.0).all()
    assert len(np.unique(more.samples[:, 1])) == 17
    other = draw_patients(PARAMETERS, [LOW, HIGH], (4, 3), 8)
    assert (other.samples[:, 1] != few.samples[:, 1]).all()


def test_noise_is_a_patients_own_and_of_the_level_of_the_largest_value(case):
    few, more = (draw_patients(PARAMETERS, [LOW, HIGH], counts, 7) for counts in ((2, 2), (40, 2)))
    observed = case.background.observe(case.functionals.matrix)
    data = []
    for patients in (few, more):
        found = measured(case.background.forward, observed, patients.samples)
        values, sigmas = found.noisy(patients, np.arange(patients.count), 0.1)
        np.testing.assert_allclose(sigmas, 0.1 * np.abs(found.clean).max(axis=(0, 1)))
        data.append((values, found.clean, sigmas))
    np.testing.assert_allclose(data[0][0], data[1][0][:, :, [0, 1, 40, 41]], rtol=1e-12)
    white = (data[1][0] - data[1][1]) / data[1][2]
    assert white.std() == pytest.approx(1.0, abs=0.05)
    assert len(np.unique(white)) == white.size
    np.testing.assert_array_equal(found.noisy(more, np.arange(42), 0.0)[0], found.clean)


def test_errors_are_those_of_lifted_states(case):
    patients = draw_patients(PARAMETERS, [Group("all")], [6], 1)
    truth = case.background.forward.coefficients(patients.samples)
    data = case.functionals(case.background.lift(truth))
    weights = joint_weights(case.background)
    meter = ErrorMeter(case.space, "l2", [CONTRAST], weights)
    errors = SpanErrors(case.background, case.functionals, truth, [CONTRAST], weights)
    other = functionals_of(case.functionals.matrix.toarray())
    estimates = [
        case.prepared(MinimumVariance()).estimate(data, 0.1),
        case.prepared(PBDW(n=3, weights={"p": 2.0})).estimate(data, 0.1),
        # Of functionals that are not known to be the same, states are lifted.
        PBDW(n=3, weights={"p": 2.0}).prepare(case.background, other, WhiteNoise(1.0)).estimate(data, 0.1),
        case.prepared(MinimumVariance(), np.array([1, 3])).estimate(data[:, [1, 3]], 0.1),
    ]
    for estimate in estimates:
        found = errors(estimate)
        assert set(found) == {"u", "p", "p − c", "joint"}
        for k in range(6):
            states = case.background.lift(truth[:, estimate.steps, k])
            table = meter.errors(states - estimate.state(series=k), meter.reference(states))
            for label, (above, below) in table.items():
                expected = np.sqrt((above**2).sum() / (below**2).sum())
                assert found[label][k] == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ShapeError, match="got 2 series, expected 6"):
        errors(Estimate(case.background, np.arange(5), truth[:, :, :2]))


def test_a_cohort_is_what_estimating_one_by_one_gives(case):
    patients = draw_patients(PARAMETERS, [LOW, HIGH], [5, 4], 3)
    prepared = {"mv": case.prepared(MinimumVariance()), "pbdw": case.prepared(PBDW(n=3))}
    cohort = case.run(prepared, patients, chunk=4)
    assert [(each.estimator, each.noise) for each in cohort.outcomes] == [
        ("mv", 0.0), ("pbdw", 0.0), ("mv", 0.1), ("pbdw", 0.1)
    ]  # fmt: skip
    observed = case.background.observe(case.functionals.matrix)
    found = cohort.outcome("mv", 0.1)
    for k in range(9):
        one = measured(case.background.forward, observed, patients.samples[[k]])
        data, sigma = one.noisy(patients, np.array([k]), 0.1)
        estimate = prepared["mv"].estimate(data, sigma)
        claims = found.quantities["q"]
        np.testing.assert_allclose(claims.estimate[:, [k]], estimate.quantity(case.quantities["q"]), rtol=1e-9)
        np.testing.assert_allclose(
            claims.deviation[:, [k]], estimate.standard_deviation(case.quantities["q"]), rtol=1e-9
        )
        truth = case.quantities["q"].weights @ case.background.lift(one.coefficients[:, :, 0])
        np.testing.assert_allclose(claims.truth[:, k], truth.ravel(), rtol=1e-9)
        low, high = estimate.interval(case.quantities["q"], 0.95)
        np.testing.assert_allclose(claims.interval(0.95)[0][:, [k]], low, rtol=1e-9)
        np.testing.assert_allclose(claims.interval(0.95)[1][:, [k]], high, rtol=1e-9)
    values = case.quantities["mean"].weights @ case.background.lift(case.background.coefficients).mean(axis=1)
    np.testing.assert_allclose(cohort.guess["mean"][0], values.mean())
    np.testing.assert_allclose(cohort.guess["mean"][1], values.std(ddof=1))
    # Estimates from exact data are better than a guess; a deviation is claimed by one of the two only.
    exact = cohort.outcome("mv", 0.0)
    assert all((exact.errors[label] < 0.5 * exact.guess_errors[label]).all() for label in exact.errors)
    assert cohort.accuracy == {"u": 1e-3, "p": 2e-3}
    with pytest.raises(ShapeError, match=r"level: got 0[.]42, expected one of"):
        found.quantities["q"].interval(0.42)
    with pytest.raises(ShapeError, match=r"none of 'mv' at noise 0[.]3"):
        cohort.outcome("mv", 0.3)


def test_observed_steps_see_the_noise_that_all_steps_would(case):
    patients = draw_patients(PARAMETERS, [Group("all")], [3], 3)
    steps = np.array([0, 2])
    settings = {"pbdw": PBDW(n=3), "mv": MinimumVariance()}
    part = case.run({name: case.prepared(one, steps) for name, one in settings.items()}, patients, steps=steps)
    whole = case.run({name: case.prepared(one) for name, one in settings.items()}, patients)
    truth = whole.outcome("mv", 0.1).quantities["q"].truth
    for name in settings:
        np.testing.assert_array_equal(part.outcome(name, 0.1).sigmas, whole.outcome(name, 0.1).sigmas)
    # One estimates the observed steps, the other knows how times go together: each is held against its own.
    np.testing.assert_allclose(part.outcome("pbdw", 0.1).quantities["q"].truth, truth[[0, 2, 5, 7]], rtol=1e-12)
    np.testing.assert_allclose(part.outcome("mv", 0.1).quantities["q"].truth, truth, rtol=1e-12)


class Ensemble(Uncertainty):
    """Not Gaussian: quantiles are those of an exponential above the centre."""

    def variance(self, on_modes, on_correction):
        return np.ones((len(on_modes), self.count))

    def quantile(self, centre, level, on_modes, on_correction):
        return centre - np.log1p(-level)


class Guess(Estimator):
    """The mean, with everything an estimate may carry."""

    def prepare(self, background, functionals, noise, steps=None):
        return PreparedGuess(background)


class PreparedGuess(PreparedEstimator):
    def __init__(self, background, locked=False, certain=False):
        self.background, self.locked, self.certain = background, locked, certain

    @property
    def inf_sup(self):
        return np.full(5, np.nan)

    def __getstate__(self):
        if self.locked:
            raise TypeError("cannot pickle 'factor' object")
        return self.__dict__

    def estimate(self, data, noise_scale=1.0, mask=None):
        k = data.shape[2]
        uncertainty = None if self.certain else Ensemble()
        if uncertainty:
            uncertainty.count = k
        mean = np.repeat(self.background.mean()[:, :, None], k, axis=2)
        statistic = (data**2).sum(axis=(0, 1))
        parameters = ParameterEstimate(
            ("a", "b"), statistic * np.ones((2, 1)), np.tile(np.eye(2), (k, 1, 1)), np.ones(2)
        )
        misfit = Misfit(statistic, np.full(k, 3.0))
        return Estimate(self.background, np.arange(5), mean, uncertainty=uncertainty, misfit=misfit,
                        parameters=parameters)  # fmt: skip


def test_quantiles_misfits_and_parameters_of_an_estimator_are_its_own(case):
    patients = draw_patients(PARAMETERS, [LOW, HIGH], [5, 4], 3)
    found = case.run({"guess": Guess().prepare(case.background, case.functionals, WhiteNoise(1.0))}, patients, chunk=2)
    outcome = found.outcome("guess", 0.1)
    claims = outcome.quantities["mean"]
    low, high = claims.interval(0.9)
    np.testing.assert_allclose(low - claims.estimate, -np.log(0.95))
    np.testing.assert_allclose(high - claims.estimate, -np.log(0.05))
    for label, values in outcome.errors.items():
        np.testing.assert_array_equal(values, outcome.guess_errors[label])
    assert outcome.misfit.statistic.shape == outcome.misfit.alarm.shape == (9,)
    assert outcome.parameters.values.shape == outcome.parameters.learned.shape == (2, 9)
    assert outcome.parameters.covariance.shape == (9, 2, 2)
    np.testing.assert_array_equal(outcome.parameters.values[1], outcome.misfit.statistic)
    plain = case.run({"guess": PreparedGuess(case.background, certain=True)}, patients, errors=False).outcomes[0]
    assert plain.errors == {}
    assert np.isnan(plain.quantities["q"].quantiles).all()
    assert np.isnan(plain.quantities["q"].deviation).all()


def test_two_workers_give_the_bits_of_one(case):
    patients = draw_patients(PARAMETERS, [LOW, HIGH], [5, 4], 3)
    prepared = {"mv": case.prepared(MinimumVariance()), "guess": PreparedGuess(case.background)}
    seen = []
    one = case.run(prepared, patients, chunk=2, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(2, 9), (4, 9), (6, 9), (8, 9), (9, 9)]
    two = case.run(prepared, patients, chunk=2, workers=2)
    for a, b in zip(everything(one), everything(two), strict=True):
        np.testing.assert_array_equal(a, b)


def test_an_estimator_that_cannot_travel_says_so(case):
    patients = draw_patients(PARAMETERS, [LOW], [4], 3)
    with pytest.raises(WorkerError, match="cannot be sent to workers"):
        case.run({"guess": PreparedGuess(case.background, locked=True)}, patients, chunk=2, workers=2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: draw_patients(PARAMETERS, [Group("x", {"a": (0.5, 1.5)})], [1], 0), "a part of the range of training"),
        (lambda: draw_patients(PARAMETERS, [Group("x", {"d": (0.5, 1.5)})], [1], 0), "parameter 'd'"),
        (lambda: draw_patients(PARAMETERS, [LOW, LOW], [1, 1], 0), "no name twice"),
        (lambda: draw_patients(PARAMETERS, [LOW], [0], 0), "at least one patient"),
        (lambda: draw_patients(PARAMETERS, [LOW], [1, 2], 0), "1 groups of \\[1, 2\\] patients"),
        (lambda: draw_patients(PARAMETERS, [LOW], [1], 0).members("none"), "expected one of low"),
        (lambda: measured(Polynomial(np.ones((3, 2, 5))), np.ones((4, 2)), np.ones((1, 3))), "modes of the background"),
        (lambda: measured(Polynomial(np.full((3, 2, 5), np.nan)), np.ones((4, 3)), np.ones((1, 3))), "NaN"),
        (lambda: measured(Polynomial(np.ones((3, 2, 5))), np.ones((4, 3)), np.ones((1, 3))).noisy(None, [0], -1.0),
         "noise level: got -1.0"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_or_measured_is_refused(make, message):
    with pytest.raises(ShapeError, match=message):
        make()


def test_a_background_without_a_map_has_no_cohort(case):
    patients = draw_patients(PARAMETERS, [LOW], [1], 0)
    bare = replace(case.background, forward=None)
    with pytest.raises(CapabilityError, match=r"training[.]method = 'reduced'"):
        estimate_cohort(bare, case.functionals, {"mv": case.prepared(MinimumVariance())}, patients, {}, [0.1])
    with pytest.raises(ShapeError, match="no noise level or no estimator"):
        case.run({}, patients)
