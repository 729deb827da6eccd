"""What was reconstructed from data: the estimate, what it was made from, and how well it fits."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.core.data import Data, ImageData
from dacore.core.display import Card, Displayed, Rows, unit_text
from dacore.core.estimator import Estimate
from dacore.workflow.reconstruct.read import Source
from dacore.workflow.reconstruct.steps import Used
from dacore.workflow.reconstruct.target import Target
from dacore.workflow.session import Session
from dacore.workflow.tables import value_text

LEVEL = 0.9
# Less than this part of the residual that was expected says that the noise is overstated.
_FAR_LESS = 0.3
# Below this probability, or above this ratio, nobody should read that the data agree, though it is no alarm: with few
# training samples chance leaves much.
_UNLIKELY, _MUCH = 0.01, 1.5


@dataclass(frozen=True, eq=False)
class Number:
    """One number of interest at one time.

    Parameters
    ----------
    quantity, label, unit : str
    time : float or None [s]
        None for a mean over the steps of the estimate.
    value : float
    deviation, low, high : float
        Standard deviation and central 90% interval; NaN where the estimator gives none.
    training : float
        What guessing the training mean gives.
    """

    quantity: str
    label: str
    unit: str
    time: float | None
    value: float
    deviation: float
    low: float
    high: float
    training: float


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(Displayed):
    """A state and numbers from measured data.

    Parameters
    ----------
    session : Session
        Of the scene.
    estimator : str
        Name of the scene's estimator.
    estimate : Estimate
        Of one series.
    target : Target
        What the scene measures.
    used : Used
        The data that were taken.
    sigma : (m,) array
        Standard deviation of the noise that was supposed.
    data : sequence of Data
        As they were read.
    sources : sequence of Source
        Files, with hashes.
    warnings : tuple of str
        What is doubtful, a line each.
    notes : tuple of str
        What was supposed, a line each.
    seconds : float
    """

    session: Session
    estimator: str
    estimate: Estimate
    target: Target
    used: Used
    sigma: Array
    data: Sequence[Data]
    sources: Sequence[Source]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def times(self) -> Array:
        """Times (t,) of the estimate [s]."""
        return np.asarray(self.target.times[self.estimate.steps])

    @property
    def images(self) -> list[ImageData]:
        """Those of the data that are images."""
        return [each for each in self.data if isinstance(each, ImageData)]

    @cached_property
    def states(self) -> Array:
        """States (n_dofs, t) of the estimate."""
        return self.estimate.state(series=0)

    @cached_property
    def fit(self) -> Array:
        """What the estimate says of every functional at the steps that were used, (m, t)."""
        every = self.estimate.functional(self.target.functionals)[:, :, 0]
        place = {int(step): k for k, step in enumerate(self.estimate.steps)}
        return np.asarray(every[:, [place[int(step)] for step in self.used.steps]])

    @cached_property
    def residual(self) -> Array:
        """Data less fit (m, t); NaN where nothing was used."""
        return np.asarray(self.used.values - self.fit)

    @property
    def ratio(self) -> float:
        """Root mean square of the residual over that of the noise that was supposed; NaN for exact data."""
        sigma = np.broadcast_to(self.sigma[:, None], self.used.values.shape)[self.used.mask]
        left = self.residual[self.used.mask]
        return float(np.sqrt(np.mean((left / sigma) ** 2))) if (sigma > 0).all() else float("nan")

    @cached_property
    def numbers(self) -> list[Number]:
        """Quantities of the scene with their intervals, one for each output."""
        out = []
        for name, quantity in self.session.quantities.items():
            functionals = quantity.functionals(self.target_space)
            value = self.estimate.quantity(quantity)[:, 0]
            deviation = low = high = np.full(len(value), np.nan)
            if self.estimate.uncertainty is not None:
                deviation = self.estimate.standard_deviation(quantity)[:, 0]
                low, high = (each[:, 0] for each in self.estimate.interval(quantity, LEVEL))
            background = self.session.background
            mean = background.observe(functionals.matrix) @ background.mean()[:, self.estimate.steps]
            weights = quantity.time_weights(len(self.times))
            guess = np.einsum("ot,st->so", weights, mean).ravel()
            each = len(weights)
            for k in range(len(value)):
                row, output = divmod(k, each)
                time = float(self.times[output]) if quantity.over_time == "each" else None
                out.append(
                    Number(
                        name, functionals.labels[row], functionals.unit, time, float(value[k]), float(deviation[k]),
                        float(low[k]), float(high[k]), float(guess[k]),
                    )
                )  # fmt: skip
        return out

    @property
    def target_space(self) -> Any:
        """Space of the states."""
        return self.session.background.space

    @property
    def doubtful(self) -> bool:
        """Whether the data fit badly, without an alarm or with one; False where the estimator does not tell."""
        misfit = self.estimate.misfit
        return misfit is not None and bool(misfit.probability[0] < _UNLIKELY or misfit.ratio[0] > _MUCH)

    @property
    def verdict(self) -> str:
        """One sentence on whether the data contradict what the estimator supposes."""
        misfit = self.estimate.misfit
        if misfit is None or not np.isfinite(misfit.statistic).all():
            return "This estimator does not tell whether the data fit what was learned."
        ratio, probability = float(misfit.ratio[0]), float(misfit.probability[0])
        if bool(misfit.alarm[0]):
            chance = f"{probability:.1e}" if probability > 0 else "below 1e-300"
            return (
                f"The data contradict the model, the training set or the noise that was stated: what is left of them "
                f"is {ratio:.3g} times what was expected (probability {chance}). Do not trust the intervals."
            )
        if self.doubtful:
            return (
                f"The data fit worse than they should, though not so badly that chance is ruled out: what is left of "
                f"them is {ratio:.3g} times what was expected (probability {probability:.2g}). Signs and components "
                "that are wrong may look like this."
            )
        agree = (
            f"The data agree with the model, the training set and the noise that was stated: what is left of them is "
            f"{ratio:.3g} times what was expected (probability {probability:.2g})."
        )
        if ratio < _FAR_LESS and (self.sigma[self.used.mask] > 0).all():
            return (
                f"{agree} That is far less: there may be less noise than was stated, and more to learn from the data."
            )
        return agree

    def write(self, folder: str | Path) -> list[Path]:
        """Write numbers, fields, images and the report into a folder; it appears whole, or what was there stays.

        Parameters
        ----------
        folder : path
            An earlier reconstruction there is replaced; anything else is refused.

        Returns
        -------
        list of Path
            Files that a reader opens first.

        Raises
        ------
        StoreError
            If the folder holds something else, or cannot be written.
        """
        from dacore.workflow.reconstruct.output import publish

        where = self.session.builder.where
        return publish(self, Path(folder), f"Session.reconstruct of {where}")

    def _card(self) -> Card:
        used = self.used
        rows = tuple(
            (
                n.quantity if n.time is None else f"{n.quantity}, t = {n.time:g} s", value_text(n.value, n.deviation),
                _span(n), unit_text(n.unit),
            )
            for n in self.numbers
        )  # fmt: skip
        return Card(
            f"Reconstruction: {self.session.scene.title}",
            (
                ("data", ", ".join(each.name for each in self.data)),
                ("estimator", self.estimator),
                ("used", f"{int(used.mask.sum())} of {self.target.count} measurements at {len(used.steps)} steps"),
                ("fit", self.verdict),
                *(("beware", line) for line in self.warnings),
                *(("supposed", line) for line in self.notes),
            ),
            (Rows(("quantity", "estimate ± standard deviation", f"{100 * LEVEL:g}% interval", "unit"), rows),),
        )


def _span(number: Number) -> str:
    """An interval with the digits of its value."""
    if not np.isfinite(number.low):
        return "–"
    return " to ".join(value_text(each, number.deviation).partition(" ")[0] for each in (number.low, number.high))
