"""Data that are missing, broken, in the wrong unit, or of an unusual shape."""

from typing import Any

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.estimator import Estimator, PreparedEstimator
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.workflow.stress.case import Case, Outcome, conditioned
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.inference import (
    check_minimum_variance,
    check_pbdw,
    held,
    pbdw,
    pick,
    reference_minimum_variance,
    reference_pbdw,
    spread,
    suited,
)
from dacore.workflow.stress.reference import EPS

ESTIMATORS: dict[str, Estimator] = {"PBDW": pbdw(6), "minimum variance": MinimumVariance()}
NOISE = 0.05


def _prepared(context: Context, name: str, functionals: Functionals) -> PreparedEstimator:
    made: PreparedEstimator = suited(context, ESTIMATORS[name]).prepare(context.background, functionals, WhiteNoise())
    return made


def _dead(context: Context, count: int) -> tuple[Functionals, Array, BoolArray]:
    """Functionals of which the last third is dead: data that read NaN there."""
    functionals = spread(context.functionals, count)
    mask = np.arange(functionals.count) < 2 * functionals.count // 3
    data = functionals(context.truth)
    data[~mask] = np.nan
    return functionals, data, mask


def _dead_slice(name: str, kind: str) -> Any:
    """A mask gives what was never measured: the reference is prepared without the dead functionals."""

    def run(context: Context) -> Outcome:
        functionals, data, mask = _dead(context, 60)
        prepared = _prepared(context, name, functionals)
        given: Any = mask if kind == "bool" else mask.astype(np.int64)
        found = context.ask(lambda: prepared.estimate(data, 0.0, given))
        alive = pick(functionals, np.flatnonzero(mask))
        without = check_pbdw if name == "PBDW" else check_minimum_variance
        settings: tuple[Any, ...] = (ESTIMATORS[name], alive, data[mask]) if name == "PBDW" else (alive, data[mask])
        reference = without(context, *settings)  # that is right: the mask must give the same
        expected = _prepared(context, name, alive).estimate(data[mask], 0.0)
        error = context.difference(found.state(), expected.state()) + reference.error
        return Outcome(error, 2 * reference.bound, note=reference.note)

    return run


def _broken(value: float) -> Any:
    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        data = functionals(context.truth)
        data[3, 1, 0] = value
        prepared = _prepared(context, "minimum variance", functionals)
        found = context.ask(lambda: prepared.estimate(data, 0.0))
        return Outcome(context.difference(found.state(), context.truth), 0.0)

    return run


def _masked(name: str) -> Any:
    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        prepared = _prepared(context, name, functionals)
        nothing = np.zeros(functionals.count, dtype=bool)
        found = context.ask(lambda: prepared.estimate(functionals(context.truth), 0.0, nothing))
        return Outcome(context.difference(found.state(), context.truth), 0.0)

    return run


def _unit(name: str, factor: float) -> Any:
    """Data in another unit: the estimate is off by that factor, and something must say so."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 60)
        exact = functionals(context.truth)
        sigma = NOISE * float(np.abs(exact).max())
        prepared = _prepared(context, name, functionals)
        right = prepared.estimate(exact, sigma).state()
        found = context.ask(lambda: prepared.estimate(factor * exact, abs(factor) * sigma)).state()
        # In the right unit the same numbers come out; nominal is what noise of that size does.
        return Outcome(context.difference(found, right), NOISE)

    return run


def _single(name: str) -> Any:
    """float32 data carry 6e-8 of round-off: no more than its size times the estimator's gain may come of it."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 60)
        exact = functionals(context.truth)
        rounded: Any = exact.astype(np.float32)
        prepared = _prepared(context, name, functionals)
        found = context.ask(lambda: prepared.estimate(rounded, 0.0)).state()
        same = prepared.estimate(rounded.astype(np.float64), 0.0).state()
        # The numbers are taken as they are; what rounding does to the answer is bounded by the gain.
        gap = context.difference(found, same)
        effect = context.difference(found, prepared.estimate(exact, 0.0).state())
        gain = _gain(context, prepared, exact)
        bound = conditioned(gain, float(np.finfo(np.float32).eps))
        told = f"β = {np.nanmin(prepared.inf_sup):.0e} in the report" if name == "PBDW" else ""
        return Outcome(max(gap, effect), bound, told, f"gain {gain:.0e}")

    return run


def _gain(context: Context, prepared: PreparedEstimator, data: Array) -> float:
    """Relative change of the estimate for a relative change of the data, the worst of 20 random ones, times ten."""
    here = prepared.estimate(data, 0.0).state()
    worst = 0.0
    for seed in range(20):
        change = 1e-6 * context.rng(seed).standard_normal(data.shape) * np.abs(data)
        worst = max(worst, context.difference(prepared.estimate(data + change, 0.0).state(), here) / 1e-6)
    return 10.0 * worst


def _shape(name: str, what: str) -> Any:
    """Unusual, but right: one time step, no series at all."""

    def run(context: Context) -> Outcome:
        functionals = spread(context.functionals, 40)
        steps = np.array([2]) if what == "one step" else np.arange(len(context.background.times))
        chosen = context.truth[:, steps] if what == "one step" else context.truth[:, :, :0]
        data = functionals(chosen)
        prepared: Any = suited(context, ESTIMATORS[name]).prepare(context.background, functionals, WhiteNoise(), steps)
        found = context.ask(lambda: prepared.estimate(data, 0.0))
        if what == "no series":
            right = found.state().shape == (context.space.n_dofs, len(steps), 0)
            return Outcome(0.0 if right else np.inf, 0.0, note=f"states of shape {found.state().shape}")
        if name == "PBDW":
            return held(context, found, reference_pbdw(context.space, prepared, functionals, data, steps), prepared)
        expected = reference_minimum_variance(prepared, functionals, data, 0.0)
        error = context.difference(found.state(), expected.states)
        return Outcome(error, conditioned(expected.condition, EPS, 10.0))

    return run


def _complex(context: Context) -> Outcome:
    """Phasors, as elastography has them: their real part alone is another measurement."""
    functionals = spread(context.functionals, 40)
    prepared = _prepared(context, "minimum variance", functionals)
    data: Any = functionals(context.truth) * np.exp(0.5j)
    found = context.ask(lambda: prepared.estimate(data, 0.0))
    return Outcome(context.difference(found.state(), prepared.estimate(functionals(context.truth), 0.0).state()), 1e-6)


def _transposed(context: Context) -> Outcome:
    functionals = spread(context.functionals, 40)
    prepared = _prepared(context, "minimum variance", functionals)
    data = functionals(context.truth).swapaxes(0, 1)
    found = context.ask(lambda: prepared.estimate(data, 0.0))
    return Outcome(context.difference(found.state(), context.truth), 0.0)


_UNIT = "an estimate is linear in the data: it grows with them"

CASES = (
    Case(
        "dead slice, PBDW",
        "data",
        "a third of the data NaN, masked",
        "what is masked must leave no trace",
        _dead_slice("PBDW", "bool"),
    ),
    Case(
        "dead slice, minimum variance",
        "data",
        "a third of the data NaN, masked",
        "what is masked must leave no trace",
        _dead_slice("minimum variance", "bool"),
    ),
    Case(
        "mask of integers",
        "data",
        "a mask of 0 and 1 instead of False and True",
        "integers select rows by number",
        _dead_slice("minimum variance", "int"),
    ),
    Case("NaN in the data", "data", "one NaN, no mask", "NaN spreads to everything", _broken(np.nan)),
    Case("infinite data", "data", "one infinite value, no mask", "∞ times 0 is NaN", _broken(np.inf)),
    Case("all data masked, PBDW", "data", "no functional left", "nothing is known", _masked("PBDW")),
    Case(
        "all data masked, minimum variance",
        "data",
        "no functional left",
        "nothing is known",
        _masked("minimum variance"),
    ),
    Case("unit too small, PBDW", "data", "data 1000 times too large", _UNIT, _unit("PBDW", 1e3)),
    Case(
        "unit too small, minimum variance", "data", "data 1000 times too large", _UNIT, _unit("minimum variance", 1e3)
    ),
    Case("unit too large, PBDW", "data", "data 1000 times too small", _UNIT, _unit("PBDW", 1e-3)),
    Case(
        "unit too large, minimum variance", "data", "data 1000 times too small", _UNIT, _unit("minimum variance", 1e-3)
    ),
    Case("wrong sign, minimum variance", "data", "data with the sign reversed", _UNIT, _unit("minimum variance", -1.0)),
    Case("float32 data, PBDW", "data", "data in single precision", "round-off is magnified by 1/β", _single("PBDW")),
    Case(
        "float32 data, minimum variance",
        "data",
        "data in single precision",
        "round-off acts like noise",
        _single("minimum variance"),
    ),
    Case(
        "one time step, PBDW", "data", "a series of length 1", "axes of length 1 broadcast", _shape("PBDW", "one step")
    ),
    Case(
        "one time step, minimum variance",
        "data",
        "a series of length 1",
        "axes of length 1 broadcast",
        _shape("minimum variance", "one step"),
    ),
    Case("no series, PBDW", "data", "k = 0 series", "empty arrays", _shape("PBDW", "no series")),
    Case(
        "no series, minimum variance", "data", "k = 0 series", "empty arrays", _shape("minimum variance", "no series")
    ),
    Case("complex data", "data", "phasors in place of real values", "the imaginary part is dropped", _complex),
    Case("transposed data", "data", "(steps, functionals, series)", "shapes may fit by chance", _transposed),
)
