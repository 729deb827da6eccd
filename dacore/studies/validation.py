"""Validation on unseen cases: the same data to every estimator, the same errors of each.

docs/method.md: Noise, Errors and numbers of interest.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.background import Background
from dacore.core.estimator import Estimate, PreparedEstimator, weights_of
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.core.space import Product
from dacore.errors import ShapeError
from dacore.estimators.frames import balanced_weights
from dacore.studies.errors import JOINT, Contrast, ErrorMeter, ProjectedErrors
from dacore.studies.noisy import NoisyData
from dacore.studies.outcomes import PRIOR, Judged, Outcome, QuantityOutcome, Validation
from dacore.studies.reference import Measured, measure, project

# Errors are measured in this inner product.
PRODUCT: Product = "l2"


class Judge:
    """What every estimator is judged by: the same cases, the same errors.

    Parameters
    ----------
    measured : Measured
    quantities : mapping of str to QuantityOfInterest
    meter : ErrorMeter, optional
        Of the errors of fields; None: only numbers of interest are asked for.
    projected : ProjectedErrors, optional
        Errors without lifting a state, where the product of `meter` is that of the background.
    truths : callable, optional
        () -> the true trajectories; asked for only where an estimate must be lifted to be judged.
    """

    def __init__(
        self,
        measured: Measured,
        quantities: Mapping[str, QuantityOfInterest],
        meter: ErrorMeter | None = None,
        projected: ProjectedErrors | None = None,
        truths: Callable[[], Iterable[Trajectory]] | None = None,
    ) -> None:
        self.measured, self.quantities = measured, quantities
        self.meter, self.projected, self.truths = meter, projected, truths

    def judge(
        self, name: str, prepared: PreparedEstimator, noisy_data: NoisyData, mask: BoolArray | None = None
    ) -> Judged:
        """Estimate every case at every noise level, and measure the errors.

        Parameters
        ----------
        name : str
        prepared : PreparedEstimator
            Prepared with noise of unit standard deviation.
        noisy_data : NoisyData
        mask : (m,) bool array, optional
            Which functionals were measured.
        """
        jobs = []
        for level in noisy_data.data:
            started = time.perf_counter()
            estimate = prepared.estimate(noisy_data.given(level), noisy_data.sigmas[level], mask)
            if not isinstance(estimate, Estimate):
                raise ShapeError(f"estimator {name}: estimate gave a {type(estimate).__name__}, expected an Estimate")
            jobs.append((level, estimate, time.perf_counter() - started))
        tables = self._errors([estimate for _, estimate, _ in jobs])
        outcomes = [
            self._outcome(name, level, estimate, seconds, table)
            for (level, estimate, seconds), table in zip(jobs, tables, strict=True)
        ]
        return Judged(tuple(outcomes), prepared.inf_sup, prepared.spaces())

    def errors(self, estimate: Estimate) -> tuple[dict[str, Array], dict[str, Array]]:
        """Space–time errors (k,) of one estimate, and errors (s, k) of its quantities, without claims about either."""
        found = _space_time(self._errors([estimate])[0])
        values = {
            name: estimate.quantity(quantity) - self._truth(name, quantity, estimate)
            for name, quantity in self.quantities.items()
        }
        return found, values

    def prior(self, background: Background) -> Outcome:
        """Judge the guess of the training mean, which is the same at every noise level."""
        count = self.measured.data.shape[2]
        mean = np.repeat(background.mean()[:, :, None], count, axis=2)
        guess = Estimate(background, np.arange(len(background.times)), mean)
        found = self._outcome(PRIOR, 0.0, guess, 0.0, self._errors([guess])[0])
        quantities = {
            name: replace(found.quantities[name], deviation=_spread(background, each, count))
            for name, each in self.quantities.items()
        }
        return Outcome(PRIOR, 0.0, found.per_step, found.space_time, quantities, 0.0)

    def _errors(self, estimates: Sequence[Estimate]) -> list[dict[str, tuple[Array, Array]]]:
        """For each estimate and label, the norm of the error and what it is relative to, both (t, k)."""
        meter, projected = self.meter, self.projected
        if meter is None:
            return [{} for _ in estimates]
        tables: list[dict[str, tuple[Array, Array]]] = [{} for _ in estimates]
        lifted = []
        for index, estimate in enumerate(estimates):
            if projected is None or not projected.covers(estimate):
                lifted.append(index)
                continue
            below = {label: values[estimate.steps] for label, values in projected.reference.norms.items()}
            below[JOINT] = meter.joint(below)
            above = meter.complete(projected.norms(estimate))
            tables[index] = {label: (above[label], below[label]) for label in meter.labels}
        if lifted and self.truths is not None:
            rows: list[list[dict[str, tuple[Array, Array]]]] = [[] for _ in lifted]
            for case, truth in enumerate(self.truths()):
                reference = meter.reference(truth.states)
                for row, index in zip(rows, lifted, strict=True):
                    steps = estimates[index].steps
                    below = {label: values[steps] for label, values in reference.items()}
                    row.append(meter.errors(truth.states[:, steps] - estimates[index].state(series=case), below))
            for row, index in zip(rows, lifted, strict=True):
                tables[index] = {
                    label: (
                        np.stack([each[label][0] for each in row], axis=1),
                        np.stack([each[label][1] for each in row], axis=1),
                    )
                    for label in meter.labels
                }
        return tables

    def _outcome(
        self, name: str, level: float, estimate: Estimate, seconds: float, table: Mapping[str, tuple[Array, Array]]
    ) -> Outcome:
        per_step = {label: self._at_steps(estimate, _ratio(above, below)) for label, (above, below) in table.items()}
        space_time = _space_time(table)
        values = {}
        for title, quantity in self.quantities.items():
            found = estimate.quantity(quantity)
            deviation = np.full(found.shape, np.nan)
            if estimate.uncertainty is not None:
                deviation = estimate.standard_deviation(quantity)
            values[title] = QuantityOutcome(self._truth(title, quantity, estimate), found, deviation)
        return Outcome(
            name, level, per_step, space_time, values, seconds, lambda: estimate, estimate.misfit, estimate.parameters
        )

    @staticmethod
    def _at_steps(estimate: Estimate, values: Array) -> Array:
        """Values (t, k) at all recorded steps of values at those of an estimate; NaN elsewhere."""
        out = np.full((len(estimate.background.times), values.shape[1]), np.nan)
        out[estimate.steps] = values
        return out

    def _truth(self, title: str, quantity: QuantityOfInterest, estimate: Estimate) -> Array:
        """True values (s, k) of a quantity: those of the estimate's steps, where there is one for each step."""
        truth, count = self.measured.quantities[title], len(estimate.background.times)
        if quantity.over_time == "mean" or len(estimate.steps) == count:
            return truth
        return truth.reshape(-1, count, truth.shape[1])[:, estimate.steps].reshape(-1, truth.shape[1])


def _spread(background: Background, quantity: QuantityOfInterest, count: int) -> Array:
    """Standard deviation (s, count) of a quantity over the training set: what is known before anything is measured."""
    on_modes, _ = weights_of(quantity, background, len(background.times))
    values = np.einsum("str,rtk->sk", on_modes, background.coefficients, optimize=True)
    return np.repeat(values.std(axis=1, ddof=1)[:, None], count, axis=1)


def joint_weights(background: Background) -> dict[str, float]:
    """Weights of the fields in the joint norm of errors: each field's variation counts alike."""
    return balanced_weights(background, background.coefficients - background.mean()[:, :, None])


def gather(
    prior: Outcome, judged: Mapping[str, Judged], data: NoisyData, errors: Sequence[str], weights: Mapping[str, float]
) -> Validation:
    """Put what was found of each estimator together, noise level by noise level.

    Parameters
    ----------
    prior : Outcome
    judged : mapping of str to Judged
    data : NoisyData
    errors : sequence of str
        Labels of the errors of fields.
    weights : mapping of str to float
    """
    found = {(name, each.noise): each for name, one in judged.items() for each in one.outcomes}
    outcomes = [prior, *(found[name, level] for level in data.data for name in judged)]
    return Validation(tuple(outcomes), tuple(errors), data.clean, data.data, data.sigmas, weights)


def validate(
    background: Background,
    functionals: Functionals,
    prepared: Mapping[str, PreparedEstimator],
    truths: Sequence[Trajectory],
    quantities: Mapping[str, QuantityOfInterest],
    contrasts: Sequence[Contrast],
    levels: Sequence[float],
    seed: int,
) -> Validation:
    """Estimate every case with every estimator at every noise level, with nothing kept from before.

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
    """
    measured = measure(background.space, functionals, truths, quantities)
    data = NoisyData.drawn(measured.data, levels, seed)
    return validate_measured(background, functionals, prepared, truths, measured, data, quantities, contrasts)


def validate_measured(
    background: Background,
    functionals: Functionals,
    prepared: Mapping[str, PreparedEstimator],
    truths: Sequence[Trajectory],
    measured: Measured,
    data: NoisyData,
    quantities: Mapping[str, QuantityOfInterest],
    contrasts: Sequence[Contrast],
    mask: BoolArray | None = None,
) -> Validation:
    """As `validate`, of data that were measured already, of the truths themselves or of what they stand for.

    Parameters
    ----------
    background, functionals, prepared, truths, quantities, contrasts
        As for `validate`.
    measured : Measured
    data : NoisyData
        Of what was measured.
    mask : (m,) bool array, optional
        Which functionals were measured.
    """
    weights = joint_weights(background)
    meter = ErrorMeter(background.space, PRODUCT, contrasts, weights)
    projected = None
    if background.kind == PRODUCT:
        reference = project(background, functionals, truths, contrasts)
        projected = ProjectedErrors(background, functionals, reference)
    judge = Judge(measured, quantities, meter, projected, lambda: truths)
    judged = {name: judge.judge(name, each, data, mask) for name, each in prepared.items()}
    return gather(judge.prior(background), judged, data, meter.labels, weights)


def _ratio(above: Array, below: Array) -> Array:
    """Relative error, NaN where there is nothing to be relative to."""
    return np.asarray(np.divide(above, below, out=np.full_like(above, np.nan), where=below > 0))


def _space_time(table: Mapping[str, tuple[Array, Array]]) -> dict[str, Array]:
    """Ratio (k,) of space–time norms for each label."""
    return {
        label: _ratio(np.sqrt((above**2).sum(axis=0)), np.sqrt((below**2).sum(axis=0)))
        for label, (above, below) in table.items()
    }
