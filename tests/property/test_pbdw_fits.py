"""Fits of PBDW that know the noise, and boxes, against dense least squares and optimality conditions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dacore.core.noise import CorrelatedNoise, SensorNoise, WhiteNoise
from dacore.errors import CapabilityError, ShapeError
from dacore.estimators.metrics import Pencil
from dacore.estimators.pbdw import PBDW
from dacore.testing.backgrounds import Weighted, functionals_of
from tests.spaces import Chain, random_background, random_functionals

SPACES = [{"spaces": "cycle", "centring": "none"}, {"spaces": "phase", "centring": "phase"}]
M = 11


def setting(seed, m=M):
    rng = np.random.default_rng(seed)
    space = Chain(14)
    return rng, space, random_background(rng, space), random_functionals(rng, space, m)


def noise_of(rng, kind):
    """A noise model and its covariance."""
    if kind == "white":
        return WhiteNoise(0.4), 0.16 * np.eye(M)
    if kind == "sensors":
        sigmas = rng.uniform(0.2, 1.0, M)
        return SensorNoise(sigmas), np.diag(sigmas**2)
    factor = 0.2 * rng.standard_normal((M, M)) + 0.5 * np.eye(M)
    return CorrelatedNoise(factor @ factor.T), factor @ factor.T


def modes_of(prepared, background, step, n):
    """Φ of a step as states, its offset."""
    frame = prepared.frames[step if len(prepared.frames) > 1 else 0]
    return background.lift(frame.modes[:, :n]), background.lift(prepared.offset[:, step])


@given(
    seed=st.integers(0, 2**31),
    kind=st.sampled_from(["white", "sensors", "correlated"]),
    spaces=st.sampled_from(SPACES),
    missed=st.floats(0.05, 5.0),
    scale=st.floats(0.2, 3.0),
)
def test_regularised_fit_minimises_over_every_state(seed, kind, spaces, missed, scale):
    """Over c and a correction of any shape, by dense least squares: the minimiser's correction is of representers."""
    rng, space, background, functionals = setting(seed)
    noise, covariance = noise_of(rng, kind)
    settings = PBDW(n=4, fit="regularised", missed=missed, weights={"p": 0.3}, tails="training", **spaces)
    prepared = settings.prepare(background, functionals, noise)
    data = rng.standard_normal((M, 5, 2))
    found = prepared.estimate(data, scale).state()
    mass = space.inner_product({"u": 1.0, "p": 0.3}).toarray()
    root = np.linalg.cholesky(mass).T
    whitening = np.linalg.inv(np.linalg.cholesky(scale**2 * covariance))
    seen = whitening @ functionals.matrix.toarray()
    for step in range(5):
        modes, offset = modes_of(prepared, background, step, 4)
        system = np.block([[np.zeros((space.n_dofs, 4)), root / missed], [seen @ modes, seen]])
        right = np.concatenate([
            np.zeros((space.n_dofs, 2)), whitening @ data[:, step] - (seen @ offset)[:, None]
        ])  # fmt: skip
        answer, *_ = np.linalg.lstsq(system, right, rcond=None)
        want = offset[:, None] + modes @ answer[:4] + answer[4:]
        beta = np.nanmin(prepared.inf_sup)
        assert np.abs(found[:, step] - want).max() < 1e-9 / beta**2 * max(np.abs(want).max(), 1.0)


@given(seed=st.integers(0, 2**31), kind=st.sampled_from(["white", "sensors", "correlated"]))
def test_noise_weighted_fit_is_generalised_least_squares(seed, kind):
    rng, _, background, functionals = setting(seed)
    noise, covariance = noise_of(rng, kind)
    prepared = PBDW(n=4, fit="noise_weighted", weights={"p": 0.3}, tails="training").prepare(
        background, functionals, noise
    )
    data = rng.standard_normal((M, 5, 2))
    estimate = prepared.estimate(data, 0.7)
    inverse = np.linalg.inv(covariance)
    assert estimate.correction is None
    for step in range(5):
        modes, offset = modes_of(prepared, background, step, 4)
        seen = functionals.matrix @ modes
        c = np.linalg.solve(seen.T @ inverse @ seen, seen.T @ inverse @ (data[:, step] - functionals(offset)[:, None]))
        want = offset[:, None] + modes @ c
        assert np.abs(estimate.state(step=step) - want).max() < 1e-8 / prepared.inf_sup[step] ** 2


@pytest.mark.parametrize("spaces", SPACES)
def test_a_regularised_fit_lies_between_the_other_two(spaces):
    rng, _, background, functionals = setting(3)
    noise, _ = noise_of(rng, "sensors")
    data = rng.standard_normal((M, 5, 2))

    def states(fit, missed="held_out", scale=1.0):
        settings = PBDW(n=4, fit=fit, missed=missed, weights={"p": 0.3}, tails="training", **spaces)
        return settings.prepare(background, functionals, noise).estimate(data, scale).state()

    exact, weighted = states("exact"), states("noise_weighted")
    assert np.allclose(states("regularised", 1e4), exact, atol=1e-5)
    assert np.allclose(states("regularised", 1e-4), weighted, atol=1e-5)
    assert np.allclose(states("regularised", 1.0, 0.0), exact, atol=1e-7)
    assert np.abs(states("regularised", 1.0) - exact).max() > 1e-3


def test_what_a_background_misses_is_measured_on_trajectories_that_it_has_not_seen():
    """τ² is the mean square of what n modes leave of them, over what representers of unit variance would leave."""
    _, _, background, functionals = setting(4)
    settings = PBDW(n=3, fit="regularised", weights={"p": 0.3}, tails="training")
    prepared = settings.prepare(background, functionals, WhiteNoise(0.5))
    step, total = 2, 0.0
    for fold in prepared.without:
        modes = background.lift(fold.projection.modes[step][:, :3])
        q, _ = np.linalg.qr(functionals.matrix @ modes)
        away = background.coefficients[:, step, fold.mask] - fold.projection.offset[:, step, None]
        seen = functionals(background.lift(away)) / 0.5
        total += ((seen - q @ (q.T @ seen)) ** 2).sum() / background.n_samples
    q, _ = np.linalg.qr(functionals.matrix @ background.lift(prepared.frames[step].modes[:, :3]))
    gram = prepared.riesz.gram / 0.25
    expected = np.trace((np.eye(M) - q @ q.T) @ gram)
    ratios = prepared.ratios(np.full((5, 1), 3), np.array([2.0]), np.zeros((M, 5, 1)))
    assert np.isclose(ratios[step, 0], 4.0 / (total / expected), rtol=1e-8)


@given(seed=st.integers(0, 2**31), kind=st.sampled_from(["white", "sensors", "correlated"]))
def test_pencil_makes_both_matrices_diagonal(seed, kind):
    rng, space, _, _ = setting(seed)
    # Two components with the same functionals, as of an image: equal blocks.
    half = np.zeros((6, space.n_dofs))
    half[:, :14] = rng.standard_normal((6, 14))
    both = np.concatenate([half, np.roll(half, 14, axis=1)])[:M]
    background = random_background(rng, space)
    noise, covariance = noise_of(rng, kind)
    riesz = PBDW(n=2, tails="training").prepare(background, functionals_of(both), noise).riesz
    pencil = Pencil.of(riesz.blocks, noise)
    assert np.allclose(pencil.turn(pencil.turn(covariance).T), np.eye(M), atol=1e-10)
    gram = pencil.turn(pencil.turn(riesz.gram).T)
    assert np.allclose(gram, np.diag(pencil.values), atol=1e-10 * pencil.values.max())
    values = rng.standard_normal((M, 2, 3))
    dense = pencil.turn(np.eye(M))
    assert np.allclose(pencil.turn(values, transposed=True), np.tensordot(dense.T, values, axes=1), atol=1e-12)


def test_repeated_functionals_are_no_matter_where_the_fit_knows_the_noise():
    """Two measurements of one value are one measurement of half the variance."""
    rng, _, background, functionals = setting(5)
    matrix = functionals.matrix.toarray()
    settings = PBDW(n=3, fit="regularised", missed=0.8, weights={"p": 0.3}, tails="training")
    data = rng.standard_normal((M, 5, 1))
    twice = functionals_of(np.concatenate([matrix, matrix[4:5]]))
    found = settings.prepare(background, twice, WhiteNoise(0.5)).estimate(np.concatenate([data, data[4:5]]))
    sigmas = np.full(M, 0.5)
    sigmas[4] /= np.sqrt(2.0)
    want = settings.prepare(background, functionals, SensorNoise(sigmas)).estimate(data)
    assert np.allclose(found.state(), want.state(), atol=1e-9)


@given(
    seed=st.integers(0, 2**31),
    spaces=st.sampled_from(SPACES),
    fit=st.sampled_from(["exact", "regularised", "noise_weighted"]),
)
def test_a_box_is_kept_and_the_rest_is_optimal(seed, spaces, fit):
    """The conditions of Karush, Kuhn and Tucker for min ‖d − Gc‖² in S⁻¹ over the training set's own ranges."""
    rng, _, background, functionals = setting(seed)
    factor, n = 0.7, 4
    missed = 0.5 if fit == "regularised" else "held_out"
    settings = PBDW(n=n, fit=fit, missed=missed, box=factor, weights={"p": 0.3}, tails="training", **spaces)
    prepared = settings.prepare(background, functionals, WhiteNoise(0.4))
    data = functionals(background.lift(background.coefficients[:, :, :3])) + rng.standard_normal((M, 5, 3))
    estimate = prepared.estimate(data, 0.9)
    ratio = (0.9 / 0.5) ** 2
    gram = prepared.riesz.gram
    matrix = {"exact": gram, "regularised": gram + ratio * 0.16 * np.eye(M), "noise_weighted": np.eye(M)}[fit]
    scale = background.scale(prepared.weights)
    active = 0
    for step in range(5):
        frame = prepared.frames[step if spaces["spaces"] == "phase" else 0]
        modes = frame.modes[:, :n]
        training = modes.T @ (scale[:, None] ** 2 * (background.coefficients[:, step] - prepared.offset[:, step, None]))
        middle = (training.max(axis=1) + training.min(axis=1)) / 2
        half = factor * (training.max(axis=1) - training.min(axis=1)) / 2
        c = modes.T @ (scale[:, None] ** 2 * (estimate.coefficients[:, step] - prepared.offset[:, step, None]))
        seen = functionals.matrix @ background.lift(modes)
        right = data[:, step] - functionals(background.lift(prepared.offset[:, step]))[:, None]
        slope = seen.T @ np.linalg.solve(matrix, seen @ c - right)
        size = np.abs(seen.T @ np.linalg.solve(matrix, right)).max() + 1e-12
        unit = np.maximum(half, 1e-12)[:, None]
        place = (c - middle[:, None]) / unit
        assert np.abs(place).max() < 1 + 1e-7
        inside = np.abs(place) < 1 - 1e-7
        assert np.abs(slope[inside]).max(initial=0.0) < 1e-6 * size
        assert (slope[place >= 1 - 1e-7] < 1e-6 * size).all()
        assert (slope[place <= -1 + 1e-7] > -1e-6 * size).all()
        active += int((~inside).sum())
        if fit != "noise_weighted":
            z = estimate.correction[:, step]
            assert np.allclose(matrix @ z, right - seen @ c, atol=1e-6 * max(np.abs(right).max(), 1.0))
    assert active > 0


def test_a_wide_box_changes_nothing():
    rng, _, background, functionals = setting(6)
    data = rng.standard_normal((M, 5, 2))
    free, boxed = (
        PBDW(n=4, box=box, weights={"p": 0.3}, tails="training").prepare(background, functionals, WhiteNoise())
        for box in (None, 1e6)
    )
    assert np.array_equal(free.estimate(data).coefficients, boxed.estimate(data).coefficients)


@pytest.mark.parametrize("given", [{"box": 1.0}, {"n": "gcv"}, {"n": "discrepancy"},
                                   {"fit": "regularised", "missed": "gcv"}])  # fmt: skip
def test_estimates_that_are_not_affine_have_no_readout(given):
    _, _, background, functionals = setting(7)
    settings = replace(PBDW(n=3, weights={"p": 0.3}), **given)
    assert not settings.affine
    with pytest.raises(CapabilityError, match="not affine"):
        settings.prepare(background, functionals, WhiteNoise()).readout(Weighted(np.ones((1, 42))))


@pytest.mark.parametrize(
    ("given", "message"),
    [({"box": 0.0}, "box"), ({"missed": -1.0, "fit": "regularised"}, "missed"), ({"missed": "gcv"}, "missed: only"),
     ({"n": 0}, "n: got 0")],
)  # fmt: skip
def test_wrong_settings_are_refused(given, message):
    with pytest.raises(ShapeError, match=message):
        PBDW(**given)
