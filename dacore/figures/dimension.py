"""What the dimension of the background space does to errors, and which one each rule takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError
from dacore.figures.style import (
    COLOURS,
    FAINT,
    INK,
    WIDTH,
    colour,
    legend_below,
    log_axis,
    marker,
    pretty,
    sheet,
    styled,
    title_text,
)

_RULES = ("D", "s", "^", "v", "P", "X", "o")


@dataclass(frozen=True, eq=False)
class DimensionPanel:
    """One noise level, or one estimator.

    Parameters
    ----------
    label : str
    dimensions : (n,) int array
    errors : mapping of str to (n,) array
        Relative errors found with each dimension, by name; choices are marked on the last, that of the hidden field.
    tails, inf_sup : (n,) arrays
        ε̂_n and β_n; zero where the space is not seen.
    chosen : mapping of str to int
        The dimension that each rule takes.
    bound : (n,) array, optional
        What a rule minimises; ε̂_n/β_n by default.
    """

    label: str
    dimensions: IntArray
    errors: Mapping[str, Array]
    tails: Array
    inf_sup: Array
    chosen: Mapping[str, int] = field(default_factory=dict)
    bound: Array | None = None

    def __post_init__(self) -> None:
        wanted = np.shape(self.dimensions)
        series = {"tails": self.tails, "β": self.inf_sup, **self.errors}
        if self.bound is not None:
            series["bound"] = self.bound
        for name, values in series.items():
            if np.shape(values) != wanted:
                raise ShapeError(
                    f"{name} of {self.label!r}: got shape {np.shape(values)}, expected {wanted} as the dimensions"
                )
        if not self.errors:
            raise ShapeError(f"errors of {self.label!r}: got none, expected at least one")
        for rule, n in self.chosen.items():
            if n not in self.dimensions:
                raise ShapeError(f"{rule} of {self.label!r}: chose {n}, which is not among the dimensions given")

    @property
    def curve(self) -> Array:
        """The bound (n,), NaN where it is infinite."""
        if self.bound is not None:
            values = np.asarray(self.bound, dtype=np.float64)
            return np.where(np.isfinite(values), values, np.nan)
        beta = np.asarray(self.inf_sup, dtype=np.float64)
        return np.asarray(np.divide(self.tails, beta, out=np.full(beta.shape, np.nan), where=beta > 0))


@styled
def dimension(panels: Sequence[DimensionPanel], caption: str = "") -> Figure:
    """Draw errors above ε̂_n, β_n and the bound, a column a noise level, with each rule's choice.

    Choices are marked on the curve of the last error, whose least value has a star.

    Parameters
    ----------
    panels : sequence of DimensionPanel
    caption : str
    """
    if not panels:
        raise ShapeError("dimension: got no panel, expected at least one")
    columns = len(panels)
    figure, grid = sheet(
        2, columns, 5.6, caption, width=WIDTH if columns > 1 else 6.0, sharex="col", sharey="row",
        height_ratios=(1.25, 1.0),
    )  # fmt: skip
    rules = list(dict.fromkeys(rule for panel in panels for rule in panel.chosen))
    names = list(dict.fromkeys(name for panel in panels for name in panel.errors))
    for column, panel in enumerate(panels):
        _errors(grid[0, column], panel, names, rules)
        _bound(grid[1, column], panel)
        grid[0, column].set_title(title_text(panel.label))
        grid[1, column].set_xlabel("dimension $n$")
        grid[1, column].xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
    grid[0, 0].set_ylabel("relative error  [%]")
    grid[1, 0].set_ylabel(r"$\beta_n$, $\hat{\varepsilon}_n$, bound  [–]")
    legend_below(figure, list(grid.flat))
    return figure


def _errors(axes: Axes, panel: DimensionPanel, names: Sequence[str], rules: Sequence[str]) -> None:
    log_axis(axes, plain=True)
    n = np.asarray(panel.dimensions)
    for name, values in panel.errors.items():
        index = names.index(name)
        shown = 100 * np.asarray(values, dtype=np.float64)
        axes.plot(n, np.where(shown > 0, shown, np.nan), color=colour(index), label=pretty(name))
    judged, values = list(panel.errors.items())[-1]
    shown = 100 * np.asarray(values, dtype=np.float64)
    best = int(np.nanargmin(shown))
    axes.plot(
        n[best], shown[best], "*", markersize=14, color=colour(names.index(judged)), markeredgecolor="white", zorder=4,
        linestyle="none", label=f"least {pretty(judged)}",
    )  # fmt: skip
    for rule, chosen in panel.chosen.items():
        place = int(np.flatnonzero(n == chosen)[0])
        axes.plot(
            chosen, shown[place], _RULES[rules.index(rule) % len(_RULES)], markersize=7.5, markerfacecolor="none",
            markeredgecolor=INK, markeredgewidth=1.2, zorder=5, linestyle="none", label=pretty(rule),
        )  # fmt: skip
        axes.axvline(chosen, color=FAINT, linewidth=0.6, linestyle=(0, (2, 3)), zorder=0)


def _bound(axes: Axes, panel: DimensionPanel) -> None:
    log_axis(axes)
    n = np.asarray(panel.dimensions)
    every = max(1, len(n) // 10)
    series = (
        (r"stability $\beta_n$", panel.inf_sup, COLOURS[4], marker(1)),
        (r"tail $\hat{\varepsilon}_n$", panel.tails, COLOURS[5], marker(2)),
        ("bound", panel.curve, INK, ""),
    )
    for label, values, shade, mark in series:
        given = np.asarray(values, dtype=np.float64)
        axes.plot(
            n, np.where(given > 0, given, np.nan), color=shade, marker=mark, markevery=every, markersize=4,
            linewidth=1.3, label=label,
        )  # fmt: skip
    for chosen in panel.chosen.values():
        axes.axvline(chosen, color=FAINT, linewidth=0.6, linestyle=(0, (2, 3)), zorder=0)
