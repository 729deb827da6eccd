"""Whether claimed uncertainties are right: coverage against nominal level, and probability integral transforms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, marker, pretty, sheet, styled, title_text


@dataclass(frozen=True, eq=False)
class CalibrationCurve:
    """Claims of one estimator.

    Parameters
    ----------
    label : str
    levels, empirical : (L,) arrays
        Nominal levels of central intervals, and the share of truths inside.
    transform : (k,) array
        Probability integral transform of each patient.
    note : str
        Below the title of the histogram ("standardised errors 0.98").
    """

    label: str
    levels: Array
    empirical: Array
    transform: Array
    note: str = ""

    def __post_init__(self) -> None:
        if np.shape(self.levels) != np.shape(self.empirical) or np.ndim(self.levels) != 1:
            raise ShapeError(f"coverage of {self.label!r}: expected one empirical share for each level")
        if np.ndim(self.transform) != 1 or not np.size(self.transform):
            raise ShapeError(f"transform of {self.label!r}: expected one number for each patient")


@styled
def calibration(curves: Sequence[CalibrationCurve], confidence: float = 0.95, caption: str = "") -> Figure:
    """Draw empirical against nominal coverage, and a histogram of transforms for each estimator.

    The bands are where right claims lie with the given probability, of as many patients as there are (binomial).

    Parameters
    ----------
    curves : sequence of CalibrationCurve
    confidence : float
    caption : str
    """
    if not curves:
        raise ShapeError("calibration: got no curve, expected at least one")
    total = 1 + len(curves)
    columns = 2 if total == 4 else min(3, total)
    rows = -(-total // columns)
    figure, grid = sheet(rows, columns, 3.1 * rows + 0.4, caption, width=WIDTH if columns > 2 else 6.4)
    for axes in grid.flat[total:]:
        axes.set_visible(False)
    tail = 0.5 - confidence / 2
    axes = grid.flat[0]
    count = min(len(curve.transform) for curve in curves)
    fine = np.linspace(0.0, 1.0, 201)
    axes.fill_between(
        100 * fine, 100 * binom.ppf(tail, count, fine) / count, 100 * binom.ppf(1 - tail, count, fine) / count,
        color="#E6E6E6", linewidth=0, zorder=0, label=f"{100 * confidence:.0f} % of right claims",
    )  # fmt: skip
    axes.plot([0, 100], [0, 100], color=INK, linewidth=0.9, zorder=1)
    for index, curve in enumerate(curves):
        axes.plot(
            100 * np.asarray(curve.levels), 100 * np.asarray(curve.empirical), color=colour(index),
            marker=marker(index), markersize=5, markeredgecolor="white", markeredgewidth=0.5, linewidth=1.3,
            label=pretty(curve.label), clip_on=False, zorder=3,
        )  # fmt: skip
    lowest = min(float(np.min(curve.levels)) for curve in curves)
    seen = min(float(np.min(curve.empirical)) for curve in curves)
    start = 100 * max(0.0, min(lowest, seen) - 0.1)
    axes.set(xlim=(100 * max(0.0, lowest - 0.05), 100), ylim=(start, 100))
    axes.set_title("coverage", pad=16)
    axes.set_xlabel("nominal level of the interval  [%]")
    axes.set_ylabel("truths inside  [%]")
    bins = int(np.clip(count // 12, 5, 20))
    for index, (axes, curve) in enumerate(zip(grid.flat[1:], curves)):
        k = len(curve.transform)
        low, high = (binom.ppf(each, k, 1.0 / bins) * bins / k for each in (tail, 1 - tail))
        axes.axhspan(low, high, color="#E6E6E6", linewidth=0, zorder=0)
        axes.axhline(1.0, color=INK, linewidth=0.9, zorder=1)
        heights, edges = np.histogram(curve.transform, bins=bins, range=(0.0, 1.0))
        axes.bar(
            edges[:-1], heights * bins / k, width=np.diff(edges), align="edge", color=colour(index), alpha=0.75,
            edgecolor="white", linewidth=0.6, zorder=2,
        )  # fmt: skip
        axes.set(xlim=(0, 1))
        axes.set_ylim(top=max(2.0, 1.08 * float(heights.max()) * bins / k))
        axes.set_title(title_text(curve.label), pad=16)
        axes.text(0.5, 1.015, pretty(curve.note), transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
        axes.set_xlabel("claimed probability below the truth  [–]")
        axes.set_ylabel("patients / expected  [–]")
        axes.annotate(f"{k} patients", (0.985, 0.97), xycoords="axes fraction", ha="right", va="top", fontsize=7.5,
                      color=FAINT)  # fmt: skip
    legend_below(figure, [grid.flat[0]])
    return figure
