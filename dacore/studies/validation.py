"""Validation on unseen cases: the same data to every estimator, the same errors of each.

Errors are relative norms for each field: at each step, and over the whole trajectory (ratio of
space–time norms, which does not explode where the field is tiny). Beside every estimator stands
the guess of the training mean. docs/method.md: Noise, Errors and numbers of interest.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.estimator import Estimate, PreparedEstimator
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.frames import balanced_weights
from dacore.studies.errors import JOINT, Contrast, ErrorMeter

PRIOR = "prior"
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class QuantityOutcome:
    """A quantity of interest over the cases.

    Parameters
    ----------
    truth, estimate : (s, k) array
        s numbers for each case: one for each functional and output in time.
    deviation : (s, k) array
        Standard deviation the estimator claims; NaN where it claims none.
    """

    truth: Array
    estimate: Array
    deviation: Array

    @property
    def rms(self) -> float:
        """Root mean square error over all numbers and cases."""
        return float(np.sqrt(np.mean((self.estimate - self.truth) ** 2)))

    @property
    def worst(self) -> float:
        """Largest absolute error."""
        return float(np.abs(self.estimate - self.truth).max())


@dataclass(frozen=True, eq=False)
class Outcome:
    """One estimator at one noise level.

    Parameters
    ----------
    estimator : str
        Name in the scene, or "prior" for the training mean.
    noise : float
        Level Ξ.
    per_step : mapping of str to (t, k) array
        Relative error of each field, contrast and the joint norm; NaN where the true field is zero.
    space_time : mapping of str to (k,) array
        Ratio of space–time norms.
    quantities : mapping of str to QuantityOutcome
    estimate : Estimate or None
    seconds : float
        Wall time of estimating all cases (without errors).
    """

    estimator: str
    noise: float
    per_step: Mapping[str, Array]
    space_time: Mapping[str, Array]
    quantities: Mapping[str, QuantityOutcome]
    estimate: Estimate | None
    seconds: float

    def worst_case(self, error: str) -> int:
        """Number of the case whose space–time error is largest."""
        return int(np.argmax(np.nan_to_num(self.space_time[error], nan=-1.0)))


@dataclass(frozen=True, eq=False)
class Validation:
    """All outcomes and the data they come from.

    Parameters
    ----------
    outcomes : tuple of Outcome
        The training mean first, then estimator by estimator for each noise level.
    errors : tuple of str
        Labels of the errors.
    clean : (m, t, k) array
        Noise-free measurements.
    data : mapping of float to (m, t, k) array
        Measurements at each noise level.
    sigmas : mapping of float to (k,) array
        Standard deviation of the noise of each case.
    joint_weights : mapping of str to float
        Field weights of the joint norm.
    """

    outcomes: tuple[Outcome, ...]
    errors: tuple[str, ...]
    clean: Array
    data: Mapping[float, Array]
    sigmas: Mapping[float, Array]
    joint_weights: Mapping[str, float]

    @property
    def headline(self) -> str:
        """The error that says most: that of the last contrast, or of the last field."""
        return [label for label in self.errors if label != JOINT][-1]

    def best(self, estimators: Sequence[str], noise: float) -> Outcome:
        """Return the outcome of the least mean headline error at one noise level."""
        outcomes = [self.outcome(name, noise) for name in estimators]
        return min(outcomes, key=lambda each: float(np.nan_to_num(each.space_time[self.headline], nan=np.inf).mean()))

    def outcome(self, estimator: str, noise: float) -> Outcome:
        """Return one outcome; the training mean is the same at every noise level."""
        for each in self.outcomes:
            if each.estimator == estimator and (estimator == PRIOR or each.noise == noise):
                return each
        raise ShapeError(f"outcome: none of {estimator!r} at noise {noise}")


def noisy(clean: Array, level: float, seed: int) -> tuple[Array, Array]:
    """Add noise of σ = Ξ max|ℓ_i(u(t))|, a σ for each case.

    Parameters
    ----------
    clean : (m, t, k) array
    level : float
        Ξ.
    seed : int
        Each level and case has a stream of its own, so adding one changes no other.

    Returns
    -------
    data : (m, t, k) array
    sigmas : (k,) array
    """
    sigmas = level * np.abs(clean).max(axis=(0, 1))
    data = clean.copy()
    if level > 0:
        for case in range(clean.shape[2]):
            rng = np.random.default_rng([seed, round(level * 1e9), case])
            data[:, :, case] += sigmas[case] * rng.standard_normal(clean.shape[:2])
    return data, sigmas


def validate(
    background: Background,
    functionals: Functionals,
    prepared: Mapping[str, PreparedEstimator],
    truths: Sequence[Trajectory],
    quantities: Mapping[str, QuantityOfInterest],
    contrasts: Sequence[Contrast],
    levels: Sequence[float],
    seed: int,
    progress: Progress | None = None,
) -> Validation:
    """Estimate every case with every estimator at every noise level.

    Parameters
    ----------
    background : Background
    functionals : Functionals
    prepared : mapping of str to PreparedEstimator
        Prepared with noise of unit standard deviation.
    truths : sequence of Trajectory
        Read one at a time, twice.
    quantities : mapping of str to QuantityOfInterest
    contrasts : sequence of Contrast
    levels : sequence of float
    seed : int
    progress : callable, optional
    """
    space = background.space
    asked = {name: (quantity, quantity.functionals(space)) for name, quantity in quantities.items()}
    measured: list[Array] = []
    true_values: dict[str, list[Array]] = {name: [] for name in asked}
    for truth in truths:
        measured.append(functionals(truth.states))
        for name, (quantity, seen) in asked.items():
            true_values[name].append(_quantity_of(quantity, seen, truth.states))
    clean = np.stack(measured, axis=2)
    data, sigmas = {}, {}
    for level in levels:
        data[level], sigmas[level] = noisy(clean, level, seed)
    jobs: list[tuple[str, float, Estimate, float]] = []
    for level in levels:
        for name, estimator in prepared.items():
            started = time.perf_counter()
            estimate = estimator.estimate(data[level], noise_scale=sigmas[level])
            jobs.append((name, level, estimate, time.perf_counter() - started))
    count = len(truths)
    steps = np.arange(len(background.times))
    prior = Estimate(background, steps, np.repeat(background.mean()[:, :, None], count, axis=2))
    jobs.insert(0, (PRIOR, 0.0, prior, 0.0))
    weights = balanced_weights(background, background.coefficients - background.mean()[:, :, None])
    meter = ErrorMeter(space, "l2", contrasts, weights)
    tables: list[list[dict[str, tuple[Array, Array]]]] = [[] for _ in jobs]
    for case, truth in enumerate(truths):
        reference = meter.reference(truth.states)
        for job, (_, _, estimate, _) in enumerate(jobs):
            tables[job].append(meter.errors(truth.states - estimate.state(series=case), reference))
        if progress:
            progress(case + 1, count)
    truth_values = {name: np.stack(values, axis=1) for name, values in true_values.items()}
    outcomes = [
        _outcome(name, level, estimate, seconds, rows, quantities, truth_values)
        for (name, level, estimate, seconds), rows in zip(jobs, tables, strict=True)
    ]
    return Validation(tuple(outcomes), meter.labels, clean, data, sigmas, weights)


def _outcome(
    name: str,
    level: float,
    estimate: Estimate,
    seconds: float,
    rows: Sequence[dict[str, tuple[Array, Array]]],
    quantities: Mapping[str, QuantityOfInterest],
    truth_values: Mapping[str, Array],
) -> Outcome:
    per_step, space_time = {}, {}
    for label in rows[0]:
        above = np.stack([row[label][0] for row in rows], axis=1)
        below = np.stack([row[label][1] for row in rows], axis=1)
        per_step[label] = _ratio(above, below)
        space_time[label] = _ratio(np.sqrt((above**2).sum(axis=0)), np.sqrt((below**2).sum(axis=0)))
    values = {}
    for title, quantity in quantities.items():
        found = estimate.quantity(quantity)
        deviation = np.full(found.shape, np.nan)
        if estimate.uncertainty is not None:
            deviation = estimate.standard_deviation(quantity)
        values[title] = QuantityOutcome(truth_values[title], found, deviation)
    return Outcome(name, level, per_step, space_time, values, None if name == PRIOR else estimate, seconds)


def _quantity_of(quantity: QuantityOfInterest, functionals: Functionals, states: Array) -> Array:
    values = functionals(states)
    return np.asarray(np.einsum("ot,st->so", quantity.time_weights(states.shape[1]), values)).reshape(-1)


def _ratio(above: Array, below: Array) -> Array:
    """Relative error, NaN where there is nothing to be relative to."""
    return np.asarray(np.divide(above, below, out=np.full_like(above, np.nan), where=below > 0))
