"""What several variants of one computation cost, and how far they agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import INK, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class Cost:
    """One cost of every variant.

    Parameters
    ----------
    name : str
    unit : str
    values : (v,) array
        NaN where not measured.
    """

    name: str
    unit: str
    values: Array


@styled
def costs(variants: Sequence[str], measured: Sequence[Cost], caption: str = "") -> Figure:
    """Draw a panel of bars for each cost, a bar a variant, each with its value.

    Parameters
    ----------
    variants : sequence of str, length v
    measured : sequence of Cost
    caption : str
    """
    for cost in measured:
        if np.shape(cost.values) != (len(variants),):
            raise ShapeError(f"cost {cost.name!r}: got shape {np.shape(cost.values)}, expected ({len(variants)},)")
    columns = min(3, len(measured))
    rows = -(-len(measured) // columns)
    height = rows * (0.27 * len(variants) + 0.75) + 0.2
    figure, grid = sheet(rows, columns, height, caption, width=WIDTH, sharey=True)
    places = np.arange(len(variants))[::-1]
    for axes, cost in zip(grid.ravel(), measured):
        shown = np.nan_to_num(cost.values)
        axes.barh(places, shown, height=0.66, color=[colour(k) for k in range(len(variants))])
        top = float(shown.max()) or 1.0
        for place, value in zip(places, cost.values):
            text = "–" if not np.isfinite(value) else f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
            axes.text(np.nan_to_num(value) + 0.02 * top, place, text, va="center", fontsize=8, color=INK)
        axes.set_xlim(0, 1.22 * top)
        axes.set_title(f"{pretty(cost.name)}  [{cost.unit}]")
        axes.tick_params(axis="y", length=0)
        axes.xaxis.set_major_locator(MaxNLocator(4))
    for axes in grid.ravel()[len(measured) :]:
        axes.set_visible(False)
    grid[0, 0].set_yticks(places, [pretty(label) for label in variants])
    return figure


@styled
def differences(
    variants: Sequence[str], items: Sequence[str], gaps: Array, reference: str, caption: str = ""
) -> Figure:
    """Draw the relative difference of every item from the reference on a logarithmic axis.

    Parameters
    ----------
    variants : sequence of str, length v
        Without the reference.
    items : sequence of str, length i
    gaps : (v, i) array
        NaN where not compared; exact agreement is drawn at a tenth of the double precision.
    reference : str
    caption : str
    """
    if np.shape(gaps) != (len(variants), len(items)):
        raise ShapeError(f"differences: got shape {np.shape(gaps)}, expected {(len(variants), len(items))}")
    least = float(np.finfo(np.float64).eps) / 10.0
    figure, ((axes,),) = sheet(1, 1, 0.2 * len(items) + 1.2, caption, width=WIDTH)
    log_axis(axes, "x", ticks=10)
    places = np.arange(len(items))[::-1]
    for k, label in enumerate(variants):
        values = np.where(np.isfinite(gaps[k]), np.maximum(gaps[k], least), np.nan)
        shift = 0.4 * (0.5 - (k + 0.5) / len(variants))
        axes.plot(
            values, places + shift, linestyle="none", marker=marker(k + 1), color=colour(k + 1), markersize=5.5,
            markeredgecolor="white", markeredgewidth=0.5, label=pretty(label),
        )  # fmt: skip
    axes.set_yticks(places, [pretty(item) for item in items])
    axes.set_ylim(-0.6, len(items) - 0.4)
    axes.set_xlim(least / 2, max(1e-9, 3.0 * float(np.nanmax(gaps, initial=0.0))))
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"max|a − b| / max|b|, b of {pretty(reference)}")
    axes.grid(visible=True, axis="both", which="major")
    legend_below(figure, [axes])
    return figure
