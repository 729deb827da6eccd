"""What greedily placed measurements are worth, beside random ones and the best."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import COLOURS, FAINT, INK, WIDTH, legend_below, log_axis, pretty, sheet, styled, title_text


@dataclass(frozen=True, eq=False)
class PlacementPanel:
    """One criterion.

    Parameters
    ----------
    label : str
    axis : str
        What the criterion is, with its unit.
    values : (p + 1,) array
        With none, one, … p candidates.
    random : (R, p + 1) array
        Of random orders; R may be 0.
    best : (p + 1,) array, optional
        Of the best choice of so many; NaN where unknown.
    names : sequence of p str
        Of the candidates in greedy order.
    log : bool
    """

    label: str
    axis: str
    values: Array
    random: Array
    best: Array | None = None
    names: Sequence[str] = field(default_factory=tuple)
    log: bool = True

    def __post_init__(self) -> None:
        p = len(self.values) - 1
        if p < 1 or np.ndim(self.random) != 2 or np.shape(self.random)[1] != p + 1:
            raise ShapeError(
                f"random orders of {self.label!r}: got shape {np.shape(self.random)}, expected (orders, {p + 1})"
            )
        if self.best is not None and np.shape(self.best) != (p + 1,):
            raise ShapeError(f"best of {self.label!r}: got shape {np.shape(self.best)}, expected ({p + 1},)")
        if len(self.names) not in (0, p):
            raise ShapeError(f"names of {self.label!r}: got {len(self.names)}, expected {p} or none")


@styled
def placement(panels: Sequence[PlacementPanel], what: str = "slices", caption: str = "") -> Figure:
    """Draw criteria against the number of candidates, a panel a criterion.

    Parameters
    ----------
    panels : sequence of PlacementPanel
    what : str
        What is placed, in the plural.
    caption : str
    """
    if not panels:
        raise ShapeError("placement: got no panel, expected at least one")
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    width = WIDTH if columns > 1 else 5.6
    figure, grid = sheet(rows, columns, 3.3 * rows + 0.4, caption, width=width)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, panel in zip(grid.flat, panels):
        if panel.log:
            log_axis(axes, plain=True)
        else:
            axes.grid(visible=True, axis="y")
        numbers = np.arange(len(panel.values))
        others = _shown(panel.random, panel.log)
        known = np.isfinite(others).any(axis=0) if len(others) else np.zeros(len(numbers), dtype=bool)
        if known.any():
            low, middle, high = np.nanquantile(others[:, known], (0.0, 0.5, 1.0), axis=0)
            axes.fill_between(
                numbers[known], low, high, color=FAINT, alpha=0.25, linewidth=0,
                label=f"{len(others)} random orders",
            )  # fmt: skip
            axes.plot(numbers[known], middle, color=FAINT, linewidth=1.2, label="their median")
        axes.plot(
            numbers, _shown(panel.values, panel.log), color=COLOURS[0], marker="o", markersize=5,
            markeredgecolor="white", markeredgewidth=0.5, zorder=3, label="greedy",
        )  # fmt: skip
        if panel.best is not None and np.isfinite(panel.best[1:]).any():
            axes.plot(
                numbers[1:], _shown(panel.best, panel.log)[1:], linestyle="none", marker="_", markersize=13,
                markeredgewidth=2.0, color=COLOURS[1], zorder=2, label="best of all choices",
            )  # fmt: skip
        if panel.names:
            axes.set_xticks(numbers, ["0", *(f"{n}\n{pretty(name)}" for n, name in enumerate(panel.names, start=1))])
            axes.tick_params(axis="x", labelsize=7.0 if len(panel.names) > 6 else 8.0)
        else:
            axes.locator_params(axis="x", integer=True)
        axes.set_xlim(-0.2 if np.isfinite(_shown(panel.values, panel.log)[0]) else 0.6, len(numbers) - 0.7)
        axes.set_title(title_text(panel.label))
        axes.set_xlabel(f"number of {pretty(what)}" + (", and the one added" if panel.names else ""), color=INK)
        axes.set_ylabel(pretty(panel.axis))
    legend_below(figure, list(grid.flat))
    return figure


def _shown(values: Array, log: bool) -> Array:
    given = np.array(values, dtype=np.float64)
    if log:
        given[~(given > 0)] = np.nan
    return given
