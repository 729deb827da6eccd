"""Noise at its limits, and whether the claimed uncertainty is honest."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.noise import CorrelatedNoise, NoiseModel, WhiteNoise
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.workflow.stress.case import Case, Inapplicable, Outcome, conditioned
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.inference import (
    WEIGHT,
    check_minimum_variance,
    pbdw,
    reference_minimum_variance,
    spread,
    suited,
)
from dacore.workflow.stress.reference import EPS, dense_solve, long

# An error of more than so many claimed deviations is not covered.
COVERED = 4.0
# Deviations learnt from 12 errors scatter by a third themselves: so much more than one is still honest.
HONEST = 1.5
SAMPLES = 12


def _zero(context: Context) -> Outcome:
    functionals = spread(context.functionals, 60)
    return check_minimum_variance(context, functionals, functionals(context.truth))


def _huge(context: Context) -> Outcome:
    """Without information the estimate is the training mean and its deviation that of the training set."""
    functionals, quantity = spread(context.functionals, 60), _quantity(context)
    data = functionals(context.truth)
    prepared = MinimumVariance(deviations="model").prepare(context.background, functionals, WhiteNoise())
    found = context.ask(lambda: prepared.estimate(data, 1e12 * float(np.abs(data).max())))
    mean = context.background.lift(context.background.mean())
    values = _of_training(context, quantity)
    deviation = found.standard_deviation(quantity)
    error = max(
        context.difference(found.state(), np.repeat(mean[:, :, None], data.shape[2], axis=2)),
        float(np.abs(deviation / values.std(axis=1, ddof=1)[:, None] - 1).max()),
    )
    return Outcome(error, 1e-8, note="training mean and deviation")


def _of_training(context: Context, quantity: QuantityOfInterest) -> Array:
    """Values (s, K) of a quantity on the training set."""
    background = context.background
    values = np.tensordot(
        background.observe(quantity.functionals(context.space).matrix), background.coefficients, axes=1
    )
    weights = quantity.time_weights(values.shape[1])
    return np.asarray(np.einsum("ot,stk->sok", weights, values)).reshape(-1, values.shape[2])


def _scale(value: float) -> Any:
    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        prepared = MinimumVariance().prepare(context.background, functionals, WhiteNoise())
        found = context.ask(lambda: prepared.estimate(functionals(context.truth), value))
        return Outcome(context.difference(found.state(), context.truth), 0.0)

    return run


def _unit_of_noise(sigma: float) -> Any:
    """The prepared noise is a unit of measure: with the scale's inverse it must not matter, however small or large."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        data = functionals(context.truth)
        level = 0.05 * float(np.abs(data).max())
        plain = MinimumVariance().prepare(context.background, functionals, WhiteNoise()).estimate(data, level)

        def estimate() -> Estimate:
            return (
                MinimumVariance()
                .prepare(context.background, functionals, WhiteNoise(sigma))
                .estimate(data, level / sigma)
            )

        found = context.ask(estimate)
        return Outcome(context.difference(found.state(), plain.state()), 1e-10)

    return run


def _correlated(context: Context) -> Outcome:
    """Noise with a covariance of condition 1e12: whitening loses digits."""
    functionals = spread(context.functionals, 30)
    m = functionals.count
    data = functionals(context.truth)
    q, _ = np.linalg.qr(context.rng(6).standard_normal((m, m)))
    variances = np.geomspace(1.0, 1e-12, m) * (0.05 * np.abs(data).max()) ** 2
    covariance = (q * variances) @ q.T
    covariance = 0.5 * (covariance + covariance.T)
    noise: NoiseModel = context.ask(lambda: CorrelatedNoise(covariance))
    prepared = MinimumVariance().prepare(context.background, functionals, noise)
    found = context.ask(lambda: prepared.estimate(data, 1.0))
    # Whitened by hand: an elimination in extended precision is as good as a Cholesky factor there.
    white = dense_solve(_lower(long(covariance)), np.eye(m))
    turned = replace(
        functionals, matrix=type(functionals.matrix)(np.asarray(white, dtype=np.float64) @ functionals.matrix)
    )
    expected = reference_minimum_variance(prepared, turned, np.tensordot(white, long(data), axes=1), 1.0)
    error = context.difference(found.state(), expected.states)
    return Outcome(error, conditioned(1e12, EPS), note="condition of the covariance 1e12")


def _lower(matrix: Any) -> Any:
    """Cholesky factor in extended precision."""
    out = np.zeros_like(matrix)
    for k in range(len(matrix)):
        out[k:, k] = matrix[k:, k] - out[k:, :k] @ out[k, :k]
        out[k:, k] /= np.sqrt(out[k, k])
    return out


def _quantity(context: Context) -> QuantityOfInterest:
    if not context.session.quantities:
        raise Inapplicable("the scene asks for no quantity")
    return next(iter(context.session.quantities.values()))


def _covered(estimator: str, noise: float, **settings: Any) -> Any:
    """The scene's own quantity on unseen cases: its error against the deviation that is claimed for it."""

    def run(context: Context) -> Outcome:
        quantity, functionals = _quantity(context), context.functionals
        data = functionals(context.truth)
        sigma = noise * float(np.abs(data).max())
        data += sigma * context.rng(7).standard_normal(data.shape)
        chosen = MinimumVariance() if estimator == "minimum variance" else suited(context, pbdw(8, **settings))
        found = context.ask(lambda: chosen.prepare(context.background, functionals, WhiteNoise()).estimate(data, sigma))
        values = quantity.functionals(context.space)(context.truth)
        weights = quantity.time_weights(values.shape[1])
        truth = np.einsum("ot,stk->sok", weights, values).reshape(-1, values.shape[2])
        return _in_deviations(
            found.quantity(quantity) - truth, found.standard_deviation(quantity), float(np.abs(truth).max())
        )

    return run


def _in_deviations(error: Array, deviation: Array, size: float) -> Outcome:
    """Error relative to the quantity; small, or covered by the deviation that comes with it."""
    relative = float(np.abs(error).max() / size)
    ratio = float((np.abs(error) / deviation).max())
    told = f"errors of up to {ratio:.1f} claimed deviations" if ratio <= COVERED else ""
    return Outcome(relative, 1e-3, told, "" if told else f"off by {ratio:.0f} claimed deviations")


def _unseen(estimator: str, draws: int, **settings: Any) -> Any:
    """Fields that know nothing of each other: data of the first say nothing of the last.

    Over many training sets, since one that happens to be misleading proves nothing.
    """

    def run(context: Context) -> Outcome:
        fields, functionals = context.space.fields, spread(context.functionals, 60)
        block = context.space.layout.block(fields[-1].name)
        if len(fields) < 2 or functionals.matrix[:, block].nnz:
            raise Inapplicable("the scene measures every field")
        weights = np.zeros((1, context.space.n_dofs))
        weights[0, block] = 1.0 / (block.stop - block.start)
        mean, draw = Mean(weights), _independent(context)
        own, truth = context.background, draw(context.rng(8), 100)
        data = np.tensordot(own.observe(functionals.matrix), truth, axes=1)
        exact = np.tensordot(own.observe(mean.functionals(context.space).matrix), truth, axes=1).mean(axis=1)
        sigma = 0.05 * float(np.abs(data).max())
        chosen = suited(context, pbdw(4, 1.0)) if estimator == "PBDW" else MinimumVariance(**settings)
        squares, claimed = [], []
        for seed in range(draws):
            background = replace(
                own,
                coefficients=draw(context.rng(100 + seed), SAMPLES),
                samples=np.zeros((SAMPLES, own.samples.shape[1])),
            )
            found = context.ask(partial(_estimated, chosen, background, functionals, data, sigma))
            deviation = found.standard_deviation(mean)
            squares.append((((found.quantity(mean) - exact) / deviation) ** 2).mean())
            claimed.append(np.median(deviation) / np.std(exact))
        context.heard[:] = context.heard[:1]  # the same of every training set, but for a number
        note = f"claimed {np.median(claimed):.2f} of the spread, {draws} training sets of {SAMPLES}"
        return Outcome(float(np.sqrt(np.mean(squares))), HONEST, note=note)

    return run


def _estimated(chosen: Any, background: Background, functionals: Functionals, data: Array, sigma: float) -> Estimate:
    estimate: Estimate = chosen.prepare(background, functionals, WhiteNoise()).estimate(data, sigma)
    return estimate


def _independent(context: Context) -> Callable[[np.random.Generator, int], Array]:
    """What draws trajectories in the scene's own modes, each field independently of the others."""
    own = context.background
    parts = [own.block(each.name) for each in context.space.fields]
    t, rank = len(own.times), 6
    rng = context.rng(9)
    patterns = [rng.standard_normal((part.stop - part.start, t, rank)) * 0.7 ** np.arange(rank) for part in parts]
    centre = own.coefficients.mean(axis=2)

    def draw(generator: np.random.Generator, count: int) -> Array:
        out = np.repeat(centre[:, :, None], count, axis=2)
        for part, pattern in zip(parts, patterns, strict=True):
            size = float(np.abs(centre[part]).max())
            out[part] += 0.1 * size * np.tensordot(pattern, generator.standard_normal((rank, count)), axes=1)
        return out

    return draw


class Mean(QuantityOfInterest):
    """Mean over time of one weighted sum of the dofs."""

    over_time = "mean"

    def __init__(self, weights: Array) -> None:
        self.weights = weights

    def functionals(self, space: Any) -> Any:
        """Return the functional."""
        return Functionals(
            csr_array(self.weights), ("mean",), "1", np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, dtype=np.int64)
        )


_HONEST = "nothing measured says anything of it, but 12 samples suggest something"


CASES = (
    Case(
        "no noise, minimum variance",
        "noise",
        "exact data, noise scale 0",
        "only what training leaves out bounds the gain",
        _zero,
    ),
    Case("noise 1e12 times the data", "noise", "data that say nothing", "the prior must come out", _huge),
    Case("noise scale NaN", "noise", "a noise scale of NaN", "NaN passes comparisons unnoticed", _scale(np.nan)),
    Case("noise scale negative", "noise", "a noise scale of −1", "its square is positive", _scale(-1.0)),
    Case("noise of 1e-200", "noise", "a prepared σ of 1e-200", "squares overflow", _unit_of_noise(1e-200)),
    Case("noise of 1e200", "noise", "a prepared σ of 1e200", "squares vanish", _unit_of_noise(1e200)),
    Case(
        "correlated noise, condition 1e12",
        "noise",
        "a covariance of condition 1e12",
        "whitening magnifies round-off",
        _correlated,
    ),
    Case(
        "deviation, no noise",
        "noise",
        "claimed deviation, exact data",
        "the error is that of the training set",
        _covered("minimum variance", 0.0),
    ),
    Case(
        "deviation, 10% noise",
        "noise",
        "claimed deviation, 10% noise",
        "noise and training set both err",
        _covered("minimum variance", 0.1),
    ),
    Case(
        "deviation, PBDW, 10% noise",
        "noise",
        "claimed deviation, 10% noise, no mean",
        "noise is magnified by 1/β",
        _covered("PBDW", 0.1),
    ),
    Case(
        "deviation, zeta x 1e12",
        "noise",
        "claimed deviation, PBDW with a foolish ζ",
        "the space is the wrong one",
        _covered("PBDW", 0.0, weight=WEIGHT * 1e12),
    ),
    Case(
        "unseen field, held out", "noise", "a field independent of the data", _HONEST, _unseen("minimum variance", 20)
    ),
    Case(
        "unseen field, model",
        "noise",
        "the same, deviations = 'model'",
        _HONEST,
        _unseen("minimum variance", 20, deviations="model"),
    ),
    Case("unseen field, PBDW", "noise", "the same with PBDW", _HONEST, _unseen("PBDW", 4)),
)
