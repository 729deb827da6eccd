"""From reduced training to the posterior, on a poroelastic rod."""

import numpy as np
import pytest

from dacore.core.noise import WhiteNoise
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.training import draw
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.posterior import Posterior
from dacore.reduction.greedy import Settings
from dacore.reduction.training import train_reduced
from dacore.testing.backgrounds import Weighted, functionals_of
from tests.rods import rod

N, CASES = 30, 24


@pytest.fixture(scope="module")
def setting():
    model = MarchedModel(rod(N), TimeGrid(0.02, 15), Newmark(), "zero", tolerance=1e-12)
    samples = draw(model.parameters, 80, "latin_hypercube", 3)

    def solve(motions, numbers):
        return [motions.solve(model.parameters.as_mapping(samples[number])) for number in numbers]

    reduced = train_reduced(model, model.parameters, samples, solve, Settings(1e-5), 1e-9)
    points = draw(model.parameters, CASES, "uniform", 5)
    truth = np.stack([model.solve(model.parameters.as_mapping(row)).states for row in points], axis=2)
    functionals = functionals_of(np.eye(2 * N)[[6, 12, 18, 24, 29]])  # u at some points; p is not measured
    return reduced.background, points, truth, functionals


def test_the_map_is_emulated_as_well_as_it_says(setting):
    b, points, truth, functionals = setting
    emulator = Posterior().prepare(b, functionals, WhiteNoise(1.0)).emulator
    assert emulator.coordinates.names[emulator.affine[0]] == "inflow"
    x = emulator.coordinates.of_points(points)
    made = b.lift(emulator.lift(emulator.values(x, emulator.blocks()).T))
    for name in ("u", "p"):
        rows, block = b.space.layout.block(name), b.block(name)
        claimed = np.linalg.norm(emulator.errors[block]) / np.linalg.norm(b.coefficients[block])
        found = np.linalg.norm(made[rows] - truth[rows]) / np.linalg.norm(truth[rows])
        assert found < 3 * claimed < 3e-2


def test_it_is_better_than_a_linear_estimate_and_right_about_its_deviations(setting):
    b, points, truth, functionals = setting
    exact = functionals(truth)
    sigma = 0.1 * np.abs(exact).max(axis=(0, 1))
    data = exact + sigma * np.random.default_rng(6).standard_normal(exact.shape)
    pressure = np.zeros((1, 2 * N))
    pressure[0, N:] = 1.0 / N
    quantity = Weighted(pressure)
    want = np.tensordot(pressure, truth, axes=1).mean(axis=1)
    error, states = {}, {}
    for name, settings in (("linear", MinimumVariance()), ("sampled", Posterior()), ("laplace", Posterior("laplace"))):
        estimate = settings.prepare(b, functionals, WhiteNoise(1.0)).estimate(data, sigma)
        states[name] = np.linalg.norm(estimate.state() - truth)
        error[name] = np.sqrt(((estimate.quantity(quantity) - want) ** 2).mean())
    assert states["sampled"] < 0.9 * states["linear"]
    assert states["sampled"] < 1.05 * states["laplace"]
    estimate = Posterior().prepare(b, functionals, WhiteNoise(1.0)).estimate(data, sigma)
    found = estimate.parameters
    z = (found.values.T - points[:, [b.parameters.names.index(name) for name in found.names]]) / found.deviation.T
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    ratio = (estimate.quantity(quantity) - want) / estimate.standard_deviation(quantity)
    assert 0.6 < np.sqrt((ratio**2).mean()) < 1.5
    assert not estimate.misfit.alarm.any()


def test_exact_data_give_pressure_nobody_measured(setting):
    b, _, truth, functionals = setting
    estimate = (
        Posterior("laplace", tolerance=1e-4).prepare(b, functionals, WhiteNoise(1.0)).estimate(functionals(truth), 0.0)
    )
    for rows in (slice(0, N), slice(N, 2 * N)):
        error, size = (np.linalg.norm(x[rows]) for x in (estimate.state() - truth, truth))
        assert error < 2e-3 * size
