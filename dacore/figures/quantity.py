"""Estimated against true quantity of interest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, pretty, share_text, sheet, styled, title_text


@dataclass(frozen=True, eq=False)
class QuantityPanel:
    """Estimates of one estimator at one noise level.

    Parameters
    ----------
    column : str
        Estimator.
    row : str
        Noise level.
    truth, estimate : (k,) arrays
        Of k cases.
    deviation : (k,) array, optional
        Standard deviation the estimator claims.
    learned : float, optional
        Share of the prior's variance that the claimed one takes away.
    """

    column: str
    row: str
    truth: Array
    estimate: Array
    deviation: Array | None = None
    learned: float | None = None

    def __post_init__(self) -> None:
        for what, values in (("estimate", self.estimate), ("deviation", self.deviation)):
            if values is not None and np.shape(values) != np.shape(self.truth):
                raise ShapeError(
                    f"{what} of {self.column!r}: got shape {np.shape(values)}, "
                    f"expected {np.shape(self.truth)} as the truth"
                )


@styled
def quantity(
    panels: Sequence[QuantityPanel], name: str, unit: str, prior: tuple[float, float], caption: str = "",
    level: float = 0.9,
) -> Figure:  # fmt: skip
    """Draw estimate against truth, a column an estimator and a row a noise level, with the identity.

    The band is what is known without data: the training mean and one standard deviation. Its height is
    the size of the error of guessing. All panels share their axes; estimates outside are put on the edge
    as triangles and counted.

    Parameters
    ----------
    panels : sequence of QuantityPanel
    name, unit : str
        Of the quantity.
    prior : (float, float)
        Training mean and standard deviation.
    caption : str
    level : float
        Of the central Gaussian intervals drawn where a deviation is given.
    """
    columns = list(dict.fromkeys(panel.column for panel in panels))
    rows = list(dict.fromkeys(panel.row for panel in panels))
    size = min(3.1, (WIDTH - 0.9) / len(columns))
    figure, grid = sheet(
        len(rows), len(columns), (size + 0.1) * len(rows) + 1.1, caption, width=max(4.2, size * len(columns) + 0.9),
        sharex=True, sharey=True,
    )  # fmt: skip
    low, high = _range(panels, prior)
    half = float(norm.ppf(0.5 + level / 2))
    drawn = {(panel.row, panel.column): panel for panel in panels}
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            axes = grid[i, j]
            if (row, column) not in drawn:
                axes.set_visible(False)
                continue
            _panel(axes, drawn[row, column], (low, high), prior, half, level, j)
            if i == 0:
                axes.set_title(title_text(column), pad=16)
            if i == len(rows) - 1:
                axes.set_xlabel(f"true {pretty(name)}  [{unit}]")
        label = f"estimated {pretty(name)}  [{unit}]"
        grid[i, 0].set_ylabel(f"{pretty(row)}\n{label}" if row else label)
    legend_below(figure, list(grid.flat))
    return figure


def _range(panels: Sequence[QuantityPanel], prior: tuple[float, float]) -> tuple[float, float]:
    """Range of the axes: that of the truths and the prior, a little more where estimates need it."""
    truths = np.concatenate([np.ravel(panel.truth) for panel in panels])
    ends = [float(truths.min()), float(truths.max()), prior[0] - prior[1], prior[0] + prior[1]]
    low, high = min(ends), max(ends)
    span = (high - low) or abs(high) or 1.0
    seen = np.concatenate([np.ravel(panel.estimate) for panel in panels])
    inside = seen[(seen > low - 0.6 * span) & (seen < high + 0.6 * span)]
    low, high = min(low, float(inside.min(initial=low))), max(high, float(inside.max(initial=high)))
    return low - 0.08 * span, high + 0.08 * span


def _panel(
    axes: Axes, panel: QuantityPanel, limits: tuple[float, float], prior: tuple[float, float], half: float,
    level: float, index: int,
) -> None:  # fmt: skip
    low, high = limits
    band = (prior[0] - prior[1], prior[0] + prior[1])
    axes.axhspan(*band, color="#E6E6E6", linewidth=0, zorder=0, label="training mean ± std")
    axes.axhline(prior[0], color=FAINT, linewidth=0.9, linestyle=(0, (5, 3)), zorder=1)
    axes.plot(limits, limits, color=INK, linewidth=0.9, zorder=1, label="estimate = truth")
    truth, estimate = np.asarray(panel.truth), np.asarray(panel.estimate)
    inside = (estimate >= low) & (estimate <= high)
    if panel.deviation is not None:
        axes.errorbar(
            truth[inside], estimate[inside], yerr=half * np.asarray(panel.deviation)[inside], fmt="none",
            ecolor=colour(index), elinewidth=1.0, alpha=0.55, capsize=2.0,
        )  # fmt: skip
        axes.plot(
            [], [], color="#777777", marker="|", markersize=9, linestyle="none", label=f"{100 * level:.0f} % interval"
        )
    axes.plot(
        truth[inside], estimate[inside], "o", color=colour(index), markersize=5, markeredgecolor="white",
        markeredgewidth=0.6,
    )  # fmt: skip
    edge = 0.015 * (high - low)
    for beyond, place, mark in ((estimate > high, high - edge, "^"), (estimate < low, low + edge, "v")):
        axes.plot(truth[beyond], np.full(int(beyond.sum()), place), mark, color=colour(index), markersize=5)
    error = float(np.sqrt(np.mean((estimate - truth) ** 2)))
    note = f"rms error {float(f'{error:.3g}'):,.0f}" if error >= 100 else f"rms error {error:.2g}"
    if not inside.all():
        note += f" · {int((~inside).sum())} of {len(truth)} outside"
    elif panel.learned is not None and panel.learned > 0:
        note += f" · {share_text(panel.learned)} learned"
    axes.text(0.5, 1.015, note, transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
    axes.set(xlim=limits, ylim=limits, aspect="equal")
    axes.locator_params(nbins=5)
    axes.ticklabel_format(useOffset=False)
