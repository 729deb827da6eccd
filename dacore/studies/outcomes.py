"""What is found of estimators on unseen cases: errors, numbers of interest and claims, for each noise level.

Errors are relative norms for each field: at each step, and over the whole trajectory (ratio of
space–time norms, which does not explode where the field is tiny). Beside every estimator stands
the guess of the training mean. docs/method.md: Noise, Errors and numbers of interest.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Card, Displayed, Rows, count, listed, number, percent
from dacore.core.estimator import BackgroundSpace, Estimate, ParameterEstimate
from dacore.core.misfit import Misfit
from dacore.errors import ShapeError
from dacore.studies.errors import JOINT

PRIOR = "prior"


@dataclass(frozen=True, eq=False, repr=False)
class QuantityOutcome(Displayed):
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

    def _card(self) -> Card:
        numbers, cases = self.truth.shape
        facts = ("numbers", count(numbers)), ("cases", count(cases)), ("rms error", number(float(f"{self.rms:.3g}")))
        return Card("QuantityOutcome", facts)

    @property
    def rms(self) -> float:
        """Root mean square error over all numbers and cases."""
        return float(np.sqrt(np.mean((self.estimate - self.truth) ** 2)))

    @property
    def worst(self) -> float:
        """Largest absolute error."""
        return float(np.abs(self.estimate - self.truth).max())


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Displayed):
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
    seconds : float
        Wall time of estimating all cases (without errors).
    source : callable, optional
        Makes the estimate of all cases when a state of it is asked for.
    misfit : Misfit, optional
        Whether the data of each case contradict the estimator.
    parameters : ParameterEstimate, optional
    """

    estimator: str
    noise: float
    per_step: Mapping[str, Array]
    space_time: Mapping[str, Array]
    quantities: Mapping[str, QuantityOutcome]
    seconds: float
    source: Callable[[], Estimate] | None = None
    misfit: Misfit | None = None
    parameters: ParameterEstimate | None = None

    def _card(self) -> Card:
        mean = {label: percent(_mean(values)) for label, values in self.space_time.items()}
        cases = [each.truth.shape[1] for each in self.quantities.values()] + [len(e) for e in self.space_time.values()]
        return Card(
            "Outcome",
            (
                ("estimator", self.estimator),
                ("noise", percent(self.noise)),
                ("cases", count(cases[0]) if cases else ""),
                ("mean errors", ", ".join(f"{label} {value}" for label, value in mean.items())),
                ("rms errors", ", ".join(f"{name} {each.rms:.3g}" for name, each in self.quantities.items())),
                ("misfit", "" if self.misfit is None else self.misfit.verdict),
                ("parameters", "" if self.parameters is None else listed(self.parameters.names)),
                ("seconds", f"{self.seconds:.3g}"),
            ),
        )

    @cached_property
    def estimate(self) -> Estimate | None:
        """The estimate of all cases; made again where the outcome was kept, None for the training mean."""
        return self.source() if self.source is not None else None

    def worst_case(self, error: str) -> int:
        """Number of the case whose space–time error is largest.

        Parameters
        ----------
        error : str
            Label of an error of a field or contrast.

        Returns
        -------
        int
        """
        return int(np.argmax(np.nan_to_num(self.space_time[error], nan=-1.0)))


@dataclass(frozen=True, eq=False, repr=False)
class Judged(Displayed):
    """What was found of one estimator.

    Parameters
    ----------
    outcomes : tuple of Outcome
        One for each noise level.
    inf_sup : (t,) array
        Stability constants of each step.
    spaces : tuple of BackgroundSpace
    """

    outcomes: tuple[Outcome, ...]
    inf_sup: Array
    spaces: tuple[BackgroundSpace, ...]

    def _card(self) -> Card:
        beta = self.inf_sup[np.isfinite(self.inf_sup)]
        facts = (
            ("stability", f"{beta.min():.2e} to {beta.max():.2e}" if beta.size else "none"),
            ("dimensions", listed([str(space.n) for space in self.spaces])),
        )
        return Card("Judged", facts, (errors_table(self.outcomes),))


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Displayed):
    """All outcomes and the data they come from.

    Parameters
    ----------
    outcomes : tuple of Outcome
        The training mean first, then estimator by estimator for each noise level.
    errors : tuple of str
        Labels of the errors; none where only numbers of interest are asked for.
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

    def _card(self) -> Card:
        facts = ("cases", count(self.clean.shape[2])), ("noise", ", ".join(percent(level) for level in self.data))
        return Card("Validation", facts, (errors_table(self.outcomes),))

    @property
    def headline(self) -> str:
        """The error that says most: that of the last contrast, or of the last field; "" without errors of fields."""
        return next((label for label in reversed(self.errors) if label != JOINT), "")

    def best(self, estimators: Sequence[str], noise: float) -> Outcome:
        """Return the outcome of the least mean headline error, or of the nearest quantities, at one noise level.

        Parameters
        ----------
        estimators : sequence of str
        noise : float
            Level Ξ.

        Returns
        -------
        Outcome
        """
        return min((self.outcome(name, noise) for name in estimators), key=self._badness)

    def _badness(self, outcome: Outcome) -> float:
        if self.headline:
            return float(np.nan_to_num(outcome.space_time[self.headline], nan=np.inf).mean())
        guess = self.outcome(PRIOR, 0.0).quantities
        return sum(each.rms / (guess[name].rms or 1.0) for name, each in outcome.quantities.items())

    def outcome(self, estimator: str, noise: float) -> Outcome:
        """Return one outcome; the training mean is the same at every noise level.

        Parameters
        ----------
        estimator : str
            Name in the scene, or "prior".
        noise : float
            Level Ξ.

        Returns
        -------
        Outcome

        Raises
        ------
        ShapeError
            If there is no such outcome.
        """
        for each in self.outcomes:
            if each.estimator == estimator and (estimator == PRIOR or each.noise == noise):
                return each
        raise ShapeError(f"outcome: none of {estimator!r} at noise {noise}")


def errors_table(outcomes: Sequence[Outcome]) -> Rows:
    """Mean errors of fields and rms errors of quantities, a row an estimator and noise level.

    Parameters
    ----------
    outcomes : sequence of Outcome

    Returns
    -------
    Rows
    """
    if not outcomes:
        return Rows((), ())
    labels, names = list(outcomes[0].space_time), list(outcomes[0].quantities)
    rows = tuple(
        (
            "training mean" if each.estimator == PRIOR else each.estimator,
            "" if each.estimator == PRIOR else percent(each.noise),
            *(percent(_mean(each.space_time[label])) for label in labels),
            *(f"{each.quantities[name].rms:.3g}" for name in names),
        )
        for each in outcomes
    )
    headers = ("estimator", "noise", *(f"error of {label}" for label in labels), *(f"rms of {name}" for name in names))
    return Rows(headers, rows)


def _mean(values: Array) -> float:
    """Mean of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan
