"""Estimated against true parameters of the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.learned import UNSEEN
from dacore.figures.slices import scale
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, marker, pretty, share_text, sheet, styled


@dataclass(frozen=True, eq=False)
class ParameterPanel:
    """One parameter over the cases.

    Parameters
    ----------
    name, unit : str
    low, high : float
        Its range.
    truth : (k,) array
    estimates : mapping of str to ((k,), (k,)) arrays
        For each noise level, by label, values and the standard deviations that are claimed.
    learned : mapping of str to float
        For each noise level, the share of the prior's variance that the data took away.
    logarithmic : bool
        Whether its range is covered evenly in its logarithm.
    """

    name: str
    unit: str
    low: float
    high: float
    truth: Array
    estimates: Mapping[str, tuple[Array, Array]]
    learned: Mapping[str, float]
    logarithmic: bool = False

    def __post_init__(self) -> None:
        for label, (values, deviation) in self.estimates.items():
            if np.shape(values) != np.shape(self.truth) or np.shape(deviation) != np.shape(self.truth):
                raise ShapeError(
                    f"{self.name}, {label}: got shapes {np.shape(values)} and {np.shape(deviation)}, expected "
                    f"{np.shape(self.truth)} as the truth"
                )


@styled
def parameters(panels: Sequence[ParameterPanel], caption: str = "", level: float = 0.9) -> Figure:
    """Draw estimate against truth, a panel a parameter, with its range as the frame and Gaussian intervals.

    A panel is grey where no noise level lets the data say anything of its parameter.

    Parameters
    ----------
    panels : sequence of ParameterPanel
    caption : str
    level : float
        Of the intervals.
    """
    if not panels:
        raise ShapeError("parameters: got no panel, expected at least one")
    columns = min(len(panels), 4) if len(panels) != 6 else 3
    rows = -(-len(panels) // columns)
    size = (WIDTH - 0.2) / max(columns, 3)
    figure, grid = sheet(rows, columns, (size + 0.25) * rows + 0.4, caption, width=size * columns + 0.2)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    half = float(norm.ppf(0.5 + level / 2))
    for index, (axes, panel) in enumerate(zip(grid.flat, panels)):
        _panel(axes, panel, half, level)
        if index % columns == 0:
            axes.set_ylabel("estimate")
        if index >= len(panels) - columns:
            axes.set_xlabel("truth")
    legend_below(figure, list(grid.flat))
    return figure


def _panel(axes: Axes, panel: ParameterPanel, half: float, level: float) -> None:
    # A power of ten goes to the title, so that ticks are short.
    power = scale(np.array([panel.low, panel.high])) if not panel.logarithmic else None
    factor = 1.0 if power is None else 10.0**-power.power
    low, high = factor * panel.low, factor * panel.high
    if panel.logarithmic:
        axes.set(xscale="log", yscale="log")
        reach = (high / low) ** 0.06
        limits = (low / reach, high * reach)
    else:
        limits = (low - 0.06 * (high - low), high + 0.06 * (high - low))
        axes.locator_params(nbins=4)
        axes.ticklabel_format(useOffset=False)
    axes.plot(limits, limits, color=INK, linewidth=0.9, zorder=1, label="estimate = truth")
    truth = factor * np.asarray(panel.truth)
    for index, (label, (values, deviation)) in enumerate(panel.estimates.items()):
        found = factor * np.asarray(values)
        axes.errorbar(
            truth, found, yerr=half * factor * np.asarray(deviation), fmt="none", ecolor=colour(index), elinewidth=1.0,
            alpha=0.45, capsize=1.5, zorder=2,
        )  # fmt: skip
        axes.plot(
            truth, found, marker(index), color=colour(index), markersize=4.5, markeredgecolor="white",
            markeredgewidth=0.5, label=pretty(label), zorder=3,
        )  # fmt: skip
    axes.plot(
        [], [], color="#777777", marker="|", markersize=9, linestyle="none", label=f"{100 * level:.0f} % interval"
    )
    axes.set(xlim=limits, ylim=limits)
    axes.set_box_aspect(1.0)
    if panel.learned and max(panel.learned.values()) < UNSEEN:
        axes.set_facecolor("#EFEFEF")
    label = power.label(panel.name, panel.unit) if power is not None else f"{pretty(panel.name)}  [{panel.unit}]"
    axes.set_title(label.replace("[1]", "[–]"), pad=15)
    shares = " / ".join(share_text(each) for each in panel.learned.values())
    axes.text(
        0.5, 1.015, f"learned {shares}", transform=axes.transAxes, ha="center", va="bottom", fontsize=7.5,
        color=INK if panel.learned and max(panel.learned.values()) >= UNSEEN else FAINT,
    )  # fmt: skip
