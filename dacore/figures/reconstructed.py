"""Reconstructed fields and what is claimed of their error, where no truth is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.slices import View, bar, dress, paint, panel_height, scale, slab_legend
from dacore.figures.style import SPREAD, WIDTH, sheet, styled


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """One field at the points of the cut.

    Parameters
    ----------
    name, unit : str
        Of what is shown ("|u|", "p").
    mean : (q,) array
    deviation : (q,) array, optional
        Standard deviation.
    """

    name: str
    unit: str
    mean: Array
    deviation: Array | None = None


@styled
def reconstructed(view: View, fields: Sequence[Reconstructed], caption: str = "") -> Figure:
    """Draw a row of panels for each field: the estimate, and its standard deviation if there is one.

    Parameters
    ----------
    view : View
    fields : sequence of Reconstructed
    caption : str
        Scene, data and time.

    Raises
    ------
    ShapeError
        If values are not one a point of the cut.
    """
    for each in fields:
        for what, values in (("mean", each.mean), ("deviation", each.deviation)):
            if values is not None and np.shape(values) != (len(view.cut.points),):
                raise ShapeError(
                    f"{what} of {each.name!r}: got shape {np.shape(values)}, expected ({len(view.cut.points)},), "
                    "one value a point of the cut"
                )
    columns = 2 if any(each.deviation is not None for each in fields) else 1
    width = WIDTH * (0.78 if columns == 2 else 0.5)
    height = panel_height(view, (width - 1.8) / columns) * len(fields) + 0.7
    figure, grid = sheet(len(fields), columns, height, caption or view.title, width=width, layout="compressed")
    for column, title in zip(range(columns), ("reconstruction", "standard deviation")):
        grid[0, column].set_title(title)
    for index, each in enumerate(fields):
        last = index == len(fields) - 1
        shown = scale(each.mean)
        paint(grid[index, 0], view, each.mean, shown)
        bar(figure, grid[index, :1], shown, shown.label(each.name, each.unit))
        dress(grid[index, 0], view, left=True, bottom=last)
        if each.deviation is not None:
            spread = scale(each.deviation, signed=False, colours=SPREAD)
            paint(grid[index, 1], view, each.deviation, spread)
            bar(figure, grid[index, 1:2], spread, spread.label(f"std of {each.name}", each.unit))
            dress(grid[index, 1], view, left=False, bottom=last)
        elif columns == 2:
            grid[index, 1].set_visible(False)
    slab_legend(figure, view)
    return figure
