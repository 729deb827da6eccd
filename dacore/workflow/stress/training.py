"""Training sets that say little: identical, dependent or wildly scaled snapshots, compression at round-off."""

from dataclasses import replace
from typing import Any

import numpy as np

from dacore.algebra.compress import compress
from dacore.algebra.pod import pod
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.model import Trajectory
from dacore.core.noise import WhiteNoise
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.workflow.stress.case import Case, Outcome
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.inference import check_minimum_variance, check_pbdw, pbdw, spread
from dacore.workflow.stress.reference import EPS


def _combined(context: Context, rank: int) -> Background:
    """As many trajectories as there are, all combinations of the first `rank`."""
    own = context.background
    mixing = context.rng(11).random((max(rank, 1), own.n_samples))
    mixing /= mixing.sum(axis=0)
    return replace(own, coefficients=np.tensordot(own.coefficients[:, :, : len(mixing)], mixing, axes=1))


def _dependent(rank: int, n: int) -> Any:
    """PBDW of dimension n per phase from snapshots of a lower rank."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        settings = pbdw(n, spaces="phase", centring="none")
        return check_pbdw(context, settings, functionals, functionals(context.truth), _combined(context, rank))

    return run


def _identical(estimator: str) -> Any:
    def run(context: Context) -> Outcome:
        background = _combined(context, 1)
        functionals = spread(context.functionals, 40)
        data = functionals(context.truth)
        if estimator == "PBDW":
            settings = pbdw(1, spaces="phase", centring="phase")
            return check_pbdw(context, settings, functionals, data, background)
        prepared = context.ask(lambda: MinimumVariance().prepare(background, functionals, WhiteNoise()))
        found = context.ask(lambda: prepared.estimate(data, 0.0))
        # A covariance of zero leaves the mean, whatever the data: right as algebra, useless as an answer.
        mean = background.lift(background.mean())
        return Outcome(context.difference(found.state(), np.repeat(mean[:, :, None], data.shape[2], axis=2)), 1e-12)

    return run


def _dependent_minimum_variance(context: Context) -> Outcome:
    functionals = spread(context.functionals, 40)
    data = functionals(context.truth)
    return check_minimum_variance(context, functionals, data, 0.05 * float(np.abs(data).max()), _combined(context, 3))


def _decades(context: Context) -> Outcome:
    """Singular values from 1 to 1e-12, known because the snapshots are made of them."""
    field = context.space.fields[0].name
    product = context.space.field_product(field)
    r = 13
    rng = context.rng(12)
    raw: Array = rng.standard_normal((product.shape[0], r))
    for _ in range(2):
        raw = np.asarray(np.linalg.solve(np.linalg.cholesky(raw.T @ (product @ raw)), raw.T).T)
    right, _ = np.linalg.qr(rng.standard_normal((3 * r, r)))
    sizes = np.asarray(np.geomspace(1.0, 1e-12, r), dtype=np.float64)
    snapshots = (raw * sizes) @ right.T
    found = context.ask(lambda: pod(snapshots, product, 1e-13))
    kept = min(found.dimension, r)
    # Round-off of the snapshots moves a singular value by that of the largest, and mode i by ε σ₁/σᵢ.
    values = np.abs(found.singular_values[:kept] - sizes[:kept]) / EPS
    left = raw - found.lift(found.project(raw))
    lost = np.sqrt(np.einsum("ij,ij->j", left, product @ left)) * sizes / EPS
    worst = max(float(values.max()), float(lost.max()))
    return Outcome(worst, 1e3, note=f"{found.dimension} modes; worst in units of round-off of the largest")


def _trajectories(context: Context, states: Array) -> list[Trajectory]:
    return [Trajectory(states[:, :, k], context.background.times) for k in range(states.shape[2])]


def _states(context: Context) -> Array:
    """Training states (n_dofs, t, K)."""
    return context.background.lift(context.background.coefficients)


def _compressed(context: Context, states: Array, tolerance: float = 1e-6) -> Background:
    own = context.background
    return compress(context.space, _trajectories(context, states), own.parameters, own.samples, tolerance, own.kind)


def _tolerance(tolerance: float) -> Any:
    """The compression's own measure of its error is checked by lifting everything again."""

    def run(context: Context) -> Outcome:
        states = _states(context)
        found = context.ask(lambda: _compressed(context, states, tolerance))
        error = context.difference(found.lift(found.coefficients), states)
        return Outcome(error, max(1.1 * tolerance, 100 * EPS), note=f"{found.dimension} modes")

    return run


def _constant(size: float) -> Any:
    """The last field is a constant plus its variation; the variation should survive compression."""

    def run(context: Context) -> Outcome:
        states = _states(context)
        block = context.space.layout.block(context.space.fields[-1].name)
        varying = states[block] - states[block].mean(axis=2, keepdims=True)
        states[block] += size * float(np.abs(varying).max())
        found = context.ask(lambda: _compressed(context, states))
        again = found.lift(found.coefficients)[block]
        left = again - again.mean(axis=2, keepdims=True)
        error = float(np.linalg.norm(left - varying) / np.linalg.norm(varying))
        return Outcome(error, 1e-2, note=f"{found.dimension} modes; error relative to what varies")

    return run


def _scaled(factor: float) -> Any:
    """Compression knows no unit: scaled snapshots have the same modes."""

    def run(context: Context) -> Outcome:
        states = _states(context)
        found = context.ask(lambda: _compressed(context, factor * states))
        error = context.difference(found.lift(found.coefficients) / factor, states)
        return Outcome(error, 1.1e-6)

    return run


def _not_finite(context: Context) -> Outcome:
    states = _states(context)
    states[3, 1, 2] = np.nan
    found = context.ask(lambda: _compressed(context, states))
    return Outcome(context.difference(found.lift(found.coefficients), _states(context)), 1e-6)


CASES = (
    Case(
        "identical snapshots, PBDW",
        "training",
        "twelve equal trajectories, centred",
        "nothing varies but round-off",
        _identical("PBDW"),
    ),
    Case(
        "identical snapshots, minimum variance",
        "training",
        "twelve equal trajectories",
        "the covariance is zero: 0/0",
        _identical("minimum variance"),
    ),
    Case(
        "snapshots of rank 3, n = 3",
        "training",
        "twelve trajectories of rank 3",
        "the fourth singular value is round-off",
        _dependent(3, 3),
    ),
    Case(
        "snapshots of rank 3, n = 4",
        "training",
        "one mode more than there are",
        "a mode made of round-off",
        _dependent(3, 4),
    ),
    Case(
        "snapshots of rank 3, minimum variance",
        "training",
        "twelve trajectories of rank 3",
        "a singular covariance",
        _dependent_minimum_variance,
    ),
    Case(
        "snapshots over 12 decades",
        "training",
        "singular values from 1 to 1e-12",
        "a Gram matrix squares them",
        _decades,
    ),
    Case(
        "compression to 1e-13",
        "training",
        "a tolerance near round-off",
        "the error itself is round-off",
        _tolerance(1e-13),
    ),
    Case("compression to 1e-17", "training", "a tolerance below round-off", "it cannot be met", _tolerance(1e-17)),
    Case(
        "constant 1e3 times what varies",
        "training",
        "a field at 1e3 times its variation, tolerance 1e-6",
        "the tolerance counts the constant",
        _constant(1e3),
    ),
    Case(
        "constant 1e6 times what varies",
        "training",
        "a field at 1e6 times its variation, tolerance 1e-6",
        "the tolerance is as large as the variation",
        _constant(1e6),
    ),
    Case("snapshots of size 1e-160", "training", "all values times 1e-160", "squares underflow", _scaled(1e-160)),
    Case("snapshots of size 1e160", "training", "all values times 1e160", "squares overflow", _scaled(1e160)),
    Case("snapshot with NaN", "training", "one NaN in a trajectory", "NaN spreads to every mode", _not_finite),
)
