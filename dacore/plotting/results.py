"""What came out: errors on unseen cases, a number of interest over time, parameters before and after the data."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.core.display import number, percent, unit_text
from dacore.core.estimator import Estimate
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, Parameters, ParameterSpace
from dacore.core.quantity import QuantityOfInterest
from dacore.core.space import StateSpace
from dacore.core.timegrid import time_unit
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, colour, look, marker, pretty, share_text
from dacore.figures.summary import draw_errors
from dacore.plotting.axes import axes_for
from dacore.studies.outcomes import PRIOR, Validation
from dacore.workflow.session import Session
from dacore.workflow.tables import value_text

Estimates: TypeAlias = Estimate | Mapping[str, Estimate]


def plot_errors(
    subject: Session | Validation, error: str | None = None, ax: Axes | None = None, *,
    names: Mapping[str, str] | None = None,
) -> Axes:  # fmt: skip
    """Draw the mean error of every estimator at every noise level, beside that of guessing the training mean.

    Parameters
    ----------
    subject : Session or Validation
        A session is validated if it was not yet.
    error : str, optional
        Label of an error of a field or contrast, or the name of a quantity, whose rms error is drawn; the error that
        says most by default.
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    names : mapping of str to str, optional
        What to call the estimators; the titles of the scene by default.

    Returns
    -------
    Axes

    Raises
    ------
    ShapeError
        If there is no such error.
    """
    validation = subject.validation if isinstance(subject, Session) else subject
    first = validation.outcomes[0]
    wanted = error if error is not None else (validation.headline or next(iter(first.quantities)))
    relative = wanted in first.space_time
    if not relative and wanted not in first.quantities:
        known = ", ".join([*first.space_time, *first.quantities])
        raise ShapeError(f"error: got {wanted!r}, expected one of {known}")
    titles = dict(names or {})
    if isinstance(subject, Session):
        titles = {name: table.title or name for name, table in subject.scene.estimator.items()} | titles
    estimators = list(dict.fromkeys(each.estimator for each in validation.outcomes if each.estimator != PRIOR))
    levels = list(validation.data)

    def size(name: str, level: float) -> float:
        outcome = validation.outcome(name, level)
        if not relative:
            return outcome.quantities[wanted].rms
        values = outcome.space_time[wanted]
        return float(values[np.isfinite(values)].mean()) if np.isfinite(values).any() else np.nan

    found = np.array([[size(name, level) for level in levels] for name in estimators])
    unit = "%"
    if not relative:
        unit = "unit of the quantity"
        if isinstance(subject, Session):
            unit = unit_text(subject.quantities[wanted].functionals(subject.model.space).unit)
    with look():
        drawn = axes_for(ax, 6.4, 0.45 * len(estimators) + 1.7)
        labels = [f"{percent(level)} noise" if level else "no noise" for level in levels]
        draw_errors(drawn, wanted, labels, found, size(PRIOR, levels[0]), unit)
        drawn.set_yticks(np.arange(len(estimators))[::-1], [pretty(titles.get(name, name)) for name in estimators])
        drawn.legend(
            loc="upper center",
            bbox_to_anchor=(0.4, -0.6 / (0.45 * len(estimators) + 0.7)),
            ncols=min(len(levels) + 1, 3),
        )
    return drawn


class _EachStep(QuantityOfInterest):
    """Another quantity, one number a step."""

    def __init__(self, quantity: QuantityOfInterest) -> None:
        self.quantity, self.over_time = quantity, "each"

    def functionals(self, space: StateSpace) -> Functionals:
        """Those of the other."""
        return self.quantity.functionals(space)


def plot_quantity(
    estimate: Estimates,
    quantity: QuantityOfInterest,
    truth: Trajectory | None = None,
    ax: Axes | None = None,
    *,
    series: int = 0,
    level: float = 0.9,
    name: str = "",
) -> Axes:
    """Draw a number of interest over time, with its interval where the estimate has one, and the truth.

    Parameters
    ----------
    estimate : Estimate or mapping of str to Estimate
        Several are told apart by their names.
    quantity : QuantityOfInterest
        At each step, also where it is a mean over time.
    truth : Trajectory, optional
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    series : int
        Which series of the estimates.
    level : float
        Of the interval, between 0 and 1.
    name : str
        What to call it.

    Returns
    -------
    Axes

    Raises
    ------
    ShapeError
        If the quantity has several numbers a step, or there is no such series.
    """
    given = estimate if isinstance(estimate, Mapping) else {"estimate": estimate}
    each = _EachStep(quantity)
    with look():
        drawn = axes_for(ax, 5.4, 3.4)
        last, unit = 0.0, ""
        for index, (label, one) in enumerate(given.items()):
            seen = quantity.functionals(one.background.space)
            if seen.count != 1 or not 0 <= series < one.n_series:
                raise ShapeError(
                    f"quantity: has {seen.count} numbers a step and series {series} of {one.n_series} is asked for; "
                    "expected one number and a series there is"
                )
            factor, _ = time_unit(float(one.times[-1]))
            times, unit, last = factor * one.times, unit_text(seen.unit), float(one.times[-1])
            order = np.argsort(times)
            if one.uncertainty is not None:
                low, high = (end[:, series][order] for end in one.interval(each, level))
                drawn.fill_between(
                    times[order], low, high, color=colour(index), alpha=0.2, linewidth=0,
                    label=f"{100 * level:.0f}% interval" if len(given) == 1 else None,
                )  # fmt: skip
            drawn.plot(
                times[order], one.quantity(each)[:, series][order], color=colour(index), marker=marker(index),
                markersize=3.5, label=pretty(label),
            )  # fmt: skip
            if truth is not None and index == 0:
                values = seen(truth.states)[0]
                drawn.plot(factor * truth.times, values, color=INK, linewidth=1.1, linestyle=(0, (5, 3)), label="truth")
        drawn.set_xlabel(f"time [{time_unit(last)[1]}]")
        drawn.set_ylabel(f"{pretty(name) or 'quantity'}  [{unit}]")
        drawn.ticklabel_format(axis="y", useOffset=False)
        drawn.legend()
    return drawn


def plot_parameters(
    estimate: Estimate,
    truth: Parameters | None = None,
    ax: Axes | None = None,
    *,
    series: int = 0,
    level: float = 0.9,
    space: ParameterSpace | None = None,
) -> Axes:
    """Draw what is known of each parameter before and after the data, each on its own range.

    The grey bar is the interval before, the coloured one that after the data, both Gaussian.

    Parameters
    ----------
    estimate : Estimate
        Of an estimator that finds parameters.
    truth : mapping of str to float, optional
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    series : int
        Which series of the estimate.
    level : float
        Of the intervals, between 0 and 1.
    space : ParameterSpace, optional
        Their ranges; those of the training set by default.

    Returns
    -------
    Axes

    Raises
    ------
    ShapeError
        If the estimate has no parameters, or no such series.
    """
    found = estimate.parameters
    if found is None:
        raise ShapeError("this estimate has no parameters; use an estimator that finds them, 'posterior' for instance")
    if not 0 <= series < estimate.n_series:
        raise ShapeError(f"series: got {series}, expected 0 to {estimate.n_series - 1}")
    ranges = space or estimate.background.parameters
    half = float(norm.ppf(0.5 + level / 2))
    places = np.arange(len(found.names))[::-1]
    with look():
        drawn = axes_for(ax, 6.4, 0.5 * len(found.names) + 1.3)
        for row, (place, name) in enumerate(zip(places, found.names, strict=True)):
            each = ranges[name]
            value, deviation = float(found.values[row, series]), float(found.deviation[row, series])
            centre = float(each.quantile(np.array(0.5)))
            for middle, spread, shade, thick, label in (
                (centre, float(found.prior[row]), "#DADADA", 9.0, "before the data"),
                (value, deviation, colour(0), 4.0, f"after, {100 * level:.0f}% interval"),
            ):
                ends = np.clip(_along(each, np.array([middle - half * spread, middle + half * spread])), 0.0, 1.0)
                drawn.plot(
                    ends, [place, place], color=shade, linewidth=thick, solid_capstyle="butt",
                    label=label if row == 0 else None,
                )  # fmt: skip
            at = float(np.clip(_along(each, np.array([value]))[0], 0.0, 1.0))
            drawn.plot(at, place, "o", color=colour(0), markersize=7, markeredgecolor="white")
            if truth is not None and name in truth:
                there = float(_along(each, np.array([truth[name]]))[0])
                drawn.plot(there, place, "D", color=colour(1), markersize=6, markeredgecolor="white", zorder=4,
                           label="truth" if row == 0 else None)  # fmt: skip
            share = share_text(float(np.clip(found.learned[row, series], 0.0, 1.0)))
            drawn.text(
                1.03, place, f"{_with_deviation(value, deviation)}, {share} learned", va="center", fontsize=8, color=INK
            )
            for end, text, side in ((0.0, number(each.low), "left"), (1.0, number(each.high), "right")):
                drawn.text(end, place - 0.36, text, ha=side, va="center", fontsize=7, color=FAINT)
        drawn.set_yticks(
            places, [f"{pretty(name)}  [{unit_text(ranges[name].unit)}]" for name in found.names]
        )  # fmt: skip
        drawn.set(xlim=(-0.01, 1.01), ylim=(-0.7, len(places) - 0.5), xticks=[0.0, 0.5, 1.0])
        drawn.set_xlabel("place in the range of each parameter  [–]")
        drawn.tick_params(axis="y", length=0)
        drawn.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16 * 6.0 / (2.0 + len(places))), ncols=3)
    return drawn


def _along(parameter: Parameter, values: Array) -> Array:
    """Where values lie in the range of a parameter, 0 to 1, on its own scale."""
    low, high = parameter.low, parameter.high
    if parameter.distribution == "log_uniform":
        return np.asarray(np.log(np.maximum(values, 1e-300) / low) / np.log(high / low))
    return np.asarray((values - low) / (high - low))


def _with_deviation(value: float, deviation: float) -> str:
    """A value with the digits that its deviation leaves, small ones with an exponent."""
    return value_text(value, deviation) if abs(value) >= 1e-2 else f"{value:.3g} ± {deviation:.2g}"
