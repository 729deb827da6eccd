"""The a-priori bound ε̂_n/β_n, the dimension it chooses, and the errors that were measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError
from dacore.figures.style import COLOURS, FAINT, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class BoundCurve:
    """What decides the dimension of one background space.

    Parameters
    ----------
    label : str
    dimensions : (n,) int array
    tails : (n,) array
        ε̂_n.
    inf_sup : (n,) array
        β_n; zero where the space is not seen.
    chosen : int, optional
        The dimension in use.
    measured : mapping of str to (n,) array
        Relative errors found with each dimension, by name.
    """

    label: str
    dimensions: IntArray
    tails: Array
    inf_sup: Array
    chosen: int | None = None
    measured: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        wanted = np.shape(self.dimensions)
        series = {"tails": self.tails, "β": self.inf_sup, **self.measured}
        for name, values in series.items():
            if np.shape(values) != wanted:
                raise ShapeError(
                    f"{name} of {self.label!r}: got shape {np.shape(values)}, expected {wanted} as the dimensions"
                )
        if self.chosen is not None and self.chosen not in self.dimensions:
            raise ShapeError(f"chosen dimension of {self.label!r}: {self.chosen} is not among the dimensions given")

    @property
    def bound(self) -> Array:
        """ε̂_n/β_n, infinite where β_n is zero."""
        beta = np.asarray(self.inf_sup, dtype=np.float64)
        return np.where(beta > 0, self.tails / np.where(beta > 0, beta, 1.0), np.inf)


@styled
def bound(curves: Sequence[BoundCurve], caption: str = "") -> Figure:
    """Draw ε̂_n/β_n against n, one panel a space, with the chosen n and measured errors."""
    columns = min(len(curves), 3)
    rows = -(-len(curves) // columns)
    width = 9.0 if columns > 1 else 7.0
    figure, grid = sheet(rows, columns, 3.1 * rows + 0.5, caption, width=width, sharey=True)
    for axes in grid.flat[len(curves) :]:
        axes.set_visible(False)
    for axes, curve in zip(grid.flat, curves):
        log_axis(axes)
        n = np.asarray(curve.dimensions)
        values = curve.bound
        axes.plot(
            n,
            np.where(np.isfinite(values) & (values > 0), values, np.nan),
            color=COLOURS[0],
            label=r"bound $\hat{\varepsilon}_n\,/\,\beta_n$",
        )
        tails = np.asarray(curve.tails)
        axes.plot(
            n,
            np.where(tails > 0, tails, np.nan),
            color=FAINT,
            linewidth=1.1,
            linestyle=":",
            label=r"tail $\hat{\varepsilon}_n$",
        )
        for index, (name, errors) in enumerate(curve.measured.items(), start=1):
            axes.plot(
                n, errors, color=colour(index), linewidth=1.2, marker=marker(index), markersize=4, label=pretty(name),
                markevery=max(1, len(n) // 12),
            )  # fmt: skip
        if curve.chosen is not None:
            height = float(values[n == curve.chosen][0])
            axes.axvline(curve.chosen, color=COLOURS[0], linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
            axes.plot([curve.chosen], [height], marker="*", markersize=13, color=COLOURS[0], markeredgecolor="white")
            axes.annotate(
                f"$n$ = {curve.chosen}", (curve.chosen, 1.0), xycoords=("data", "axes fraction"),
                xytext=(4 if curve.chosen < 0.75 * n.max() else -4, -2), textcoords="offset points",
                ha="left" if curve.chosen < 0.75 * n.max() else "right", va="top", color=COLOURS[0], fontsize=8.5,
            )  # fmt: skip
        axes.set_title(pretty(curve.label))
        axes.set_xlabel("dimension $n$")
    for axes in grid[:, 0]:
        axes.set_ylabel("relative error  [–]")
    legend_below(figure, list(grid.flat))
    return figure
