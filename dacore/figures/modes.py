"""The first modes of a background space on a slice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError
from dacore.figures.slices import Scale, View, bar, dress, paint, panel_height, slab_legend
from dacore.figures.style import DIVERGING, SEQUENTIAL, WIDTH, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class ModeField:
    """One field of the modes at the points of the cut.

    Parameters
    ----------
    name : str
        "u" or "p".
    values : (n, c, q) array
        Of n modes with c components. One component is shown with its sign; several as their
        length, with arrows of the part in the plane.
    """

    name: str
    values: Array

    def __post_init__(self) -> None:
        if np.ndim(self.values) != 3:
            raise ShapeError(f"modes of {self.name!r}: got shape {np.shape(self.values)}, expected (n, c, q)")


@styled
def modes(
    view: View, fields: Sequence[ModeField], caption: str = "", labels: Sequence[str] = (), arrows: int = 9
) -> Figure:
    """Draw a column for each mode and a row for each field; each panel is scaled to at most 1.

    A mode has no amplitude of its own (its norm is one, its sign arbitrary), so only its shape is shown.

    Parameters
    ----------
    view : View
    fields : sequence of ModeField
        All with the same number of modes.
    caption : str
    labels : sequence of str, optional
        Titles of the columns; "mode i" by default.
    arrows : int
        Arrows along the longer side of the slice.
    """
    count = len(fields[0].values)
    for each in fields:
        if len(each.values) != count or each.values.shape[2] != len(view.cut.points):
            raise ShapeError(
                f"modes of {each.name!r}: got shape {each.values.shape}, "
                f"expected ({count}, any, {len(view.cut.points)})"
            )
    height = panel_height(view, (WIDTH - 1.3) / count) * len(fields) + 0.7
    figure, grid = sheet(len(fields), count, height, caption or view.title, layout="compressed")
    for row, each in enumerate(fields):
        vector = each.values.shape[1] > 1
        colours = Scale(0.0, 1.0, SEQUENTIAL) if vector else Scale(-1.0, 1.0, DIVERGING)
        for column in range(count):
            axes = grid[row, column]
            values = np.asarray(each.values[column], dtype=np.float64)
            shown = np.linalg.norm(values, axis=0) if vector else values[0]
            size = float(np.abs(shown).max()) or 1.0
            paint(axes, view, shown / size, colours)
            if vector:
                _arrows(axes, view, values / size, arrows)
            if row == 0:
                axes.set_title(pretty(labels[column]) if labels else f"mode {column + 1}")
            dress(axes, view, left=column == 0, bottom=row == len(fields) - 1)
        name = f"|{each.name}|" if vector else each.name
        bar(figure, grid[row], colours, f"{pretty(name)}, scaled  [–]")
    slab_legend(figure, view)
    return figure


def _arrows(axes: Axes, view: View, values: Array, count: int) -> None:
    """Draw the in-plane part of vectors (c, q) at about `count` places along the slice's longer side."""
    chosen = thin(view.cut.points, count)
    first, second = view.cut.axes
    if max(first, second) >= len(values):
        return
    axes.quiver(
        *view.cut.points[chosen].T, values[first, chosen], values[second, chosen],
        color="white", edgecolor="#00000055", linewidth=0.3, pivot="mid", angles="xy", scale_units="width",
        scale=1.1 * count, width=0.008, headwidth=3.6, headlength=4.2, headaxislength=3.8, minlength=0.4, zorder=3,
    )  # fmt: skip


def thin(points: Array, count: int) -> IntArray:
    """Choose points (q, 2) that are spread evenly: in each square of a grid, the one nearest its centre."""
    low, size = points.min(axis=0), float(np.ptp(points, axis=0).max()) / count
    square = np.floor((points - low) / size).astype(np.int64)
    offset = np.linalg.norm(points - (low + (square + 0.5) * size), axis=1)
    order = np.argsort(offset, kind="stable")
    order = order[offset[order] < 0.35 * size]
    code = square[order, 0] * (int(square.max()) + 1) + square[order, 1]
    _, first = np.unique(code, return_index=True)
    return np.asarray(order[np.sort(first)])
