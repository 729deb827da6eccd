"""Where it is drawn: into axes that are given, or into a figure of its own."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dacore.errors import ShapeError

AxesArray: TypeAlias = NDArray[Any]


def axes_for(ax: Axes | None, width: float, height: float) -> Axes:
    """Return `ax`, or the axes of a new figure of pyplot, which a notebook shows by itself.

    Parameters
    ----------
    ax : Axes or None
    width, height : float [in]
        Of a new figure.
    """
    if ax is not None:
        if not isinstance(ax, Axes):
            raise ShapeError(f"ax: got {type(ax).__name__}, expected matplotlib's Axes; of several, take one")
        return ax
    return row_for(None, 1, width, height)[0]


def row_for(axes: Sequence[Axes] | AxesArray | None, count: int, width: float, height: float) -> list[Axes]:
    """Return the axes given, of which there must be `count`, or a row of them in a new figure.

    Parameters
    ----------
    axes : sequence of Axes or None
    count : int
    width, height : float [in]
        Of a new figure.
    """
    if axes is not None:
        given = list(np.ravel(np.asarray(axes, dtype=object)))
        if len(given) != count:
            raise ShapeError(f"axes: got {len(given)}, expected {count}")
        return given
    # Only pyplot's figures are shown by a notebook without being asked.
    from matplotlib import pyplot

    figure: Figure = pyplot.figure(figsize=(width, height), layout="constrained")
    return list(figure.subplots(1, count, squeeze=False)[0])


def figure_of(ax: Axes) -> Figure:
    """Return the figure that axes are in, of subfigures the whole one."""
    found = ax.get_figure()
    if found is None:
        raise ShapeError("ax: is in no figure any more; make new axes")
    return found if isinstance(found, Figure) else found.figure
