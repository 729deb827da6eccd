"""Errors against the size of the cells, and the slopes they should have."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """Errors of one quantity, computed in one way.

    Parameters
    ----------
    quantity : str
        Has a colour of its own.
    variant : str
        Has a dash of its own.
    sizes : (n,) array
        Sizes of the cells, in any order.
    errors : (n,) array
        Relative errors, positive.
    """

    quantity: str
    variant: str
    sizes: Array
    errors: Array

    def __post_init__(self) -> None:
        if np.shape(self.sizes) != np.shape(self.errors) or np.ndim(self.sizes) != 1 or not np.size(self.sizes):
            raise ShapeError(
                f"errors of {self.quantity!r}: got shape {np.shape(self.errors)} for sizes of shape "
                f"{np.shape(self.sizes)}, expected two of one length"
            )
        if not (np.min(self.sizes) > 0 and np.min(self.errors) > 0):
            raise ShapeError(f"errors of {self.quantity!r}: expected positive sizes and errors, for logarithms")


@dataclass(frozen=True, eq=False)
class Convergence:
    """The curves of one panel.

    Parameters
    ----------
    label : str
    curves : sequence of ErrorCurve
    """

    label: str
    curves: Sequence[ErrorCurve]


@styled
def convergence(panels: Sequence[Convergence], orders: Sequence[int] = (1, 2), caption: str = "") -> Figure:
    """Draw errors against the size of the cells, a panel a problem, with a faint line for each expected order.

    Parameters
    ----------
    panels : sequence of Convergence
    orders : sequence of int
    caption : str
    """
    if not panels or not all(panel.curves for panel in panels):
        raise ShapeError("convergence: got no panel, or one without curves; expected at least one of each")
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, grid = sheet(rows, columns, 2.5 * rows + 0.5, caption, width=WIDTH)
    quantities = list(dict.fromkeys(curve.quantity for panel in panels for curve in panel.curves))
    variants = list(dict.fromkeys(curve.variant for panel in panels for curve in panel.curves))
    dashes = ("-", "--", ":", "-.")
    for axes, panel in zip(grid.flat, panels):
        log_axis(axes)
        axes.set_xscale("log")
        for curve in panel.curves:
            k = quantities.index(curve.quantity)
            axes.plot(
                curve.sizes, curve.errors, marker=marker(k), color=colour(k), markersize=4.5,
                linestyle=dashes[variants.index(curve.variant) % len(dashes)],
                label=f"{pretty(curve.quantity)}, {pretty(curve.variant)}",
            )  # fmt: skip
        sizes = np.concatenate([curve.sizes for curve in panel.curves])
        ends = np.array([sizes.min(), sizes.max()])
        ticks = np.unique(sizes)
        axes.set_xticks(ticks, [f"{size:.2g}" for size in ticks])
        axes.set_xticks([], minor=True)
        lowest = min(float(np.min(curve.errors)) for curve in panel.curves)
        for order in orders:
            axes.plot(ends, 0.5 * lowest * (ends / ends[0]) ** order, color=FAINT, linewidth=0.8, zorder=0)
            axes.annotate(
                f"{order}", (ends[1], 0.5 * lowest * (ends[1] / ends[0]) ** order), color=FAINT, fontsize=8,
                xytext=(3, 0), textcoords="offset points", va="center",
            )  # fmt: skip
        axes.set_title(pretty(panel.label))
        axes.set_xlabel("size of the cells")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("relative error")
    legend_below(figure, list(grid.flat))
    return figure
