"""Estimates written down as what they are, dense systems in extended precision, for comparison with the estimators.

PBDW is the minimiser of ‖Π_{V^⊥}u‖ under ℓ(u) = l: with u = y₀ + Φc + M⁻¹ℓᵀz, the system
``[[ℓM⁻¹ℓᵀ, ℓΦ], [(ℓΦ)ᵀ, 0]] (z, c) = (l − ℓy₀, 0)``. Minimum variance is a regularised least-squares problem
over the training anomalies. Neither forms G, R or an SVD as the estimators do.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.core.space import StateSpace
from dacore.estimators.minimum_variance import MinimumVariance, PreparedMinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.estimators.prepared_pbdw import PreparedPBDW
from dacore.workflow.stress.case import Outcome, conditioned
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.reference import EPS, Extended, Long, dense_solve, least_squares, long

# Settings of PBDW that every case starts from: one space for the cycle, nothing subtracted, as published.
WEIGHT = 1e-18


def pbdw(n: Any, weight: float = WEIGHT, **settings: Any) -> PBDW:
    """PBDW of dimension n, as published unless settings say otherwise."""
    plain: dict[str, Any] = {"centring": "none", "spaces": "cycle", "tails": "training"}
    return PBDW(n=n, weights={"p": weight}, **(plain | settings))


def suited(context: Context, settings: Any) -> Any:
    """Settings of an estimator whose weight of p is given to every field but the first, if the state has no p."""
    names = [field.name for field in context.space.fields]
    if not isinstance(settings, PBDW) or isinstance(settings.weights, str) or set(settings.weights) <= set(names):
        return settings
    weight = next(iter(settings.weights.values()))
    return replace(settings, weights=dict.fromkeys(names[1:], weight))


def pick(functionals: Functionals, rows: Any) -> Functionals:
    """Some functionals, in the order of `rows`; one may be asked for twice."""
    index = np.asarray(rows)
    return replace(
        functionals, matrix=csr_array(functionals.matrix[index]),
        labels=tuple(functionals.labels[i] for i in index), centres=functionals.centres[index],
        directions=functionals.directions[index], sites=functionals.sites[index],
    )  # fmt: skip


def joined(functionals: Functionals, rows: Any) -> Functionals:
    """Functionals with more `rows` (k, n_dofs) after them."""
    count = rows.shape[0]
    first = pick(functionals, np.zeros(count, dtype=np.int64))
    return replace(
        functionals, matrix=csr_array(vstack([functionals.matrix, rows], format="csr")),
        labels=(*functionals.labels, *(f"added {k}" for k in range(count))),
        centres=np.concatenate([functionals.centres, first.centres]),
        directions=np.concatenate([functionals.directions, first.directions]),
        sites=np.concatenate([functionals.sites, functionals.sites.max() + 1 + np.arange(count)]),
    )  # fmt: skip


def spread(functionals: Functionals, count: int) -> Functionals:
    """So many of the functionals, evenly spread."""
    return pick(functionals, np.unique(np.linspace(0, functionals.count - 1, count).astype(np.int64)))


def trained(background: Background, count: int) -> Background:
    """The first trajectories of a training set."""
    return replace(background, coefficients=background.coefficients[:, :, :count], samples=background.samples[:count])


@dataclass(frozen=True, eq=False)
class Fit:
    """A reference estimate.

    Parameters
    ----------
    states : (n_dofs, t, k) array
    condition : float
        Of the map from data to the estimate, scaled.
    """

    states: Long
    condition: float


def reference_pbdw(
    space: StateSpace, prepared: PreparedPBDW, functionals: Functionals, data: Array, steps: IntArray
) -> Fit:
    """The saddle point on the functionals of `prepared`, with its span of modes."""
    background = prepared.background
    gram, lifted = _representers(space, functionals, prepared.weights)
    states = np.empty((space.n_dofs, len(steps), data.shape[2]), dtype=np.longdouble)
    worst = 0.0
    for t in range(len(steps)):
        frame = prepared.spaces()[t if len(prepared.spaces()) > 1 else 0]
        modes = _lift(background, frame.modes[:, : frame.n])
        offset = _lift(background, prepared.offset[:, t : t + 1])
        seen = functionals.matrix @ modes
        m, n = seen.shape
        # Rows and columns of size one, so that pivots compare.
        unit = 1 / np.sqrt(np.diag(gram))
        size = 1 / np.maximum(np.sqrt(((unit[:, None] * seen) ** 2).sum(axis=0)), np.longdouble(1e-300))
        system = np.zeros((m + n, m + n), dtype=np.longdouble)
        system[:m, :m] = unit[:, None] * gram * unit
        system[:m, m:] = unit[:, None] * seen * size
        system[m:, :m] = system[:m, m:].T
        right = np.zeros((m + n, data.shape[2]), dtype=np.longdouble)
        right[:m] = unit[:, None] * (long(data[:, t]) - functionals.matrix @ offset)
        solution = dense_solve(system, right)
        z, c = unit[:, None] * solution[:m], size[:, None] * solution[m:]
        states[:, t] = offset + modes @ c + lifted @ z
        worst = max(worst, float(np.linalg.cond(system.astype(np.float64))))
    return Fit(states, worst)


def _representers(space: StateSpace, functionals: Functionals, weights: Any) -> tuple[Long, Long]:
    """Gram matrix (m, m) of the functionals and their representers (n_dofs, m)."""
    lifted = np.zeros((space.n_dofs, functionals.count), dtype=np.longdouble)
    for each in space.fields:
        block = space.layout.block(each.name)
        right = functionals.matrix[:, block].toarray().T
        if right.any():
            lifted[block] = Extended(space.field_product(each.name)).solve(right) / np.longdouble(weights[each.name])
    return np.asarray(functionals.matrix @ lifted), lifted


def _lift(background: Background, coefficients: Any) -> Long:
    """States (n_dofs, k) of coefficients (r, k) in extended precision."""
    space = background.space
    out = np.zeros((space.n_dofs, coefficients.shape[1]), dtype=np.longdouble)
    for each in space.fields:
        basis = long(background.bases[each.name].basis)
        out[space.layout.block(each.name)] = basis @ long(coefficients[background.block(each.name)])
    return out


def reference_minimum_variance(
    prepared: PreparedMinimumVariance, functionals: Functionals, data: Array, scale: float, sigma: Any = 1.0
) -> Fit:
    """Minimise ‖N^(−½)(l − L(mean + Aω))‖² + s²‖ω‖² by Householder's method; no decomposition of the data.

    Parameters
    ----------
    prepared : PreparedMinimumVariance
        For its training set and the floor that it found; window "cycle".
    functionals : Functionals
        Those that are kept.
    data : (m, t, k) array
        Theirs.
    scale : float
    sigma : float or (m,) array
        Standard deviations of the prepared noise.
    """
    background = prepared.background
    training = long(background.coefficients[:, prepared.times])
    # The whole cycle is estimated from the steps that are observed.
    rows = np.searchsorted(prepared.times, prepared.steps)
    count = training.shape[2]
    mean = training.mean(axis=2)
    anomalies = (training - mean[:, :, None]) / np.sqrt(np.longdouble(count - 1))
    seen = _seen(background, functionals)
    weight = 1 / (long(sigma) * np.ones(functionals.count, dtype=np.longdouble))[:, None, None]
    design = (weight * np.tensordot(seen, anomalies[:, rows], axes=1)).reshape(-1, count)
    shift = (weight * (long(data) - (seen @ mean[:, rows])[:, :, None])).reshape(len(design), -1)
    level = np.hypot(np.longdouble(scale), np.longdouble(prepared.floors[0]))
    omega = least_squares(
        np.concatenate([design, level * np.eye(count)]), np.concatenate([shift, np.zeros((count, shift.shape[1]))])
    )
    coefficients = mean[:, :, None] + np.tensordot(anomalies, omega, axes=1)
    states = _lift(background, coefficients.reshape(len(coefficients), -1))
    largest = float(np.linalg.norm(design.astype(np.float64), 2))
    return Fit(states.reshape(-1, *coefficients.shape[1:]), float(np.hypot(largest, level) / level))


def _seen(background: Background, functionals: Functionals) -> Long:
    """Functionals of the bases (m, r) in extended precision."""
    layout = background.space.layout
    parts = [
        functionals.matrix[:, layout.block(each.name)] @ long(background.bases[each.name].basis)
        for each in background.space.fields
    ]
    return np.concatenate(parts, axis=1)


def check_pbdw(
    context: Context, settings: PBDW, functionals: Functionals, data: Array, background: Background | None = None
) -> Outcome:
    """Estimate with PBDW and compare with the saddle point."""
    own, settings = background or context.background, suited(context, settings)

    def estimate() -> tuple[PreparedPBDW, Estimate]:
        prepared = settings.prepare(own, functionals, WhiteNoise())
        return prepared, prepared.estimate(data)

    prepared, found = context.ask(estimate)
    expected = reference_pbdw(context.space, prepared, functionals, data, prepared.steps)
    return held(context, found, expected, prepared)


def held(context: Context, found: Estimate, expected: Fit, prepared: PreparedPBDW) -> Outcome:
    """Compare an estimate of PBDW with its reference; a small β is told by the run's report."""
    beta = float(np.nanmin(prepared.inf_sup))
    told = f"β = {beta:.0e} in results.json and the report" if beta < 1e-3 else ""
    error = context.difference(found.state(), expected.states)
    # Round-off of the modes themselves is magnified by 1/β, whatever the scaling of the system.
    bound = conditioned(max(expected.condition, 1 / beta), EPS, 10.0)
    return Outcome(error, bound, told, f"n = {int(prepared.dimensions.max())}, β = {beta:.0e}")


def check_minimum_variance(
    context: Context,
    functionals: Functionals,
    data: Array,
    scale: float = 0.0,
    background: Background | None = None,
    settings: MinimumVariance | None = None,
) -> Outcome:
    """Estimate with minimum variance and compare with least squares."""
    own = background or context.background
    chosen = settings or MinimumVariance()

    def estimate() -> tuple[PreparedMinimumVariance, Estimate]:
        prepared = chosen.prepare(own, functionals, WhiteNoise())
        return prepared, prepared.estimate(data, scale)

    prepared, found = context.ask(estimate)
    expected = reference_minimum_variance(prepared, functionals, data, scale)
    error = context.difference(found.state(), expected.states)
    return Outcome(error, conditioned(expected.condition, EPS, 10.0), note=f"condition {expected.condition:.0e}")
