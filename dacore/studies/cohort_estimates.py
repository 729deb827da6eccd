"""Estimates of a whole cohort, some patients at a time: numbers of interest, what is claimed of them, errors of fields.

Only what is small is kept of each patient, so that memory does not grow with trajectories.
"""

import pickle
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.display import Displayed
from dacore.core.estimator import Estimate, ParameterEstimate, PreparedEstimator, Uncertainty, weights_of
from dacore.core.misfit import Misfit
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError, WorkerError
from dacore.execution.foreach import crew
from dacore.studies.calibration import LEVELS, central_probabilities
from dacore.studies.cohort import Patients, forward_of, measured
from dacore.studies.errors import Contrast
from dacore.studies.reference import Progress
from dacore.studies.span_errors import SpanErrors
from dacore.studies.validation import joint_weights

# Bytes of trajectories and data that are held at once, and how many copies of each there are at most.
_CHUNK_BYTES = 256 * 2**20
_COPIES = 6
_MOST = 256


@dataclass(frozen=True, eq=False, repr=False)
class Claims(Displayed):
    """A quantity of interest: what is true, what was found, what was claimed.

    Parameters
    ----------
    truth, estimate : (s, k) array
    deviation : (s, k) array
        NaN where the estimator claims none.
    probabilities : (q,) array
        Rising, symmetric about 1/2.
    quantiles : (q, s, k) array
        NaN where the estimator claims none.
    """

    truth: Array
    estimate: Array
    deviation: Array
    probabilities: Array
    quantiles: Array

    def interval(self, level: float) -> tuple[Array, Array]:
        """Central interval (low, high), each (s, k); one of the levels that were asked for."""
        found = []
        for chance in (0.5 - level / 2, 0.5 + level / 2):
            place = int(np.argmin(np.abs(self.probabilities - chance)))
            if abs(self.probabilities[place] - chance) > 1e-9:
                kept = np.round(2 * self.probabilities[self.probabilities > 0.5] - 1, 6)
                raise ShapeError(f"level: got {level}, expected one of {', '.join(f'{each:g}' for each in kept)}")
            found.append(self.quantiles[place])
        return found[0], found[1]


@dataclass(frozen=True, eq=False, repr=False)
class CohortOutcome(Displayed):
    """One estimator at one noise level.

    Parameters
    ----------
    estimator : str
    noise : float
        Level Ξ.
    sigmas : (k,) array
        Standard deviation of each patient's noise.
    quantities : mapping of str to Claims
    errors : mapping of str to (k,) array
        Ratio of space–time norms of each field, contrast and the joint state; empty if not asked for.
    guess_errors : mapping of str to (k,) array
        The same of the training mean.
    misfit : Misfit, optional
    parameters : ParameterEstimate, optional
    seconds : float
        Wall time of estimating, all workers together.
    """

    estimator: str
    noise: float
    sigmas: Array
    quantities: Mapping[str, Claims]
    errors: Mapping[str, Array]
    guess_errors: Mapping[str, Array]
    misfit: Misfit | None
    parameters: ParameterEstimate | None
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class Cohort(Displayed):
    """All outcomes of a cohort.

    Parameters
    ----------
    patients : Patients
    outcomes : tuple of CohortOutcome
        Estimator by estimator for each noise level.
    guess : mapping of str to ((s,) array, (s,) array)
        Mean and standard deviation of each quantity over the training set.
    accuracy : mapping of str to float
        Of each field, the relative error of the map that the truths came from.
    """

    patients: Patients
    outcomes: tuple[CohortOutcome, ...]
    guess: Mapping[str, tuple[Array, Array]]
    accuracy: Mapping[str, float]

    def outcome(self, estimator: str, noise: float) -> CohortOutcome:
        """Return one outcome."""
        for each in self.outcomes:
            if each.estimator == estimator and each.noise == noise:
                return each
        raise ShapeError(f"outcome: none of {estimator!r} at noise {noise}")


def estimate_cohort(
    background: Background,
    functionals: Functionals,
    prepared: Mapping[str, PreparedEstimator],
    patients: Patients,
    quantities: Mapping[str, QuantityOfInterest],
    levels: Sequence[float],
    contrasts: Sequence[Contrast] = (),
    steps: IntArray | None = None,
    errors: bool = True,
    intervals: Sequence[float] = LEVELS,
    chunk: int | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Cohort:
    """Estimate every patient with every estimator at every noise level.

    Parameters
    ----------
    background : Background
        With a map from parameters to trajectories.
    functionals : Functionals
    prepared : mapping of str to PreparedEstimator
        On this background and these functionals, with noise of unit standard deviation.
    patients : Patients
    quantities : mapping of str to QuantityOfInterest
    levels : sequence of float
        Ξ.
    contrasts : sequence of Contrast
        Errors relative to the distance of a field from a constant.
    steps : (s,) int array, optional
        Times whose data the estimators are given, as they were prepared; noise is as if all were measured.
    errors : bool
        Whether errors of fields are wanted.
    intervals : sequence of float
        Levels of the central intervals to keep.
    chunk : int, optional
        Patients at a time; by default as many as need 256 MiB.
    workers, scheduler
        As for `dacore.execution.foreach.crew`. Numbers do not depend on them.
    progress : callable, optional
        Called with (done, total) patients.

    Raises
    ------
    CapabilityError
        If the background has no such map.
    WorkerError
        If an estimator cannot be sent to workers, or workers cannot be had.
    """
    forward = forward_of(background)
    if not levels or not prepared:
        raise ShapeError("cohort: got no noise level or no estimator, expected at least one of each")
    work = _Work(
        background, functionals, background.observe(functionals.matrix), dict(prepared), patients, dict(quantities),
        tuple(levels), tuple(contrasts), steps, errors, tuple(central_probabilities(intervals)),
        joint_weights(background),
    )  # fmt: skip
    size = chunk or _chunk(background, functionals)
    parts = [(start, min(start + size, patients.count)) for start in range(0, patients.count, size)]
    found: dict[tuple[int, int], list[CohortOutcome]] = {}
    with crew(_estimate, _settled(work), min(workers, len(parts)), scheduler) as run:
        try:
            with closing(run(parts)) as results:
                for part, outcomes in results:
                    found[part] = outcomes
                    if progress:
                        progress(sum(stop - start for start, stop in found), patients.count)
        except (pickle.PicklingError, TypeError) as error:
            if "pickle" not in str(error):
                raise
            raise WorkerError(f"cohort: an estimator cannot be sent to workers ({error}); use workers = 1") from error
    table = zip(*(found[part] for part in parts), strict=True)
    guess = {name: _guess(background, quantity) for name, quantity in quantities.items()}
    return Cohort(patients, tuple(_joined(row) for row in table), guess, dict(forward.accuracy))


@dataclass(frozen=True, eq=False)
class _Work:
    """What every chunk needs."""

    background: Background
    functionals: Functionals
    observed: Array
    prepared: Mapping[str, PreparedEstimator]
    patients: Patients
    quantities: Mapping[str, QuantityOfInterest]
    levels: tuple[float, ...]
    contrasts: tuple[Contrast, ...]
    steps: IntArray | None
    errors: bool
    probabilities: tuple[float, ...]
    weights: Mapping[str, float]


def _settled(work: _Work) -> _Work:
    """The same with every array as it is after a journey to a worker: strided ones contiguous, others not copied.

    Matrix products of another layout differ in the last bit.
    """
    buffers: list[pickle.PickleBuffer] = []
    try:
        packed = pickle.dumps(work, protocol=5, buffer_callback=buffers.append)
    except (pickle.PicklingError, TypeError, AttributeError):
        return work  # it does not travel
    settled: _Work = pickle.loads(packed, buffers=buffers)
    return settled


def _estimate(work: _Work, part: tuple[int, int]) -> list[CohortOutcome]:
    """Outcomes of some patients, for each noise level and estimator."""
    numbers = np.arange(*part)
    background = work.background
    truth = measured(forward_of(background), work.observed, work.patients.samples[numbers])
    judge = None
    if work.errors:
        judge = SpanErrors(background, work.functionals, truth.coefficients, work.contrasts, work.weights)
    out = []
    for level in work.levels:
        data, sigmas = truth.noisy(work.patients, numbers, level)
        given = data if work.steps is None else data[:, work.steps]
        for name, prepared in work.prepared.items():
            started = time.perf_counter()
            estimate = prepared.estimate(given, noise_scale=sigmas)
            seconds = time.perf_counter() - started
            true = Estimate(background, estimate.steps, truth.coefficients[:, estimate.steps])
            claims = {
                title: _claims(quantity, true, estimate, np.array(work.probabilities))
                for title, quantity in work.quantities.items()
            }
            guess = Estimate(
                background, estimate.steps,
                np.repeat(background.mean()[:, estimate.steps, None], len(numbers), axis=2),
            )  # fmt: skip
            found, guessed = (judge(estimate), judge(guess)) if judge else ({}, {})
            outcome = CohortOutcome(
                name, level, sigmas, claims, found, guessed, estimate.misfit, estimate.parameters, seconds
            )
            out.append(outcome)
    return out


def _claims(quantity: QuantityOfInterest, true: Estimate, estimate: Estimate, probabilities: Array) -> Claims:
    truth, centre = true.quantity(quantity), estimate.quantity(quantity)
    deviation = np.full(centre.shape, np.nan)
    quantiles = np.full((len(probabilities), *centre.shape), np.nan)
    uncertainty = estimate.uncertainty
    if uncertainty is not None:
        riesz = estimate.riesz if estimate.correction is not None else None
        weights = weights_of(quantity, estimate.background, len(estimate.steps), riesz)
        deviation = np.sqrt(uncertainty.variance(*weights))
        known = _Known(deviation**2) if type(uncertainty).quantile is Uncertainty.quantile else uncertainty
        for row, chance in zip(quantiles, probabilities, strict=True):
            row[...] = known.quantile(centre, float(chance), *weights)
    return Claims(truth, centre, deviation, probabilities, quantiles)


class _Known(Uncertainty):
    """A variance that was computed once, for all Gaussian quantiles."""

    def __init__(self, values: Array) -> None:
        self._values = values

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        return self._values


def _guess(background: Background, quantity: QuantityOfInterest) -> tuple[Array, Array]:
    """Mean and standard deviation (s,) of a quantity over the training set."""
    values = Estimate(background, np.arange(len(background.times)), background.coefficients).quantity(quantity)
    return values.mean(axis=1), values.std(axis=1, ddof=1 if values.shape[1] > 1 else 0)


def _chunk(background: Background, functionals: Functionals) -> int:
    each = 8 * _COPIES * len(background.times) * (background.dimension + functionals.count)
    return int(np.clip(_CHUNK_BYTES // each, 1, _MOST))


def _joined(rows: Sequence[CohortOutcome]) -> CohortOutcome:
    """Outcomes of all patients, of those of some."""
    first = rows[0]
    quantities = {name: _claims_of([row.quantities[name] for row in rows]) for name in first.quantities}
    errors, guesses = (
        {label: np.concatenate([getattr(row, what)[label] for row in rows]) for label in getattr(first, what)}
        for what in ("errors", "guess_errors")
    )
    misfit = None
    if any(row.misfit is not None for row in rows):
        none = [np.full(len(row.sigmas), np.nan) for row in rows]
        every = [row.misfit or Misfit(empty, empty) for row, empty in zip(rows, none, strict=True)]
        misfit = Misfit(*(np.concatenate([getattr(one, f.name) for one in every]) for f in fields(Misfit)))
    learned = [row.parameters for row in rows if row.parameters is not None]
    parameters = None
    if learned:
        parameters = ParameterEstimate(
            learned[0].names,
            np.concatenate([one.values for one in learned], axis=1),
            np.concatenate([one.covariance for one in learned], axis=0),
            learned[0].prior,
        )
    return CohortOutcome(
        first.estimator, first.noise, np.concatenate([row.sigmas for row in rows]), quantities, errors, guesses, misfit,
        parameters, sum(row.seconds for row in rows),
    )  # fmt: skip


def _claims_of(rows: Sequence[Claims]) -> Claims:
    truth, estimate, deviation, quantiles = (
        np.concatenate([getattr(row, what) for row in rows], axis=-1)
        for what in ("truth", "estimate", "deviation", "quantiles")
    )
    return Claims(truth, estimate, deviation, rows[0].probabilities, quantiles)
