"""Curves known by formula, and the points that were computed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import WIDTH, colour, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class Known:
    """One curve by formula and what was computed of it.

    Parameters
    ----------
    label : str
    x, exact : (n,) array
        The curve.
    at, computed : (m,) array
        The points.
    """

    label: str
    x: Array
    exact: Array
    at: Array
    computed: Array

    def __post_init__(self) -> None:
        for first, second, what in ((self.x, self.exact, "curve"), (self.at, self.computed, "points")):
            if np.ndim(first) != 1 or np.shape(first) != np.shape(second):
                raise ShapeError(
                    f"{what} of {self.label!r}: got shapes {np.shape(first)} and {np.shape(second)}, "
                    "expected two of one length"
                )


@dataclass(frozen=True, eq=False)
class FormulaPanel:
    """The curves of one panel.

    Parameters
    ----------
    title, x_label, y_label : str
    curves : sequence of Known
    log_x : bool
    """

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Known]
    log_x: bool = False


@styled
def against_formula(panels: Sequence[FormulaPanel], caption: str = "") -> Figure:
    """Draw formulas as lines and what was computed as marks upon them.

    Parameters
    ----------
    panels : sequence of FormulaPanel
    caption : str
    """
    if not panels:
        raise ShapeError("formulas: got no panel, expected at least one")
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, grid = sheet(rows, columns, 2.6 * rows + 0.3, caption, width=WIDTH)
    for axes, panel in zip(grid.flat, panels):
        if panel.log_x:
            log_axis(axes, "x", ticks=6)
        for k, curve in enumerate(panel.curves):
            axes.plot(curve.x, curve.exact, color=colour(k), linewidth=1.2)
            axes.plot(
                curve.at, curve.computed, color=colour(k), marker=marker(k), markersize=3.5, linestyle="none",
                label=pretty(curve.label),
            )  # fmt: skip
        axes.set_title(pretty(panel.title))
        axes.set_xlabel(pretty(panel.x_label))
        axes.set_ylabel(pretty(panel.y_label))
        axes.grid(visible=True, which="major")
        axes.legend(loc="best", fontsize=7.5)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    return figure
