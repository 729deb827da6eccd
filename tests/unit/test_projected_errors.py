"""Errors in small coordinates are those of the lifted states, to round-off; and where they cannot be, states are."""

import numpy as np
import pytest

from dacore.algebra.compress import compress
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.model import Trajectory
from dacore.core.noise import WhiteNoise
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.studies.errors import Contrast, ErrorMeter, ProjectedErrors
from dacore.studies.noisy import NoisyData
from dacore.studies.outcomes import PRIOR
from dacore.studies.reference import measure, project
from dacore.studies.validation import Judge, gather, joint_weights
from dacore.testing.backgrounds import Population, Weighted
from tests.spaces import Chain, functionals_of, random_functionals

ESTIMATORS = {
    "pbdw": PBDW(n=4, weights={"p": 3.0}, centring="phase", spaces="phase"),
    "uncentred": PBDW(n=6, weights={"u": 0.25, "p": 1e-3}, centring="none", spaces="cycle"),
    "plain": PBDW(n=4, weights={"p": 3.0}, correction=False),
    "mv": MinimumVariance(),
}


class Case:
    """A training set of large fields that hardly vary, unseen cases, and functionals of one field or both."""

    def __init__(self, seed=0, both=False, kind="l2", tolerance=1e-4):
        rng = np.random.default_rng(seed)
        self.space = Chain(14)
        population = Population(rng, self.space)
        population.mean = 30.0 * population.mean
        times = np.arange(1.0, 6.0)
        one = population.draw(rng, 12)
        parameters = ParameterSpace((Parameter("a", "1", 0.0, 1.0),))
        trajectories = [Trajectory(one[:, :, k], times) for k in range(12)]
        self.background = compress(self.space, trajectories, parameters, rng.random((12, 1)), tolerance, kind)
        states = population.draw(rng, 4)
        self.truths = [Trajectory(states[:, :, k], times) for k in range(4)]
        self.functionals = random_functionals(rng, self.space)
        if both:
            self.functionals = functionals_of(rng.standard_normal((11, self.space.n_dofs)))
        self.quantities = {"q": Weighted(rng.standard_normal((1, self.space.n_dofs)))}
        self.contrasts = [Contrast("p − c", "p", 25.0)]
        self.measured = measure(self.space, self.functionals, self.truths, self.quantities)
        self.noisy = NoisyData.drawn(self.measured.data, [0.0, 0.1], 3)
        self.meter = ErrorMeter(self.space, "l2", self.contrasts, joint_weights(self.background))
        self.asked = 0

    def states(self):
        self.asked += 1
        return self.truths

    def projected(self):
        reference = project(self.background, self.functionals, self.truths, self.contrasts)
        return ProjectedErrors(self.background, self.functionals, reference)

    def judge(self, projected):
        return Judge(self.measured, self.quantities, self.meter, projected, self.states)

    def prepared(self, name):
        return ESTIMATORS[name].prepare(self.background, self.functionals, WhiteNoise(1.0))


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_errors_are_those_of_the_lifted_states(name, both):
    case = Case(both=both)
    prepared = case.prepared(name)
    small = case.judge(case.projected()).judge(name, prepared, case.noisy)
    assert case.asked == 0
    lifted = case.judge(None).judge(name, prepared, case.noisy)
    assert case.asked == 1
    for one, other in zip(small.outcomes, lifted.outcomes, strict=True):
        assert set(one.per_step) == {"u", "p", "p − c", "joint"}
        for label, values in other.per_step.items():
            assert values.min() > 1e-6
            assert np.allclose(one.per_step[label], values, rtol=1e-10, atol=0.0)
            assert np.allclose(one.space_time[label], other.space_time[label], rtol=1e-10, atol=0.0)
        assert np.allclose(one.quantities["q"].estimate, other.quantities["q"].estimate, rtol=1e-12)


def test_the_guess_of_the_mean_is_judged_alike():
    case = Case()
    one, other = (case.judge(each).prior(case.background) for each in (case.projected(), None))
    assert one.estimate is None
    for label, values in other.per_step.items():
        assert np.allclose(one.per_step[label], values, rtol=1e-12, atol=0.0)


def test_tiny_errors_meet_round_off_of_the_state_not_of_its_square():
    """An exact estimate: its error is the compression's, 1e-10 of the state, and neither way finds it larger."""
    case = Case(tolerance=1e-10)
    coefficients = np.stack([case.background.project(t.states) for t in case.truths], axis=2)
    projected = case.projected()
    found = projected.norms(Estimate(case.background, np.arange(5), coefficients))
    for field in ("u", "p"):
        assert (found[field] <= 1e-9 * projected.reference.norms[field]).all()


def test_what_a_correction_mends_wholly_leaves_a_hundred_millionth_of_it():
    """Functionals that see everything: PBDW's correction makes the state exact, and only round-off is left."""
    case = Case()
    rng = np.random.default_rng(5)
    n = case.space.n_dofs
    case.functionals = functionals_of(rng.standard_normal((n, n)) + 8.0 * np.eye(n))
    case.measured = measure(case.space, case.functionals, case.truths, {})
    prepared = PBDW(n=2, weights={"p": 1.0}).prepare(case.background, case.functionals, WhiteNoise(1.0))
    estimate = prepared.estimate(case.measured.data, 0.0)
    projected = case.projected()
    mended, plain = (
        projected.norms(each) for each in (estimate, Estimate(case.background, estimate.steps, estimate.coefficients))
    )
    for field in ("u", "p"):
        assert (mended[field] < 1e-6 * plain[field]).all()


def test_an_estimate_of_another_product_or_of_other_data_is_lifted():
    case = Case()
    projected = case.projected()
    estimate = case.prepared("pbdw").estimate(case.noisy.data[0.1])
    assert projected.covers(estimate)
    others = random_functionals(np.random.default_rng(7), case.space)
    foreign = PBDW(n=4, weights={"p": 3.0}).prepare(case.background, others, WhiteNoise(1.0))
    assert not projected.covers(foreign.estimate(others(np.stack([t.states for t in case.truths], axis=2))))
    b = case.background
    twin = Background(b.space, b.bases, b.coefficients, b.times, b.parameters, b.samples, b.kind, b.compression)
    assert not projected.covers(Estimate(twin, estimate.steps, estimate.coefficients))


def test_without_fields_only_quantities_are_judged():
    case = Case()
    judge = Judge(case.measured, case.quantities)
    judged = {"mv": judge.judge("mv", case.prepared("mv"), case.noisy)}
    found = gather(judge.prior(case.background), judged, case.noisy, (), joint_weights(case.background))
    assert found.headline == ""
    assert found.best(["mv"], 0.1).estimator == "mv"
    assert found.outcome(PRIOR, 0.1).per_step == {}
    assert case.asked == 0
    truth = np.stack([case.quantities["q"].weights @ t.states.mean(axis=1) for t in case.truths], axis=1)
    assert np.allclose(found.outcome("mv", 0.1).quantities["q"].truth, truth)
