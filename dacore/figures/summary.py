"""Errors of every estimator at every noise level beside what guessing gives."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import INK, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled, title_text


@styled
def summary(
    estimators: Sequence[str],
    noise_levels: Sequence[str],
    errors: Mapping[str, Array],
    prior: Mapping[str, float],
    caption: str = "",
    units: Mapping[str, str] | None = None,
) -> Figure:
    """Draw one column a measure: a line an estimator, a marker a noise level, on logarithmic axes.

    The dashed line is the error of guessing the training mean; to its right an estimate is worse than none.

    Parameters
    ----------
    estimators : sequence of str
    noise_levels : sequence of str
    errors : mapping of str to (estimators, noise levels) array
        For each measure, relative errors as fractions, or values in the unit that `units` gives; NaN where not run.
    prior : mapping of str to float
        Error of the training mean, in the same unit, by measure.
    caption : str
    units : mapping of str to str, optional
        Unit of the measures that are not relative ("p_v": "dyn/cm²").
    """
    wanted = (len(estimators), len(noise_levels))
    for name, values in errors.items():
        if np.shape(values) != wanted:
            raise ShapeError(f"errors {name!r}: got shape {np.shape(values)}, expected {wanted}")
    figure, (panels,) = sheet(1, len(errors), 0.42 * len(estimators) + 1.5, caption, width=WIDTH, sharey=True)
    for axes, (name, values) in zip(panels, errors.items()):
        draw_errors(axes, name, noise_levels, np.asarray(values), prior.get(name), (units or {}).get(name, "%"))
    panels[0].set_yticks(np.arange(len(estimators))[::-1], [pretty(label) for label in estimators])
    legend_below(figure, list(panels))
    return figure


def draw_errors(
    axes: Axes, name: str, noise_levels: Sequence[str], values: Array, guess: float | None = None, unit: str = "%"
) -> None:
    """Draw one measure in axes: a line an estimator, from the top, and a marker a noise level.

    Parameters
    ----------
    axes : Axes
    name : str
    noise_levels : sequence of str
    values : (estimators, noise levels) array
        Fractions for the unit "%", values in the unit otherwise; NaN where not run.
    guess : float, optional
        Error of the training mean.
    unit : str
    """
    factor, count = (100.0 if unit == "%" else 1.0), len(values)
    places = np.arange(count)[::-1]
    shown = factor * np.asarray(values, dtype=np.float64)
    shown = np.where(shown > 0, shown, np.nan)
    log_axis(axes, "x", plain=True, ticks=4)
    for place in places[:-1]:
        axes.axhline(place - 0.5, color="#ECECEC", linewidth=0.8, zorder=0)
    for column, level in enumerate(noise_levels):
        # Noise levels stand a little apart, or equal errors would hide each other.
        shift = 0.5 * (0.5 - (column + 0.5) / len(noise_levels))
        axes.plot(
            shown[:, column], places + shift, linestyle="none", marker=marker(column), color=colour(column),
            markersize=7, markeredgecolor="white", markeredgewidth=0.6, label=pretty(level), zorder=3,
        )  # fmt: skip
    if guess is not None:
        axes.axvline(
            factor * guess, color=INK, linewidth=1.1, linestyle=(0, (5, 3)), label="guessing the training mean",
            zorder=2,
        )  # fmt: skip
        low, high = _limits(shown, factor * guess)
        axes.axvspan(factor * guess, high, color="#F3ECEC", linewidth=0, zorder=0)
        axes.set_xlim(low, high)
    axes.set_title(title_text(name))
    axes.set_xlabel(f"error  [{unit}]")
    axes.set_ylim(-0.6, count - 0.4)
    axes.tick_params(axis="y", length=0)


def _limits(values: Array, guess: float) -> tuple[float, float]:
    known = np.append(values[np.isfinite(values)], guess)
    return float(known.min() / 1.8), float(known.max() * 1.8)
