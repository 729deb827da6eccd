"""Truth, reconstruction, difference and standard deviation of fields on a slice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.slices import Scale, View, bar, dress, paint, panel_height, scale, slab_legend
from dacore.figures.style import INK, SPREAD, WIDTH, pretty, sheet, styled


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
    difference has its own symmetric one, so that the structure of small errors shows.

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
    for axes, title in zip(grid[0], titles):
        axes.set_title(title)
    for index, row in enumerate(rows):
        last = index == len(rows) - 1
        shared = _shared_scale(rows, row)
        paint(grid[index, 0], view, row.truth, shared)
        paint(grid[index, 1], view, row.estimate, shared)
        bar(figure, grid[index, :2], shared, shared.label(row.name, row.unit), (row.truth, row.estimate))
        sign = row.difference is None or bool((row.difference < 0).any())
        gap = scale(row.error, signed=sign, colours=None if sign else SPREAD)
        paint(grid[index, 2], view, row.error, gap)
        symbol = f"Δ{_bracketed(row.name)}" if row.difference is None else f"|Δ{row.name.strip('|')}|"
        bar(figure, grid[index, 2:3], gap, gap.label(symbol, row.unit))
        shown = grid[index, :3]
        if row.deviation is not None:
            width = scale(row.deviation, signed=False, colours=SPREAD)
            paint(grid[index, 3], view, row.deviation, width)
            bar(figure, grid[index, 3:4], width, width.label("std", row.unit))
            shown = grid[index]
        elif spread:
            grid[index, 3].set_visible(False)
        for column, axes in enumerate(shown):
            dress(axes, view, left=column == 0, bottom=last)
        if row.label:
            grid[index, 1].text(
                0.5, 1.01, pretty(row.label), transform=grid[index, 1].transAxes, ha="center", va="bottom",
                fontsize=8, color=INK,
            )  # fmt: skip
            if index == 0:
                grid[0, 1].set_title(titles[1], pad=14)
    slab_legend(figure, view)
    return figure


def _bracketed(name: str) -> str:
    return f"({name})" if " " in name else name


def _shared_scale(rows: Sequence[Compared], row: Compared) -> Scale:
    """Scale of the truths of one name: a poor estimate saturates instead of hiding the truth."""
    same = [other for other in rows if other.name == row.name]
    signed = next((other.signed for other in same if other.signed is not None), None)
    return scale(*[other.truth for other in same], signed=signed)
