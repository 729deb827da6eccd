"""What the weight ζ between the fields does: errors, stability and the dimension chosen, over many decades."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class WeightStudy:
    """Estimates with each weight.

    Parameters
    ----------
    weights : (z,) array
        ζ, rising.
    errors : mapping of str to (z,) array
        Relative errors by name.
    inf_sup : (z,) array
        β of the dimension in use.
    chosen : (z,) array
        The dimension in use.
    unit : str
        Of ζ.
    marks : mapping of str to float
        Weights with a name: "balanced", "published".
    guess : mapping of str to float
        Errors of guessing the training mean, by name.
    """

    weights: Array
    errors: Mapping[str, Array]
    inf_sup: Array
    chosen: Array
    unit: str
    marks: Mapping[str, float] = field(default_factory=dict)
    guess: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        wanted = np.shape(self.weights)
        for name, values in {"β": self.inf_sup, "dimension": self.chosen, **self.errors}.items():
            if np.shape(values) != wanted:
                raise ShapeError(f"{name}: got shape {np.shape(values)}, expected {wanted} as the weights")
        if not (np.size(self.weights) and np.min(self.weights) > 0):
            raise ShapeError("weights: expected at least one, all positive, for logarithms")


@styled
def weights(study: WeightStudy, caption: str = "") -> Figure:
    """Draw errors, β and n against ζ, one below the other.

    Dashed lines of an error's colour are what guessing the training mean gives.

    Parameters
    ----------
    study : WeightStudy
    caption : str
    """
    figure, grid = sheet(3, 1, 6.2, caption, width=7.0, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    top, middle, bottom = grid[:, 0]
    zeta = np.asarray(study.weights, dtype=np.float64)
    log_axis(top, plain=True)
    for index, (name, values) in enumerate(study.errors.items()):
        shown = 100 * np.asarray(values, dtype=np.float64)
        _line(top, zeta, np.where(shown > 0, shown, np.nan), index, pretty(name))
        if name in study.guess:
            top.axhline(100 * study.guess[name], color=colour(index), linewidth=1.0, linestyle=(0, (5, 3)), zorder=0)
    if study.guess:
        top.plot([], [], color=FAINT, linewidth=1.0, linestyle=(0, (5, 3)), label="guessing the training mean")
    top.set_ylabel("relative error  [%]")
    log_axis(middle)
    beta = np.asarray(study.inf_sup, dtype=np.float64)
    middle.plot(zeta, np.where(beta > 0, beta, np.nan), color=INK, marker="o", markersize=3.5, linewidth=1.2)
    middle.set_ylabel(r"stability $\beta_n$  [–]")
    bottom.step(zeta, study.chosen, where="mid", color=INK, linewidth=1.2)
    bottom.plot(zeta, study.chosen, "o", color=INK, markersize=3.5)
    bottom.set_ylim(0, 1.15 * float(np.max(study.chosen)))
    bottom.locator_params(axis="y", nbins=4, integer=True)
    bottom.set_ylabel("dimension $n$")
    bottom.grid(visible=True, axis="y")
    for axes in (top, middle, bottom):
        log_axis(axes, "x", ticks=9)
        for name, value in study.marks.items():
            axes.axvline(value, color=FAINT, linewidth=1.0, linestyle=(0, (1, 2)), zorder=0)
            if axes is top:
                axes.annotate(
                    pretty(name), (value, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                    textcoords="offset points", ha="center", va="bottom", fontsize=8, color=INK,
                )  # fmt: skip
    bottom.set_xlabel(rf"weight $\zeta$  [{'–' if study.unit == '1' else study.unit}]")
    legend_below(figure, [top])
    return figure


def _line(axes: Axes, x: Array, values: Array, index: int, label: str) -> None:
    axes.plot(
        x, values, color=colour(index), marker=marker(index), markersize=4.5, markeredgecolor="white",
        markeredgewidth=0.4, linewidth=1.4, label=label,
    )  # fmt: skip
