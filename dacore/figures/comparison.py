"""Truth, reconstruction, difference and standard deviation of fields on a slice."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.slices import Scale, View, bar, dress, paint, panel_height, scale, slab_legend
from dacore.figures.style import INK, SPREAD, WIDTH, pretty, sheet, styled

# Beyond this many times the largest error, a deviation goes off the scale.
_MOST = 3.0


@dataclass(frozen=True, eq=False)
class Compared:
    """One row: a field as it is and as one estimator sees it, at the points of the cut.

    Parameters
    ----------
    name : str
        Of what is shown ("|u|", "p − p_csf"); rows of one name share their colour scale.
    unit : str
    truth, estimate : (q,) arrays
    deviation : (q,) array, optional
        Standard deviation of the estimate.
    difference : (q,) array, optional
        Shown instead of estimate − truth, for instance |u* − u| of a vector.
    inside : float, optional
        Share of the errors that are within two standard deviations.
    label : str
        Of the estimator.
    signed : bool, optional
        Whether the scale is about zero; by default, if both signs occur.
    """

    name: str
    unit: str
    truth: Array
    estimate: Array
    deviation: Array | None = None
    difference: Array | None = None
    inside: float | None = None
    label: str = ""
    signed: bool | None = None

    @property
    def error(self) -> Array:
        """What the column of differences shows (q,)."""
        return np.asarray(self.estimate - self.truth) if self.difference is None else self.difference


@styled
def comparison(view: View, rows: Sequence[Compared], caption: str = "") -> Figure:
    """Draw a row of panels for each field and estimator.

    Truth and reconstruction share a scale, fixed by the truth of all rows of that name; each
    difference has its own symmetric one, so that the structure of small errors shows. A standard deviation
    has the scale of the difference's size: what is claimed and what is wrong can be compared by eye.

    Parameters
    ----------
    view : View
    rows : sequence of Compared
    caption : str
        Scene, mesh, scheme, case and time.
    """
    for row in rows:
        for what, values in (("truth", row.truth), ("estimate", row.estimate), ("deviation", row.deviation)):
            if values is not None and np.shape(values) != (len(view.cut.points),):
                raise ShapeError(
                    f"{what} of {row.name!r}: got shape {np.shape(values)}, expected ({len(view.cut.points)},), "
                    "one value a point of the cut"
                )
    spread = any(row.deviation is not None for row in rows)
    columns = 4 if spread else 3
    height = panel_height(view, (WIDTH - 2.3) / columns) * len(rows) + 0.8
    figure, grid = sheet(len(rows), columns, height, caption or view.title, layout="compressed")
    titles = ["truth", "reconstruction", "difference", "standard deviation"]
    lines = max((len(wrap(row.label, 30)) for row in rows[:1]), default=0)
    noted = lines or any(row.inside is not None for row in rows[:1])
    for axes, title in zip(grid[0], titles):
        axes.set_title(title, pad=4 + 10 * max(lines, 1) if noted else None)
    for index, row in enumerate(rows):
        last = index == len(rows) - 1
        shared = _shared_scale(rows, row)
        paint(grid[index, 0], view, row.truth, shared)
        paint(grid[index, 1], view, row.estimate, shared)
        bar(figure, grid[index, :2], shared, shared.label(row.name, row.unit), (row.truth, row.estimate))
        sign = row.difference is None or bool((row.difference < 0).any())
        gap = _gap(row, sign)
        paint(grid[index, 2], view, row.error, gap)
        symbol = f"Δ{_bracketed(row.name)}" if row.difference is None else f"|Δ{row.name.strip('|')}|"
        bar(figure, grid[index, 2:3], gap, gap.label(symbol, row.unit), (row.error,))
        shown = grid[index, :3]
        if row.deviation is not None:
            width = replace(gap, low=0.0, colours=SPREAD)
            paint(grid[index, 3], view, row.deviation, width)
            bar(figure, grid[index, 3:4], width, width.label("std", row.unit), (row.deviation,))
            if row.inside is not None:
                _above(grid[index, 3], f"{100 * row.inside:.0f}% of errors within 2 std")
            shown = grid[index]
        elif spread:
            grid[index, 3].set_visible(False)
        for column, axes in enumerate(shown):
            dress(axes, view, left=column == 0, bottom=last)
        if row.label:
            _above(grid[index, 1], "\n".join(wrap(row.label, 30)))
    slab_legend(figure, view)
    return figure


def _above(axes: Axes, text: str) -> None:
    axes.text(0.5, 1.01, pretty(text), transform=axes.transAxes, ha="center", va="bottom", fontsize=8, color=INK)


def _gap(row: Compared, signed: bool) -> Scale:
    """Scale of the difference; one that holds the deviation too, as far as the errors can still be told apart."""
    own = scale(row.error, signed=signed, colours=None if signed else SPREAD)
    if row.deviation is None:
        return own
    size = max(own.size, min(float(np.nanmax(row.deviation)), _MOST * own.size))
    return replace(own, low=-size if signed else 0.0, high=size)


def _bracketed(name: str) -> str:
    return f"({name})" if " " in name else name


def _shared_scale(rows: Sequence[Compared], row: Compared) -> Scale:
    """Scale of the truths of one name: a poor estimate saturates instead of hiding the truth."""
    same = [other for other in rows if other.name == row.name]
    signed = next((other.signed for other in same if other.signed is not None), None)
    return scale(*[other.truth for other in same], signed=signed)
