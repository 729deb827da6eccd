"""Reduced models at one frequency: exact with all modes, as accurate as they say, kept, and used by a posterior."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dacore.core.noise import WhiteNoise
from dacore.core.parameters import ParameterSpace
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.motions import Motions
from dacore.dynamics.training import draw
from dacore.errors import AccuracyError, ConvergenceError, StoreError
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.posterior import Posterior
from dacore.reduction.greedy import Settings
from dacore.reduction.kept import read_reduced, write_reduced
from dacore.reduction.kinds import affine_of, dual_solutions
from dacore.reduction.split import SplitModel
from dacore.reduction.training import train_reduced
from dacore.testing.backgrounds import functionals_of
from tests.unit.test_harmonic import ETA, F, driven
from tests.unit.test_reduction import complete_of, lifted, reduced_of, relative, some_columns


def oscillating(n=15, frequency=F, losses=ETA, **changes):
    return HarmonicModel(driven(n, frequency, **changes), frequency, losses, tolerance=1e-12)


def complete(model, kind="l2"):
    return complete_of(affine_of(model), kind)


def solving(model, samples):
    def solve(motions, numbers):
        return [motions.solve(model.parameters.as_mapping(samples[number])) for number in numbers]

    return solve


@pytest.fixture(scope="module")
def training():
    model = oscillating(120, 12.0)
    samples = draw(model.parameters, 150, "latin_hypercube", 3)
    settings = Settings(1e-6, first=1, batch=1)
    return model, samples, train_reduced(
        model, model.parameters, samples, solving(model, samples), settings, 1e-10
    )  # fmt: skip


def test_losses_are_friction_at_one_frequency():
    model = oscillating()
    point = model.parameters.middle | {"eta": 0.3}
    plain = HarmonicModel(pickle.loads(pickle.dumps(model.viscous)), F, tolerance=1e-12)
    wanted, found = model.solve(point).states, plain.solve(point).states
    assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("kind", ["l2", "h1"])
def test_with_all_modes_the_reduced_model_is_the_full_one(kind):
    model = oscillating()
    galerkin = complete(model, kind)
    points = [model.parameters.as_mapping(row) for row in draw(model.parameters, 4, "uniform", 1)]
    points.append(points[0] | {"inflow": 4.25})  # another load, the same matrix
    states, estimates = reduced_of(model, galerkin).estimate(points)
    assert states.shape[1:] == (2, 5)
    for k, point in enumerate(points):
        truth = model.solve(point).states
        assert relative(lifted(model, galerkin, states[:, :, k]) - truth, truth, model).max() < 1e-8
    # Nothing is left out, so the residual is round-off.
    assert estimates.max() < 1e-7


def test_the_indicator_sees_the_error_of_fewer_modes():
    """In the middle of the ranges the tests are exact but for chance and the turn of the phases."""
    model = oscillating(losses=None)
    whole = complete(model)
    galerkin = whole.turned(some_columns(whole, 12))
    reduced = reduced_of(model, galerkin)
    point = model.parameters.middle
    states, estimated = reduced.estimate([point])
    truth = model.solve(point).states
    # As in the estimate, relative to the reduced state.
    error = lifted(model, galerkin, states[:, :, 0]) - truth
    absolute = relative(error, truth, model) * relative(truth, lifted(model, galerkin, states[:, :, 0]), model)
    ratio = estimated[:, 0] / absolute
    # The diagonal stands for the mass, which a factor of each field makes up for.
    assert (ratio > 0.3).all()
    assert (ratio < 5.0).all()


def test_duals_solve_the_transposed_system():
    model = oscillating()
    point, rng = model.parameters.middle | {"eta": 0.2}, np.random.default_rng(0)
    z = np.where(model.model.constrained[:, None], 0.0, rng.standard_normal((model.space.n_dofs, 2)))
    y = dual_solutions(model, point, z)
    assert y.shape == (model.space.n_dofs, 2, 2)
    split = SplitModel(affine_of(model))
    omega = 2 * np.pi * F
    whole = np.zeros((model.space.n_dofs,) * 2, dtype=complex)
    for term in split.model.second_order:
        whole -= omega**2 * term.coefficient(point) * term.matrix.toarray()
    for term in split.model.first_order:
        whole += 1j * omega * term.coefficient(point) * term.matrix.toarray()
    for term in split.model.zeroth_order:
        whole += term.coefficient(point) * term.matrix.toarray()
    free = ~model.model.constrained
    found = whole[np.ix_(free, free)].T @ (y[:, 0] + 1j * y[:, 1])[free]
    assert np.abs(found - z[free]).max() < 1e-4 * np.abs(z).max()


def test_motions_superpose_to_every_oscillation():
    model = oscillating()
    points = [model.parameters.as_mapping(row) for row in draw(model.parameters, 4, "uniform", 1)]
    motions = Motions(model, np.stack([model.model.amplitudes(point) for point in points], axis=1))
    solved = pickle.loads(pickle.dumps(motions)).solve(points[0])
    assert solved.states.shape == (30, len(motions.times))
    for point in points:
        wanted = model.solve(points[0] | {"inflow": point["inflow"]}).states
        found = motions.superpose(solved, model.model.amplitudes(point))
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_a_few_solves_stand_for_all_and_unseen_errors_are_as_small_as_they_say(training):
    model, samples, reduced = training
    assert len(reduced.solved) < len(samples) / 3
    assert reduced.estimates.max() <= 1e-6
    points = [model.parameters.as_mapping(row) for row in draw(model.parameters, 12, "uniform", 9)]
    states, estimates = reduced.model.estimate(points)
    assert np.array_equal(reduced.model.times, model.times)
    coefficients = np.tensordot(reduced.model.onto, states, axes=1)
    for k, point in enumerate(points):
        truth = model.solve(point).states
        errors = relative(reduced.background.lift(coefficients[:, :, k]) - truth, truth, model)
        assert errors.max() < 1e-6
        assert (estimates[:, k] > 0.3 * errors).all()
    first, *later = reduced.rounds
    assert np.isnan(first.true).all()
    assert later[-1].true.max() < 0.1 * max(each.true.max() for each in later)


def test_it_is_there_again_when_it_is_read(training, tmp_path):
    model, samples, reduced = training
    write_reduced(reduced, tmp_path / "training.h5")
    again = read_reduced(tmp_path / "training.h5", model, model.parameters)
    points = [model.parameters.as_mapping(row) for row in samples[:3]]
    for mine, other in zip(reduced.model.estimate(points), again.model.estimate(points), strict=True):
        assert np.array_equal(mine, other)
    assert np.array_equal(
        again.background.forward.coefficients(samples[:3]), reduced.background.forward.coefficients(samples[:3])
    )
    with pytest.raises(StoreError, match="damaged or of another model"):
        read_reduced(tmp_path / "training.h5", oscillating(20), model.parameters)


def test_the_map_keeps_its_modes(training):
    _, samples, reduced = training
    forward = reduced.background.forward
    assert forward.coarse(samples[:24], 1e-3) is forward
    np.testing.assert_allclose(
        forward.coefficients(samples), reduced.background.coefficients,
        atol=1e-10 * np.abs(reduced.background.coefficients).max(),
    )  # fmt: skip


def test_too_few_solves_are_an_error_that_says_what_was_reached():
    model = oscillating(120, 12.0)
    samples, settings = draw(model.parameters, 40, "latin_hypercube", 3), Settings(1e-10, most=5, first=1, batch=1)
    with pytest.raises(AccuracyError, match=r"5 trajectories leave an estimated error .* raise training.reduction"):
        train_reduced(model, model.parameters, samples, solving(model, samples), settings, 1e-10)


def test_a_mode_that_nothing_moves_is_an_error():
    model = oscillating()
    galerkin = complete(model)
    reduced = reduced_of(model, galerkin)
    none = np.zeros((len(galerkin.split.terms), 1))
    with pytest.raises(ConvergenceError, match="a mode has no stiffness"):
        reduced.march.run(none, np.ones((3, 1)))


@pytest.fixture(scope="module")
def estimated():
    """Displacements of a few points with 5% noise in 40 unseen cases of a damped rod; pressures are hidden."""
    model = oscillating(40, 1.5)
    every = model.parameters.parameters
    ends = {"modulus": (10.0, 40.0), "eta": (0.2, 0.4)}
    damped = [replace(p, low=ends[p.name][0], high=ends[p.name][1]) if p.name in ends else p for p in every]
    parameters = ParameterSpace(tuple(damped))
    samples = draw(parameters, 80, "latin_hypercube", 3)
    reduced = train_reduced(model, parameters, samples, solving(model, samples), Settings(1e-4), 1e-9)
    functionals = functionals_of(np.eye(80)[[8, 16, 24, 32, 39]])
    points = draw(parameters, 40, "uniform", 21)
    truth = np.stack([model.solve(parameters.as_mapping(row)).states for row in points], axis=2)
    exact = functionals(truth)
    sigma = 0.05 * np.abs(exact).max(axis=(0, 1))
    data = exact + sigma * np.random.default_rng(5).standard_normal(exact.shape)
    estimators = {"posterior": Posterior(), "linear": MinimumVariance(window="cycle")}
    found = {
        name: each.prepare(reduced.background, functionals, WhiteNoise(1.0)).estimate(data, sigma)
        for name, each in estimators.items()
    }
    return model, points, truth, found


def test_the_posterior_learns_stiffness_and_loss_and_its_deviations_are_right(estimated):
    model, points, _, found = estimated
    parameters = found["posterior"].parameters
    learned = dict(zip(parameters.names, parameters.learned.mean(axis=1), strict=True))
    assert learned["modulus"] > 0.9
    assert learned["eta"] > 0.3
    wanted = np.stack([points[:, model.parameters.names.index(name)] for name in parameters.names])
    off = (parameters.values - wanted) / parameters.deviation
    assert 0.7 < np.sqrt((off**2).mean()) < 1.3
    assert 0.83 < (np.abs(off) < 1.645).mean() < 0.97


def test_in_noise_the_posterior_beats_minimum_variance(estimated):
    model, _, truth, found = estimated
    errors = {name: relative(each.state() - truth, truth, model) for name, each in found.items()}
    assert (errors["posterior"] < [0.97, 0.6] * errors["linear"]).all()
