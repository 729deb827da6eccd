"""Measured values beside what an estimate says of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.slices import scale
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, pretty, sheet, styled

# Points beyond these are thinned: a million of them is a blot, and a file of many megabytes.
_POINTS = 4000
_BINS = 41


@dataclass(frozen=True, eq=False)
class FitSeries:
    """Values of one kind: one component of a field.

    Parameters
    ----------
    name, unit : str
    measured, fitted, sigma : (n,) arrays
        Zeros of sigma for exact data.
    """

    name: str
    unit: str
    measured: Array
    fitted: Array
    sigma: Array


@styled
def data_fit(series: Sequence[FitSeries], caption: str = "") -> Figure:
    """Draw the fit against the data, and the residuals in units of the noise (of their own size for exact data).

    Parameters
    ----------
    series : sequence of FitSeries
        Of one unit.
    caption : str

    Raises
    ------
    ShapeError
        If there is none, or the shapes of one disagree.
    """
    if not series or any(
        not len(s.measured) or not np.shape(s.measured) == np.shape(s.fitted) == np.shape(s.sigma) for s in series
    ):
        raise ShapeError(
            "data fit: expected at least one series, with as many fitted values and sigmas as measured ones"
        )
    figure, grid = sheet(1, 2, 3.5, caption, width=WIDTH * 0.9)
    left, right = grid[0]
    shown = scale(*[s.measured for s in series], signed=True)
    power = 10.0**shown.power
    ends = np.array([-shown.size, shown.size]) * 1.05 / power
    exact = not all((s.sigma > 0).all() for s in series)
    left.plot(ends, ends, color=INK, linewidth=0.8, zorder=1)
    if not exact:
        widest = 2 * max(float(np.median(s.sigma)) for s in series) / power
        left.fill_between(ends, ends - widest, ends + widest, color="#E6E6E6", linewidth=0, zorder=0, label="two sigma")
    for index, s in enumerate(series):
        step = max(1, len(s.measured) // _POINTS)
        left.plot(
            s.measured[::step] / power, s.fitted[::step] / power, ".", color=colour(index), markersize=3, alpha=0.6,
            markeredgewidth=0, label=pretty(s.name), rasterized=True,
        )  # fmt: skip
    left.set(xlim=ends, ylim=ends, aspect="equal")
    left.set_xlabel(shown.label("measured", series[0].unit))
    left.set_ylabel("fit")
    left.set_title("data and fit")
    residual = np.concatenate([s.measured - s.fitted for s in series])
    unit = np.concatenate([s.sigma for s in series]) if not exact else np.full(len(residual), _size(residual))
    scaled = residual / unit
    most = max(4.0, min(float(np.abs(scaled).max()), 8.0))
    right.hist(
        np.clip(scaled, -most, most), np.linspace(-most, most, _BINS), density=True, color=FAINT, label="residuals"
    )
    fine = np.linspace(-most, most, 201)
    if not exact:
        right.plot(fine, norm.pdf(fine), color=INK, linewidth=1.2, label="what the stated noise gives")
    right.set_xlabel("residual / sigma" if not exact else "residual / its root mean square")
    right.set_ylabel("density")
    right.set_title("residuals")
    legend_below(figure, [left, right])
    for handle in figure.legends[0].legend_handles[:]:
        if isinstance(handle, Line2D) and handle.get_marker() == ".":
            handle.set(markersize=9, alpha=1.0)
    return figure


def _size(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2))) or 1.0
