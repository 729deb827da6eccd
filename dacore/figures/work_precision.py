"""Work–precision diagrams: error against cost, and the efficient frontier."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array, BoolArray
from dacore.errors import ShapeError
from dacore.figures.style import INK, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class Diagram:
    """One panel.

    Parameters
    ----------
    error, cost : str
        Labels of the axes with units.
    costs, errors : (k,) arrays
        Points that are not finite and positive are left out.
    series : (k,) int array
        Which series each point belongs to; points of a series are joined in their order.
    efficient : (k,) bool array
        Points on the frontier, joined by a line and ringed.
    """

    error: str
    cost: str
    costs: Array
    errors: Array
    series: Array
    efficient: BoolArray


@styled
def work_precision(series: Sequence[str], diagrams: Sequence[Diagram], caption: str = "", columns: int = 2) -> Figure:
    """Draw panels of error against cost, both logarithmic.

    Parameters
    ----------
    series : sequence of str
    diagrams : sequence of Diagram
    caption : str
    columns : int
    """
    columns = min(columns, len(diagrams))
    rows = -(-len(diagrams) // columns)
    figure, grid = sheet(rows, columns, 3.2 * rows + 0.5, caption, width=WIDTH)
    panels = list(grid.ravel())
    for axes, diagram in zip(panels, diagrams):
        if not len(diagram.costs) == len(diagram.errors) == len(diagram.series) == len(diagram.efficient):
            raise ShapeError(f"diagram of {diagram.error}: costs, errors, series and marks must have one length")
        shown = np.isfinite(diagram.costs) & (diagram.costs > 0) & np.isfinite(diagram.errors) & (diagram.errors > 0)
        for which in ("x", "y"):
            log_axis(axes, which, ticks=6)
        best = np.flatnonzero(shown & diagram.efficient)
        best = best[np.argsort(diagram.costs[best])]
        axes.step(
            diagram.costs[best], diagram.errors[best], where="post", color=INK, linewidth=5.0, alpha=0.13,
            solid_capstyle="round", label="efficient frontier",
        )  # fmt: skip
        for k, name in enumerate(series):
            mine = np.flatnonzero(shown & (diagram.series == k))
            if mine.size:
                axes.plot(
                    diagram.costs[mine], diagram.errors[mine], color=colour(k), marker=marker(k), linewidth=1.0,
                    markersize=5.5, markeredgecolor="white", markeredgewidth=0.5, label=pretty(name),
                )  # fmt: skip
        axes.plot(
            diagram.costs[best], diagram.errors[best], linestyle="none", marker="o", markersize=10,
            markerfacecolor="none", markeredgecolor=INK, markeredgewidth=0.9,
        )  # fmt: skip
        axes.set_xlabel(pretty(diagram.cost))
        axes.set_ylabel(pretty(diagram.error))
    for axes in panels[len(diagrams) :]:
        axes.set_visible(False)
    legend_below(figure, panels[: len(diagrams)])
    return figure


@styled
def growth(sizes: Array, costs: Sequence[tuple[str, str, Array, float]], size: str, caption: str = "") -> Figure:
    """Draw how costs grow with a size, each with its fitted power.

    Parameters
    ----------
    sizes : (k,) array
    costs : sequence of (name, unit, (k,) values, exponent)
    size : str
        Label of the size.
    caption : str
    """
    columns = min(3, len(costs))
    rows = -(-len(costs) // columns)
    figure, grid = sheet(rows, columns, 2.4 * rows + 0.2, caption, width=WIDTH)
    order = np.argsort(sizes)
    for axes in grid.flat[len(costs) :]:
        axes.set_visible(False)
    for k, (axes, (name, unit, values, exponent)) in enumerate(zip(grid.flat, costs)):
        for which in ("x", "y"):
            log_axis(axes, which, ticks=5)
        axes.plot(sizes[order], values[order], color=colour(k), marker=marker(k), linewidth=1.2)
        axes.set_title(f"{pretty(name)}  [{unit}]")
        axes.set_xlabel(size)
        axes.text(0.05, 0.95, f"~ size$^{{{exponent:.2f}}}$", transform=axes.transAxes, va="top", fontsize=9, color=INK)
    return figure
