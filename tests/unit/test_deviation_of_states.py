"""Deviations of one state of one series: the same as of a quantity that sees that state, whoever estimates."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.core.estimator import Uncertainty
from dacore.core.noise import CorrelatedNoise, WhiteNoise
from dacore.errors import ShapeError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.estimators.posterior import Posterior
from dacore.testing.backgrounds import ParametricPopulation, Weighted, functionals_of, random_functionals
from tests.spaces import Chain

SETTINGS = {
    "minimum variance": MinimumVariance(),
    "minimum variance, each step": MinimumVariance("step"),
    "minimum variance, model": MinimumVariance(deviations="model"),
    "minimum variance, model, each step": MinimumVariance("step", deviations="model"),
    "pbdw": PBDW(n=4, spaces="cycle"),
    "pbdw, each step": PBDW(n=3),
    "pbdw without correction": PBDW(n=4, spaces="cycle", correction=False),
    "pbdw in a box": PBDW(n=4, spaces="cycle", box=1.5),
    "posterior": Posterior(points=64),
    "posterior, laplace": Posterior("laplace"),
}
STEP, SERIES = 3, 1


@pytest.fixture(scope="module")
def setting():
    rng = np.random.default_rng(4)
    space = Chain(14)
    population = ParametricPopulation(rng, space)
    background = population.background(rng, 30)
    return background, random_functionals(rng, space, 8), population.draw(rng, 3)


@pytest.mark.parametrize("name", SETTINGS)
def test_one_state_is_as_uncertain_as_a_quantity_that_sees_it_alone(setting, name):
    background, functionals, truth = setting
    root = np.random.default_rng(5).standard_normal((8, 8))
    noise = CorrelatedNoise(np.eye(8) + 0.1 * root @ root.T) if "pbdw" in name else WhiteNoise(1.0)
    data = functionals(truth) + 0.05 * np.random.default_rng(1).standard_normal((8, 5, 3))
    mask = np.arange(8) != 2
    estimate = SETTINGS[name].prepare(background, functionals, noise).estimate(data, [0.05, 0.1, 0.2], mask)
    points = functionals_of(np.eye(background.space.n_dofs)[::2])
    quantity = Weighted(points.matrix.toarray(), "each")
    every = estimate.standard_deviation(quantity).reshape(points.count, 5, 3)
    found = estimate.deviation(points.matrix, STEP, SERIES)
    np.testing.assert_allclose(found, every[:, STEP, SERIES], rtol=1e-8)
    assert (np.ptp(every, axis=2) > 0).any()  # and so would a wrong series


@pytest.mark.parametrize("name", ["minimum variance", "pbdw", "posterior"])
def test_who_has_no_way_of_its_own_puts_points_into_whole_trajectories(setting, name):
    background, functionals, truth = setting
    estimate = SETTINGS[name].prepare(background, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.1)
    rng = np.random.default_rng(2)
    on_modes = rng.standard_normal((150, background.dimension))
    on_correction = rng.standard_normal((150, 8)) if estimate.correction is not None else None
    own = estimate.uncertainty.at(STEP, SERIES, 5, on_modes, on_correction)
    plain = Uncertainty.at(estimate.uncertainty, STEP, SERIES, 5, on_modes, on_correction)
    np.testing.assert_allclose(plain, own, rtol=1e-8)


def test_the_correction_counts_where_the_field_is_measured(setting):
    background, functionals, truth = setting
    points = functionals_of(np.eye(background.space.n_dofs))
    with_it, without = (
        PBDW(n=3, correction=each).prepare(background, functionals, WhiteNoise(1.0))
        .estimate(functionals(truth), 0.5).deviation(points.matrix, 0, 0)
        for each in (True, False)
    )  # fmt: skip
    seen, hidden = (background.space.layout.block(name) for name in ("u", "p"))
    assert not np.allclose(with_it[seen], without[seen], rtol=1e-3)
    np.testing.assert_allclose(with_it[hidden], without[hidden], rtol=1e-10)


def test_without_uncertainty_there_is_none(setting):
    background, functionals, truth = setting
    estimate = MinimumVariance().prepare(background, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.1)
    with pytest.raises(ShapeError, match="carries no uncertainty"):
        replace(estimate, uncertainty=None).deviation(functionals.matrix, 0, 0)
