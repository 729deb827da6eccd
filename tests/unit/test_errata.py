"""Printed formulas that are wrong, shown wrong beside the right ones; those of a module are tested with it.

The table of errata in docs/method.md names the test of each.
"""

import numpy as np
from scipy.linalg import null_space
from scipy.sparse import csr_array

from dacore.algebra.pod import pod
from dacore.core.background import Background
from dacore.core.model import Trajectory
from dacore.core.noise import WhiteNoise
from dacore.estimators.pbdw import PBDW
from dacore.estimators.saddle_point import solve_saddle_point
from dacore.studies.outcomes import PRIOR
from dacore.studies.validation import validate
from tests.spaces import Chain, random_background, random_functionals


def problem(seed, n=4, zeta=0.3):
    """Φ, M, W (orthonormal, dense) and a prepared PBDW of one phase."""
    rng = np.random.default_rng(seed)
    space = Chain(14)
    background, functionals = random_background(rng, space), random_functionals(rng, space)
    prepared = PBDW(n=n, weights={"p": zeta}, tails="training").prepare(background, functionals, WhiteNoise())
    mass = space.inner_product({"u": 1.0, "p": zeta}).toarray()
    raw = np.linalg.solve(mass, functionals.matrix.toarray().T)
    representers = np.linalg.solve(np.linalg.cholesky(raw.T @ mass @ raw), raw.T).T
    basis = background.lift(prepared.frames[0].modes[:, :n])
    return rng, basis, mass, representers, prepared, functionals


def test_constraint_row_and_multiplier_need_the_mass_matrix():
    """Printed: Wᵀu = l and λ = Wᵀη. Right: WᵀMu = l, the inner products with the representers, and λ = WᵀMη."""
    rng, basis, mass, w, *_ = problem(1)
    data = rng.standard_normal((w.shape[1], 1))
    n, m = w.shape
    right = np.concatenate([np.zeros((n, 1)), data])
    top = np.hstack([np.eye(n) - basis @ (basis.T @ mass), -w])
    ours = np.linalg.solve(np.vstack([top, np.hstack([w.T @ mass, np.zeros((m, m))])]), right)
    printed = np.linalg.solve(np.vstack([top, np.hstack([w.T, np.zeros((m, m))])]), right)
    np.testing.assert_allclose(ours[:n], solve_saddle_point(basis, csr_array(mass), w, data), atol=1e-9)
    assert np.abs(w.T @ mass @ ours[:n] - data).max() < 1e-9
    assert np.abs(w.T @ mass @ printed[:n] - data).max() > 0.1
    eta = ours[:n] - basis @ (basis.T @ mass @ ours[:n])
    np.testing.assert_allclose(ours[n:], w.T @ mass @ eta, atol=1e-9)
    assert np.abs(ours[n:] - w.T @ eta).max() > 1e-2


def test_correction_lies_in_the_intersection_not_in_the_sum():
    """Printed: η ∈ V_n^⊥ ⊕ W, which is nearly everything. Right: η ∈ V_n^⊥ ∩ W."""
    rng, basis, mass, w, prepared, functionals = problem(2)
    data = rng.standard_normal((functionals.count, 5, 1))
    estimate = prepared.estimate(data)
    eta = prepared.riesz.lift(estimate.correction[:, 0, 0])
    size = np.sqrt(eta @ mass @ eta)
    assert size > 1e-3
    assert np.abs(basis.T @ mass @ eta).max() < 1e-9 * size
    outside = eta - w @ (w.T @ mass @ eta)
    assert np.abs(outside).max() < 1e-9 * size
    both = np.hstack([null_space(basis.T @ mass), w])
    assert np.linalg.matrix_rank(both) > w.shape[1]


def test_joint_inf_sup_constant_does_not_depend_on_the_length_of_the_state():
    """Printed: ‖Π_W v‖ over ‖v‖_ζ². Right: over ‖v‖_ζ; only that has a minimum over all of V_n."""
    _, basis, mass, w, prepared, _ = problem(3)
    worst = np.linalg.svd(w.T @ mass @ basis)[2][-1]

    def norm(state):
        return float(np.sqrt(state @ mass @ state))

    for length in (1.0, 10.0):
        state = basis @ worst * length
        projected = w @ (w.T @ mass @ state)
        assert abs(norm(projected) / norm(state) - prepared.inf_sup[0]) < 1e-9
        printed = norm(projected) / norm(state) ** 2
        assert abs(printed - prepared.inf_sup[0] / length) < 1e-9


def test_singular_values_end_at_the_rank():
    """Printed: sums to max(𝒩, K). There are as many singular values as the rank, and the tail ends in zero."""
    rng = np.random.default_rng(4)
    snapshots = rng.standard_normal((30, 3)) @ rng.standard_normal((3, 8))
    space = pod(snapshots, csr_array(np.eye(30)), tolerance=1e-10)
    assert space.dimension == np.linalg.matrix_rank(snapshots) == 3
    assert space.tails[-1] == 0.0


def test_tail_is_a_mean_square_and_no_bound_for_one_state():
    """Printed: ε̂_n bounds the error of a given state. It is the root mean square over the training set."""
    rng = np.random.default_rng(5)
    snapshots = rng.standard_normal((30, 8))
    snapshots[:, 7] *= 0.5
    mass = csr_array(np.eye(30))
    space = pod(snapshots, mass, max_rank=4)
    errors = np.linalg.norm(snapshots - space.lift(space.project(snapshots)), axis=0)
    full = pod(snapshots, mass)
    mean_square = np.sqrt((errors**2).mean()) / np.sqrt((snapshots**2).sum(axis=0).mean())
    assert abs(mean_square - full.tails[4]) < 1e-12
    relative = errors / np.linalg.norm(snapshots, axis=0)
    assert relative.max() > 1.1 * full.tails[4]


def test_time_averages_do_not_grow_with_the_window():
    """Printed: e^T = ∫ e dt without 1/T. Twice the same steps must give the same errors."""
    rng = np.random.default_rng(6)
    space = Chain(14)
    background, functionals = random_background(rng, space), random_functionals(rng, space)
    truth = [Trajectory(rng.standard_normal((space.n_dofs, 5)), background.times)]
    twice = Background(
        space, background.bases, np.tile(background.coefficients, (1, 2, 1)), np.arange(1.0, 11.0),
        background.parameters, background.samples, background.kind, background.compression,
    )  # fmt: skip
    longer = [Trajectory(np.tile(truth[0].states, 2), twice.times)]
    found = []
    for training, cases in ((background, truth), (twice, longer)):
        prepared = {"pbdw": PBDW(n=3, tails="training").prepare(training, functionals, WhiteNoise())}
        found.append(validate(training, functionals, prepared, cases, {}, (), [0.0], 0))
    for name in (PRIOR, "pbdw"):
        for label in found[0].errors:
            short, long = (each.outcome(name, 0.0) for each in found)
            np.testing.assert_allclose(long.space_time[label], short.space_time[label], rtol=1e-9)
            np.testing.assert_allclose(long.per_step[label].mean(), short.per_step[label].mean(), rtol=1e-9)
            assert short.per_step[label].mean() > 0.01
