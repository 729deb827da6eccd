"""Two groups told apart by an estimated number: who is where, and the operating curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array, BoolArray
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, marker, pretty, sheet, styled, title_text

# Of more patients than this, intervals would be a smear.
_INTERVALS = 80


@dataclass(frozen=True, eq=False)
class ClassPanel:
    """Estimates of one estimator at one noise level.

    Parameters
    ----------
    label : str
    truth, estimate : (k,) arrays
    raised : (k,) bool array
        Who is truly of the second group.
    threshold : float
        Estimates at or above it are called raised.
    low, high : (k,) arrays, optional
        Intervals of the estimates.
    series : int, optional
        Number of the estimator's colour; its place among the panels by default.
    """

    label: str
    truth: Array
    estimate: Array
    raised: BoolArray
    threshold: float
    low: Array | None = None
    high: Array | None = None
    series: int | None = None

    def __post_init__(self) -> None:
        wanted = np.shape(self.truth)
        for what in ("estimate", "raised", "low", "high"):
            values = getattr(self, what)
            if values is not None and np.shape(values) != wanted:
                raise ShapeError(
                    f"{what} of {self.label!r}: got shape {np.shape(values)}, expected {wanted} as the truth"
                )
        if (self.low is None) != (self.high is None):
            raise ShapeError(f"intervals of {self.label!r}: got one end only, expected both or none")

    @property
    def right(self) -> BoolArray:
        """Who (k,) is called what they are."""
        return np.asarray((np.asarray(self.estimate) >= self.threshold) == np.asarray(self.raised))


@dataclass(frozen=True, eq=False)
class OperatingLine:
    """Rates of one estimator as the threshold falls.

    Parameters
    ----------
    label : str
    false_positive, true_positive : (n,) arrays
        Rising from 0 to 1.
    area : float
        Under the curve.
    interval : (float, float)
        Of the area.
    series : int, optional
        Number of the estimator's colour; its place among the curves by default.
    """

    label: str
    false_positive: Array
    true_positive: Array
    area: float
    interval: tuple[float, float]
    series: int | None = None

    def __post_init__(self) -> None:
        if np.shape(self.false_positive) != np.shape(self.true_positive):
            raise ShapeError(f"rates of {self.label!r}: expected as many false positive ones as true positive ones")


@styled
def classification(
    panels: Sequence[ClassPanel],
    curves: Sequence[OperatingLine],
    name: str,
    unit: str,
    groups: tuple[str, str] = ("normal", "raised"),
    level: float = 0.9,
    caption: str = "",
) -> Figure:
    """Draw estimates against truths with the threshold, a panel an estimator, and all operating curves.

    A panel and a curve have the colour of their estimator; groups are told apart by fill and shape.

    Parameters
    ----------
    panels : sequence of ClassPanel
    curves : sequence of OperatingLine
        None: no panel of curves.
    name, unit : str
        Of the number.
    groups : (str, str)
        Names of the group of small numbers and that of large ones.
    level : float
        Of the intervals.
    caption : str
    """
    if not panels:
        raise ShapeError("classification: got no panel, expected at least one")
    total = len(panels) + bool(curves)
    columns = 2 if total == 4 else min(3, total)
    rows = -(-total // columns)
    size = (WIDTH - 0.3) / 3
    beside = total < rows * columns
    height = (size + 0.45) * rows + (0.4 if beside else 0.6 + 0.3 * len(curves))
    figure, grid = sheet(rows, columns, height, caption, width=max(size * columns + 0.3, 4.2))
    limits = _limits(panels)
    for axes in grid.flat[total:]:
        axes.set_visible(False)
    for index, (axes, panel) in enumerate(zip(grid.flat, panels)):
        _scatter(axes, panel, colour(_series(panel, index)), limits, groups, level)
        axes.set_xlabel(f"true {pretty(name)}  [{unit}]")
        if index % columns == 0:
            axes.set_ylabel(f"estimated {pretty(name)}  [{unit}]")
    if curves:
        _curves(grid.flat[len(panels)], curves, beside)
    # Inside their panel it would cover a curve, wherever it stood.
    legend_below(figure, list(grid.flat[: len(panels) if beside else total]))
    return figure


def _series(given: ClassPanel | OperatingLine, index: int) -> int:
    return index if given.series is None else given.series


def _limits(panels: Sequence[ClassPanel]) -> tuple[float, float]:
    truths = np.concatenate([np.ravel(panel.truth) for panel in panels])
    found = np.concatenate([np.ravel(panel.estimate) for panel in panels])
    low, high = float(truths.min()), float(truths.max())
    span = (high - low) or 1.0
    inside = found[(found > low - span) & (found < high + span)]
    low, high = min(low, float(inside.min(initial=low))), max(high, float(inside.max(initial=high)))
    return low - 0.06 * span, high + 0.06 * span


def _scatter(
    axes: Axes, panel: ClassPanel, shade: str, limits: tuple[float, float], groups: tuple[str, str], level: float
) -> None:  # fmt: skip
    truth, estimate = np.asarray(panel.truth, dtype=np.float64), np.asarray(panel.estimate, dtype=np.float64)
    raised = np.asarray(panel.raised)
    low, high = limits
    few = len(truth) <= _INTERVALS
    axes.axhspan(panel.threshold, high, color="#F6EFE9", linewidth=0, zorder=0)
    axes.axhline(panel.threshold, color=INK, linewidth=1.1, linestyle=(0, (5, 3)), zorder=1, label="threshold")
    axes.plot(limits, limits, color=FAINT, linewidth=0.9, zorder=1, label="estimate = truth")
    shown: Array = np.clip(estimate, low, high)
    for index, name in enumerate(groups):
        mine = raised == bool(index)
        if panel.low is not None and panel.high is not None and few:
            ends = np.stack([shown - np.asarray(panel.low), np.asarray(panel.high) - shown])[:, mine]
            axes.errorbar(
                truth[mine], shown[mine], yerr=np.maximum(ends, 0.0), fmt="none", ecolor=shade, elinewidth=1.0,
                alpha=0.5, capsize=1.5,
            )  # fmt: skip
        axes.plot(
            truth[mine], shown[mine], marker(index), color=shade, markersize=5.0 if few else 2.6,
            markerfacecolor=shade if index else "white", markeredgecolor="white" if index and few else shade,
            markeredgewidth=0.6 if index else 0.9, alpha=1.0 if few else 0.55, zorder=2.5,
        )  # fmt: skip
        axes.plot(
            [], [], marker(index), color=INK, markerfacecolor=INK if index else "white", markersize=5.0,
            label=pretty(name),
        )  # fmt: skip
    wrong = ~panel.right
    if wrong.any():
        axes.plot(
            truth[wrong], shown[wrong], "o", markersize=9 if few else 6, markerfacecolor="none", markeredgecolor=INK,
            markeredgewidth=0.9 if few else 0.6, label="told wrong",
        )  # fmt: skip
    if panel.low is not None and few:
        axes.plot(
            [], [], color="#777777", marker="|", markersize=9, linestyle="none", label=f"{100 * level:.0f} % interval"
        )
    note = f"{int((~wrong).sum())} of {len(truth)} told right"
    outside = int((shown != estimate).sum())
    if outside:
        note += f" · {outside} outside, on the edge"
    axes.text(0.5, 1.015, note, transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
    axes.set_title(title_text(panel.label), pad=16)
    axes.set(xlim=limits, ylim=limits, aspect="equal")
    axes.locator_params(nbins=5)
    axes.ticklabel_format(useOffset=False)


def _curves(axes: Axes, curves: Sequence[OperatingLine], beside: bool) -> None:
    """Draw operating curves; their legend stands beside them where the last row has room for it, else below all."""
    axes.plot([0, 1], [0, 1], color=FAINT, linewidth=0.9, linestyle=(0, (2, 3)))
    dashes = ("-", (0, (6, 2)), (0, (3, 1.5)), (0, (1, 1.2)))
    for index, curve in enumerate(curves):
        axes.plot(
            curve.false_positive, curve.true_positive, color=colour(_series(curve, index)),
            linestyle=dashes[index % len(dashes)], linewidth=2.4 - 0.3 * min(index, 4), clip_on=False, zorder=3,
            label=f"{pretty(curve.label)}\nAUC {curve.area:.3f} [{curve.interval[0]:.3f}, {curve.interval[1]:.3f}]",
        )  # fmt: skip
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.set_title("operating curve", pad=16)
    axes.set_xlabel("normal called raised  [–]")
    axes.set_ylabel("raised called raised  [–]")
    if beside:
        legend = axes.legend(
            loc="upper left", bbox_to_anchor=(1.04, 1.02), fontsize=7.5, labelspacing=0.6, borderaxespad=0.0
        )
        # It lies over empty panels, which the layout must not make room for.
        legend.set_in_layout(False)
