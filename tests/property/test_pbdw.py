"""PBDW against dense linear algebra that shares no code with it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dacore.algebra.gram import RieszMap, orthonormaliser
from dacore.algebra.stability import inf_sup_constants
from dacore.core.noise import WhiteNoise
from dacore.errors import ShapeError, UnstableError
from dacore.estimators.frames import FOLDS, build_frames, held_out_frames, held_out_tails, offset_of
from dacore.estimators.pbdw import PBDW
from dacore.estimators.saddle_point import solve_saddle_point
from tests.spaces import Chain, functionals_of, random_background, random_functionals

VARIANTS = [
    {"spaces": "cycle", "centring": "none"},
    {"spaces": "cycle", "centring": "cycle"},
    {"spaces": "cycle", "centring": "phase"},
    {"spaces": "phase", "centring": "phase"},
    {"spaces": "phase", "centring": "none"},
]


def setting(seed, m=11, nodes=14):
    rng = np.random.default_rng(seed)
    space = Chain(nodes)
    return rng, space, random_background(rng, space), random_functionals(rng, space, m)


def dense(prepared, background, functionals, zeta, frame=0):
    """Φ, M, W as dense arrays, W by an eigendecomposition instead of Cholesky."""
    space = background.space
    mass = space.inner_product({"u": 1.0, "p": zeta})
    n = int(prepared.dimensions[frame])
    basis = background.lift(prepared.frames[frame].modes[:, :n])
    raw = np.linalg.solve(mass.toarray(), functionals.matrix.toarray().T)
    gram = functionals.matrix.toarray() @ raw
    values, vectors = np.linalg.eigh(gram)
    whitening = vectors / np.sqrt(values)
    return basis, mass, raw @ whitening, whitening


@given(seed=st.integers(0, 2**31), variant=st.sampled_from(VARIANTS), n=st.integers(1, 6), exponent=st.integers(-6, 2))
def test_explicit_form_agrees_with_the_saddle_point_form(seed, variant, n, exponent):
    rng, _, background, functionals = setting(seed)
    zeta = 10.0**exponent
    prepared = PBDW(n=n, weights={"p": zeta}, tails="training", **variant).prepare(
        background, functionals, WhiteNoise()
    )
    data = rng.standard_normal((functionals.count, 5, 2))
    estimate = prepared.estimate(data)
    for step in (0, 3):
        frame = step if variant["spaces"] == "phase" else 0
        basis, mass, representers, whitening = dense(prepared, background, functionals, zeta, frame)
        offset = background.lift(prepared.offset[:, step])
        shifted = whitening.T @ (data[:, step] - functionals(offset)[:, None])
        reference = offset[:, None] + solve_saddle_point(basis, mass, representers, shifted)
        ours = estimate.state(step=step)
        beta = prepared.inf_sup[step]
        assert np.abs(ours - reference).max() <= 1e-10 / beta**2 * max(np.abs(reference).max(), 1.0)


@given(seed=st.integers(0, 2**31), variant=st.sampled_from(VARIANTS), n=st.integers(1, 6))
def test_observations_are_reproduced_exactly(seed, variant, n):
    rng, _, background, functionals = setting(seed)
    prepared = PBDW(n=n, weights={"p": 1e-3}, tails="training", **variant).prepare(
        background, functionals, WhiteNoise()
    )
    data = rng.standard_normal((functionals.count, 5, 3))
    estimate = prepared.estimate(data)
    assert np.abs(functionals(estimate.state()) - data).max() < 1e-9 / prepared.inf_sup.min()
    assert np.allclose(estimate.functional(functionals), data, atol=1e-9 / prepared.inf_sup.min())


@given(seed=st.integers(0, 2**31), variant=st.sampled_from(VARIANTS), n=st.integers(1, 6))
def test_every_element_of_the_background_space_is_recovered(seed, variant, n):
    rng, _, background, functionals = setting(seed)
    prepared = PBDW(n=n, weights={"p": 1e-2}, tails="training", **variant).prepare(
        background, functionals, WhiteNoise()
    )
    for step in range(5):
        frame = prepared.frames[step if variant["spaces"] == "phase" else 0]
        inside = prepared.offset[:, step, None] + frame.modes[:, :n] @ rng.standard_normal((n, 1))
        truth = background.lift(inside)
        data = np.zeros((functionals.count, 5, 1))
        data[:, step] = functionals(truth)
        found = prepared.estimate(data).state(step=step)
        assert np.abs(found - truth).max() < 1e-10 / prepared.inf_sup[step] ** 2 * max(np.abs(truth).max(), 1)


@given(seed=st.integers(0, 2**31), variant=st.sampled_from(VARIANTS), n=st.integers(1, 6))
def test_correction_is_orthogonal_to_the_background_space_and_made_of_representers(seed, variant, n):
    """η* ∈ W ∩ V_n^⊥, an intersection; the paper prints a sum of spaces."""
    rng, space, background, functionals = setting(seed)
    prepared = PBDW(n=n, weights={"p": 1e-2}, tails="training", **variant).prepare(
        background, functionals, WhiteNoise()
    )
    estimate = prepared.estimate(rng.standard_normal((functionals.count, 5, 1)))
    mass = space.inner_product({"u": 1.0, "p": 1e-2})
    for step in range(5):
        frame = prepared.frames[step if variant["spaces"] == "phase" else 0]
        modes = background.lift(frame.modes[:, :n])
        eta = estimate.riesz.lift(estimate.correction[:, step, 0])
        size = float(np.sqrt(eta @ (mass @ eta)))
        assert np.abs(modes.T @ (mass @ eta)).max() < 1e-10 * max(size, 1.0) / prepared.inf_sup[step]
        assert not eta[space.layout.block("p")].any()


@given(seed=st.integers(0, 2**31), m=st.integers(3, 12))
def test_inf_sup_constants_never_rise_and_are_the_smallest_singular_values(seed, m):
    rng = np.random.default_rng(seed)
    cross = np.linalg.qr(rng.standard_normal((15, 15)))[0][:m, :9]
    constants = inf_sup_constants(cross)
    assert (np.diff(constants) <= 0).all()
    for n in range(1, 10):
        exact = np.linalg.svd(cross[:, :n], compute_uv=False)[-1] if n <= m else 0.0
        assert abs(constants[n - 1] - exact) < 1e-12


def test_inf_sup_is_not_the_printed_singular_value_of_the_squared_matrix():
    _, _, background, functionals = setting(3)
    prepared = PBDW(n=4, tails="training", weights={"p": 1.0}).prepare(background, functionals, WhiteNoise())
    cross = prepared.cross[0][:, :4]
    printed = np.linalg.svd(cross.T @ cross, compute_uv=False)[-1]
    basis, mass, representers, _ = dense(prepared, background, functionals, 1.0)
    projection = representers @ (representers.T @ (mass @ basis))
    worst = np.sqrt(np.linalg.eigvalsh(projection.T @ (mass @ projection))[0])
    assert abs(prepared.inf_sup[0] - worst) < 1e-10
    assert abs(printed - worst) > 1e-2


def test_correction_has_the_corrected_sign():
    """η* = W(l − WᵀMv*); the printed sign doubles the misfit instead of removing it."""
    rng, _, background, functionals = setting(5)
    prepared = PBDW(n=3, tails="training").prepare(background, functionals, WhiteNoise())
    data = rng.standard_normal((functionals.count, 5, 1))
    estimate = prepared.estimate(data)
    background_only = PBDW(n=3, tails="training", correction=False).prepare(background, functionals, WhiteNoise())
    v = background_only.estimate(data).state()
    printed = v - (estimate.state() - v)
    assert np.abs(functionals(estimate.state()) - data).max() < 1e-9
    assert np.abs(functionals(printed) - data).max() > 1e-1


def test_joint_norm_is_the_root_of_squares_with_squared_ratio():
    _, space, background, functionals = setting(8)
    prepared = PBDW(n=3, weights="balanced", tails="training", centring="phase").prepare(
        background, functionals, WhiteNoise()
    )
    fluctuations = background.coefficients - background.mean()[:, :, None]
    sizes = {f: np.linalg.norm(fluctuations[background.block(f)], axis=0).max() for f in ("u", "p")}
    assert np.isclose(prepared.weights["p"], (sizes["u"] / sizes["p"]) ** 2)
    modes = background.lift(prepared.frames[0].modes)
    mass = space.inner_product(prepared.weights)
    assert np.abs(modes.T @ (mass @ modes) - np.eye(modes.shape[1])).max() < 1e-10


@given(seed=st.integers(0, 2**31))
def test_error_is_within_the_stability_bound(seed):
    rng, space, background, functionals = setting(seed)
    prepared = PBDW(n=4, weights={"p": 1.0}, tails="training").prepare(background, functionals, WhiteNoise())
    mass = space.inner_product({"u": 1.0, "p": 1.0})
    truth = background.lift(background.mean()[:, 0]) + rng.standard_normal(space.n_dofs)
    data = np.zeros((functionals.count, 5, 1))
    data[:, 0, 0] = functionals(truth)
    found = prepared.estimate(data).state(step=0, series=0)
    basis, _, representers, _ = dense(prepared, background, functionals, 1.0)
    shifted = truth - background.lift(prepared.offset[:, 0])
    onto_v = shifted - basis @ (basis.T @ (mass @ shifted))
    w_perp = representers - basis @ (basis.T @ (mass @ representers))
    # W ∩ V_n^⊥: combinations of W that are orthogonal to V_n
    _, s, vt = np.linalg.svd(basis.T @ (mass @ representers))
    null = vt[int((s > 1e-12).sum()) :].T
    extra = representers @ null
    left = onto_v - extra @ np.linalg.solve(extra.T @ (mass @ extra), extra.T @ (mass @ onto_v))

    def norm(x):
        return float(np.sqrt(x @ (mass @ x)))

    error = norm(truth - found)
    assert w_perp.shape == representers.shape
    assert error <= norm(left) / prepared.inf_sup[0] * (1 + 1e-8)
    assert norm(left) <= norm(onto_v) * (1 + 1e-10)


@given(seed=st.integers(0, 2**31))
def test_masked_estimate_equals_one_prepared_on_the_valid_functionals(seed):
    rng, _, background, functionals = setting(seed)
    mask = np.ones(functionals.count, dtype=bool)
    mask[rng.choice(functionals.count, 3, replace=False)] = False
    data = rng.standard_normal((functionals.count, 5, 1))
    gaps = data.copy()
    gaps[~mask] = np.nan
    settings = PBDW(n=3, tails="training")
    found = settings.prepare(background, functionals, WhiteNoise()).estimate(gaps, mask=mask)
    fewer = functionals_of(functionals.matrix.toarray()[mask])
    reference = settings.prepare(background, fewer, WhiteNoise()).estimate(data[mask])
    assert np.allclose(found.state(), reference.state(), atol=1e-8)


@given(seed=st.integers(0, 2**31), variant=st.sampled_from(VARIANTS))
def test_claimed_variance_is_that_of_held_out_errors_and_of_noise(seed, variant):
    """Against estimators prepared without the held-out trajectories, and unit errors of each value."""
    rng, _, background, functionals = setting(seed)
    settings = PBDW(n=3, tails="training", weights={"p": 1e-2}, **variant)
    prepared = settings.prepare(background, functionals, WhiteNoise(0.7))
    estimate = prepared.estimate(rng.standard_normal((functionals.count, 5, 1)), noise_scale=0.5)
    probe = functionals_of(rng.standard_normal((2, background.space.n_dofs)))
    weights = np.array([0.2, 0, 0.5, 0, 0.3])
    on_modes = np.einsum("t,sr->str", weights, background.observe(probe.matrix))
    on_correction = np.einsum("t,sm->stm", weights, prepared.riesz.pair(probe))
    claimed = estimate.uncertainty.variance(on_modes, on_correction)[:, 0]
    total = np.zeros(2)
    for fold in range(FOLDS):
        mask = np.arange(background.n_samples) % FOLDS == fold
        fewer = replace(
            background, coefficients=background.coefficients[:, :, ~mask], samples=background.samples[~mask]
        )
        without = settings.prepare(fewer, functionals, WhiteNoise(0.7))
        for k in np.flatnonzero(mask):
            states = background.lift(background.coefficients[:, :, k])
            found = without.estimate(functionals(states)[:, :, None]).state(series=0)
            total += (probe(states - found) @ weights) ** 2 / background.n_samples
    zero = prepared.estimate(np.zeros((functionals.count, 5, 1))).state(series=0)
    for i in range(functionals.count):
        for t in range(5):
            data = np.zeros((functionals.count, 5, 1))
            data[i, t] = 0.7 * 0.5
            total += (probe(prepared.estimate(data).state(series=0) - zero) @ weights) ** 2
    assert np.allclose(claimed, total, rtol=1e-6, atol=1e-12)


def test_held_out_tails_do_not_know_what_they_predict():
    """With as many modes as samples but one, a space spans its own training set; unseen samples it does not."""
    rng = np.random.default_rng(0)
    coefficients = rng.standard_normal((40, 1, 6))
    folds = held_out_frames(coefficients, "phase", np.ones(40), "phase", 5)
    (tails,) = held_out_tails(coefficients, np.ones(40), folds, 5)
    assert tails[5] > 0.5
    offset = offset_of(coefficients, "phase")
    (frame,) = build_frames(coefficients, offset, np.ones(40), "phase", 5)
    assert frame.tails[5] < 1e-10


@pytest.mark.parametrize("centring", ["none", "cycle", "phase"])
def test_spaces_of_phases_without_a_group_are_those_of_the_others(centring):
    """The short cut through the directions of all trajectories gives the spaces one would build directly."""
    rng = np.random.default_rng(2)
    coefficients, scale = rng.standard_normal((9, 3, 16)), rng.uniform(0.1, 2.0, 9)
    for fold in held_out_frames(coefficients, centring, scale, "phase", 4):
        others = coefficients[:, :, ~fold.mask]
        assert np.array_equal(fold.offset, offset_of(others, centring))
        for short, direct in zip(fold.frames, build_frames(others, fold.offset, scale, "phase", 4), strict=True):
            assert np.allclose(short.singular_values[:9], direct.singular_values[:9], rtol=1e-10)
            gram = (scale[:, None] * short.modes).T @ (scale[:, None] * direct.modes)
            assert np.allclose(np.abs(gram), np.eye(4), atol=1e-9)


def test_a_training_set_that_does_not_vary_is_refused():
    _, _, background, functionals = setting(1)
    same = replace(background, coefficients=np.repeat(background.coefficients[:, :, :1], 12, axis=2))
    with pytest.raises(ShapeError, match="all trajectories are the same"):
        PBDW(n=2, weights={"p": 1.0}).prepare(same, functionals, WhiteNoise())


def test_a_background_space_that_is_not_seen_is_refused():
    _, space, background, _ = setting(1)
    blind = np.zeros((3, space.n_dofs))
    blind[:, space.layout.block("u")] = np.eye(3, 28)
    blind = functionals_of(blind)
    flat = replace(background, coefficients=background.coefficients.copy())
    flat.coefficients[background.block("u")] = 0.0
    with pytest.raises(UnstableError, match="see no mode"):
        PBDW(n="bound", weights={"p": 1.0}).prepare(flat, blind, WhiteNoise())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (PBDW(n=2), "nothing given for p"),
        (PBDW(n=2, weights={"q": 1.0}), "got the field 'q'"),
        (PBDW(n=20, weights={"p": 1.0}), "a phase has at most 12 modes from 12 samples"),
    ],
)
def test_what_no_training_can_mend_is_said_before(settings, message):
    with pytest.raises(ShapeError, match=message):
        settings.check(Chain(4).layout, 12)


def test_dependent_functionals_are_named():
    _, _, background, functionals = setting(2)
    matrix = functionals.matrix.toarray()
    matrix[7] = 3 * matrix[2]
    with pytest.raises(UnstableError, match=r"l2 and l7|l7 and l2"):
        PBDW(n=2).prepare(background, functionals_of(matrix), WhiteNoise())


def test_more_modes_than_functionals_are_refused():
    _, _, background, functionals = setting(2, m=3)
    with pytest.raises(UnstableError, match="up to n = 3"):
        PBDW(n=4).prepare(background, functionals, WhiteNoise())


def test_nested_selection_takes_the_smallest_bound():
    _, _, background, functionals = setting(4)
    prepared = PBDW(n="bound", tails="training", spaces="cycle", centring="none", weights={"p": 1.0}).prepare(
        background, functionals, WhiteNoise()
    )
    frame, constants = prepared.frames[0], prepared.constants[0]
    usable = int((constants > 1e-10).sum())
    exact = np.array([frame.tails[n] / constants[n - 1] for n in range(1, usable + 1)])
    assert prepared.dimensions[0] == np.argmin(exact) + 1


@pytest.mark.parametrize("shape", [(11,), (10, 5), (10, 5, 1), (11, 4, 1)])
def test_data_of_the_wrong_shape_are_refused(shape):
    _, _, background, functionals = setting(1)
    with pytest.raises(ShapeError, match="data: got shape"):
        PBDW(n=2).prepare(background, functionals, WhiteNoise()).estimate(np.zeros(shape))


def test_nan_data_are_refused_with_advice():
    _, _, background, functionals = setting(1)
    data = np.zeros((11, 5, 1))
    data[4, 2] = np.nan
    with pytest.raises(ShapeError, match=r"1 of 11 functionals hold NaN .* mask"):
        PBDW(n=2).prepare(background, functionals, WhiteNoise()).estimate(data)


def test_gram_matrix_uses_no_other_field_and_matches_dense_algebra():
    _, space, _, functionals = setting(6)
    riesz = RieszMap(space, functionals, {"u": 2.0, "p": 1e-3})
    mass = space.inner_product({"u": 2.0, "p": 1e-3}).toarray()
    exact = functionals.matrix.toarray() @ np.linalg.solve(mass, functionals.matrix.toarray().T)
    assert riesz.seen == ("u",)
    assert np.allclose(riesz.gram, exact, rtol=1e-11)
    factor = orthonormaliser(riesz.gram, functionals.labels)
    assert np.allclose(factor @ factor.T, exact, rtol=1e-11)
    z = np.random.default_rng(0).standard_normal((functionals.count, 2))
    assert np.allclose(riesz.lift(z), np.linalg.solve(mass, functionals.matrix.toarray().T @ z), atol=1e-10)
