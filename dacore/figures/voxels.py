"""The measured voxels of one slice, component by component."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dacore.core.arrays import Array, BoolArray
from dacore.errors import ShapeError
from dacore.figures.slices import Scale, View, bar, dress, outline, panel_height, scale
from dacore.figures.style import WIDTH, pretty, sheet, styled

# No diverging or sequential map in use contains this grey.
_MISSING = "#B9B9B9"


@styled
def measured_slice(
    view: View,
    centres: Array,
    directions: Array,
    spacing: Sequence[float],
    values: Mapping[str, Array],
    unit: str,
    name: str = "u",
    caption: str = "",
) -> Figure:
    """Draw voxel values as pixels over the outline of the domain, a column a component, a row a data set.

    Parameters
    ----------
    view : View
        A slice through the voxels.
    centres : (m, d) array [cm]
        Of the voxel of each value (`Functionals.centres`).
    directions : (m, d) array
        Measured direction of each value; zeros for a scalar field.
    spacing : sequence of float [cm]
        Edge lengths of a voxel.
    values : mapping of str to (m,) array
        For each row ("exact", "10 % noise"), the values; NaN where a voxel is missing.
    unit : str
        Of the values.
    name : str
        Of the field.
    caption : str
        Scene, mesh, case and time.

    Raises
    ------
    ShapeError
        If shapes disagree or no voxel meets the slice.
    """
    for row, data in values.items():
        if np.shape(data) != (len(centres),):
            raise ShapeError(f"values of {row!r}: got shape {np.shape(data)}, expected ({len(centres)},)")
    near = on_slice(view, centres, spacing)
    if not near.any():
        low, high = centres[:, view.cut.axis].min(), centres[:, view.cut.axis].max()
        raise ShapeError(f"{view.title}: no voxel meets this slice; their centres run from {low:g} to {high:g}")
    kinds, kind = np.unique(np.round(np.asarray(directions), 9), axis=0, return_inverse=True)
    kind = kind.reshape(-1)
    order = np.argsort([-int(np.argmax(np.abs(k))) for k in kinds], kind="stable")[::-1]
    height = panel_height(view, (WIDTH - 1.0) / max(3, len(kinds))) * len(values) + 1.3
    width = WIDTH if len(kinds) > 2 else 1.5 + (WIDTH - 1.0) / 3 * len(kinds)
    figure, grid = sheet(len(values), len(kinds), height, caption or view.title, width=width, layout="compressed")
    for column, which in enumerate(order):
        mine = near & (kind == which)
        component = component_name(name, kinds[which], view.frame.names)
        first = np.asarray(next(iter(values.values())))[mine]
        shared = scale(first, signed=True if np.any(kinds[which]) else None)
        for place, (label, data) in enumerate(values.items()):
            axes = grid[place, column]
            outline(axes, view)
            pixels(axes, view, centres[mine], spacing, np.asarray(data)[mine], shared)
            dress(axes, view, left=column == 0, bottom=place == len(values) - 1)
            if place == 0:
                axes.set_title(f"{pretty(component)}")
            if column == 0:
                axes.set_ylabel(f"{pretty(label)}\n{axes.get_ylabel()}")
        known = [np.asarray(data)[mine] for data in values.values() if np.isfinite(np.asarray(data)[mine]).any()]
        bar(
            figure, grid[:, column], shared, shared.label(component, unit), known, location="bottom", fraction=0.04,
            pad=0.02,
        )  # fmt: skip
    if any(np.isnan(np.asarray(data)[near]).any() for data in values.values()):
        figure.legend(
            handles=[Patch(facecolor=_MISSING, edgecolor="white", label="missing")], loc="outside lower center"
        )  # fmt: skip
    return figure


def on_slice(view: View, centres: Array, spacing: Sequence[float]) -> BoolArray:
    """Which voxels (m,) the plane of the view passes through."""
    if centres.shape[1] == 2:
        return np.ones(len(centres), dtype=bool)
    distance = np.abs(centres[:, view.cut.axis] - view.cut.value)
    return np.asarray(distance <= 0.5 * spacing[view.cut.axis] * (1.0 + 1e-9))


def pixels(
    axes: Axes, view: View, centres: Array, spacing: Sequence[float], values: Array, colours: Scale
) -> None:  # fmt: skip
    """Draw values (m,) as rectangles of the voxels' size at their centres (m, d); NaN is grey.

    Call it after `outline`: voxels that reach past the domain widen the view.
    """
    first, second = view.cut.axes
    known = np.isfinite(values)
    half = 0.5 * np.array([spacing[first], spacing[second]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    squares = PolyCollection(
        list(centres[known][:, None, [first, second]] + corners),
        array=values[known] / 10.0**colours.power,
        cmap=colours.colours,
        norm=colours.norm,
        edgecolors="white",
        linewidths=0.35,
    )
    axes.add_collection(squares)
    missing = centres[~known][:, None, [first, second]] + corners
    axes.add_collection(PolyCollection(list(missing), facecolors=_MISSING, edgecolors="white", linewidths=0.35))
    low = np.minimum((centres[:, [first, second]] - 1.05 * half).min(axis=0), [axes.get_xlim()[0], axes.get_ylim()[0]])
    high = np.maximum((centres[:, [first, second]] + 1.05 * half).max(axis=0), [axes.get_xlim()[1], axes.get_ylim()[1]])
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def component_name(name: str, direction: Array, axes: Sequence[str]) -> str:
    """Name of a measured component: u_y, or u·(0.6, 0.8, 0) off the axes; the field's own if scalar."""
    if not np.any(direction):
        return name
    main = int(np.argmax(np.abs(direction)))
    if np.isclose(direction[main], 1.0) and np.count_nonzero(np.round(direction, 6)) == 1:
        return f"{name}_{axes[main]}"
    return f"{name}·({', '.join(f'{d:.2g}' for d in direction)})"
