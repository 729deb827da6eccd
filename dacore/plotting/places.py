"""Where things are: a mesh with its boundary, and what is measured of it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from dacore.core.arrays import Array, IntArray
from dacore.core.display import unit_text
from dacore.core.mesh import Mesh
from dacore.core.observation import Functionals
from dacore.core.simplex import local_edges
from dacore.errors import CapabilityError, ShapeError
from dacore.figures.slices import Scale, View, bar, dress, outline, scale
from dacore.figures.style import FAINT, INK, colour, look, pretty
from dacore.plotting.axes import axes_for, figure_of
from dacore.plotting.subject import Axis, Subject, axis_number, mesh_of, space_of, view_of
from dacore.workflow.session import Session

_WIDTH = 4.2
# A direction counts as in the plane up to this sine of the angle.
_FLAT = 0.1
# No colour map in use contains this grey.
_MISSING = "#B9B9B9"


def plot_mesh(subject: Subject | Mesh, axis: Axis = "x", position: float | None = None, ax: Axes | None = None) -> Axes:
    """Draw a mesh on a plane, its boundary coloured by role.

    Parameters
    ----------
    subject : Session, Mesh, or whatever lives on a mesh
    axis : {"x", "y", "z"}
        Normal of the plane; a planar mesh is shown whole.
    position : float, optional [cm]
        Where the plane is; the middle of the mesh by default.
    ax : Axes, optional
        Where to draw; a figure of its own by default.

    Returns
    -------
    Axes

    Raises
    ------
    CapabilityError
        If there is no mesh.
    ShapeError
        If the plane misses it.
    """
    mesh = mesh_of(subject)
    view = view_of(mesh.points, mesh.cells, axis, position)
    with look():
        drawn = axes_for(ax, _WIDTH, _height(view))
        outline(drawn, view, alpha=0.0)
        drawn.add_collection(LineCollection(list(_cell_edges(view)), colors=FAINT, linewidths=0.4, zorder=1))
        for index, role in enumerate(mesh.roles):
            lines = _boundary(mesh, role, view)
            if len(lines):
                drawn.add_collection(
                    LineCollection(list(lines), colors=colour(index), linewidths=2.2, label=pretty(role), zorder=2)
                )
        dress(drawn, view, left=True, bottom=True)
        what = "planar mesh" if mesh.dim == 2 else view.title
        drawn.set_title(f"{what}: {len(mesh.points):,} nodes")
        drawn.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title="boundary")
    return drawn


def plot_sensors(
    subject: Session | Functionals,
    space: Subject | None = None,
    axis: Axis | None = None,
    ax: Axes | None = None,
    *,
    values: Array | None = None,
) -> Axes:
    """Draw where and in which direction is measured, seen along an axis over the outline of the domain.

    Parameters
    ----------
    subject : Session or Functionals
    space : Session, ForwardModel, Background, Estimate or StateSpace, optional
        Whose outline is drawn behind functionals.
    axis : {"x", "y", "z"}, optional
        Along which they are seen; the one that they spread least along by default.
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    values : (m,) array, optional [unit of the functionals]
        What was measured at one step; colours each place by the length of what was measured there, grey for NaN.

    Returns
    -------
    Axes

    Raises
    ------
    CapabilityError
        If the functionals have no places in a plane or in space.
    ShapeError
        If there is not one value for each functional.
    """
    functionals = subject.functionals if isinstance(subject, Session) else subject
    around = subject if space is None and isinstance(subject, Session) else space
    centres = np.asarray(functionals.centres)
    if centres.ndim != 2 or centres.shape[1] not in (2, 3):
        raise CapabilityError("functionals: have no places in a plane or in space, so there is nothing to draw")
    if values is not None and np.shape(values) != (functionals.count,):
        raise ShapeError(f"values: got shape {np.shape(values)}, expected ({functionals.count},), one a functional")
    normal = 2 if centres.shape[1] == 2 else _normal(centres, axis)
    plane = [k for k in range(3) if k != normal]
    _, first = np.unique(functionals.sites, return_index=True)
    with look():
        view = _view(around, normal, float(np.median(centres[first, normal])) if centres.shape[1] == 3 else 0.0)
        drawn = axes_for(ax, _WIDTH, _height(view) if view is not None else _WIDTH)
        if view is not None:
            outline(drawn, view)
        size = None if values is None else _sizes(functionals, np.asarray(values), first)
        colours = scale(size, signed=False) if size is not None else None
        _places(drawn, functionals, centres[first][:, plane], plane, size, colours)
        _arrows(drawn, functionals, centres, plane)
        drawn.set_aspect("equal")
        drawn.autoscale_view()
        names = "xyz"
        drawn.set(xlabel=f"{names[plane[0]]} [cm]", ylabel=f"{names[plane[1]]} [cm]")
        kind = "voxels" if functionals.spacing else "places"
        drawn.set_title(f"{functionals.count} values at {len(first)} {kind}", pad=8)
        if colours is not None and size is not None:
            bar(figure_of(drawn), [drawn], colours, colours.label("measured", unit_text(functionals.unit)), (size,))
        if drawn.get_legend_handles_labels()[1]:
            drawn.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    return drawn


def _height(view: View) -> float:
    return 0.8 + 0.75 * _WIDTH * float(np.clip(view.aspect, 0.3, 2.0))


def _cell_edges(view: View) -> Array:
    """Line segments (e, 2, 2) where cells meet on a cut: sides of its triangles that are not inside one cell."""
    cut = view.cut
    sides = np.sort(cut.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owners = np.repeat(cut.triangle_cells, 3)
    unique, inverse = np.unique(sides, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    low, high = np.full(len(unique), np.iinfo(np.int64).max), np.full(len(unique), -1)
    np.minimum.at(low, inverse, owners)
    np.maximum.at(high, inverse, owners)
    once = np.bincount(inverse, minlength=len(unique)) == 1
    return np.asarray(cut.points[unique[(low != high) | once]])


def _boundary(mesh: Mesh, role: str, view: View) -> Array:
    """Line segments (e, 2, 2) of the boundary `role` on a view."""
    facets: IntArray = mesh.boundary_facets(role)
    if mesh.dim == 2:
        return np.asarray(mesh.points[facets])
    axis, value = view.cut.axis, view.cut.value
    height = mesh.points[:, axis] - value
    # Exactly in the plane counts as above it, so that every facet is crossed twice or not at all.
    above = height >= 0.0
    pairs = np.array(local_edges(2))
    ends = facets[:, pairs]
    crossed = above[ends[..., 0]] != above[ends[..., 1]]
    ends = ends[crossed.sum(axis=1) == 2][crossed[crossed.sum(axis=1) == 2]].reshape(-1, 2, 2)
    low, high = ends[..., 0], ends[..., 1]
    share = (height[low] / (height[low] - height[high]))[..., None]
    places = (1.0 - share) * mesh.points[low] + share * mesh.points[high]
    return np.asarray(places[..., list(view.cut.axes)])


def _normal(centres: Array, axis: str | None) -> int:
    return int(np.argmin(np.ptp(centres, axis=0))) if axis is None else axis_number(axis, 3)


def _view(around: Subject | None, normal: int, position: float) -> View | None:
    """Outline behind the places; none where the space has no cells or the plane misses it."""
    if around is None:
        return None
    space = space_of(around)
    if "cells" not in space.capabilities:
        return None
    geometry = space.cells()
    low, high = geometry.points.min(axis=0), geometry.points.max(axis=0)
    if geometry.points.shape[1] == 3 and not low[normal] < position < high[normal]:
        position = float(0.5 * (low[normal] + high[normal]))
    return view_of(geometry.points, geometry.cells, "xyz"[normal], position)


def _sizes(functionals: Functionals, values: Array, first: IntArray) -> Array:
    """Length of what was measured at each place."""
    _, place = np.unique(functionals.sites, return_inverse=True)
    vector = bool(np.any(functionals.directions))
    if not vector:
        return np.asarray(values[first])
    return np.asarray(np.sqrt(np.bincount(place.reshape(-1), values**2, minlength=len(first))))


def _places(
    ax: Axes, functionals: Functionals, places: Array, plane: list[int], size: Array | None, colours: Scale | None
) -> None:
    shown: dict[str, Any] = {}
    if size is not None and colours is not None:
        shown = {"array": size / 10.0**colours.power, "cmap": colours.colours, "norm": colours.norm}
    if functionals.spacing:
        half = 0.5 * np.asarray(functionals.spacing)[plane]
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        squares: Any = shown or {"facecolors": "#CFE3F1"}
        known = np.ones(len(places), dtype=bool) if size is None else np.isfinite(size)
        if shown:
            squares = shown | {"array": shown["array"][known]}
        for mine, look_of in ((known, squares), (~known, {"facecolors": _MISSING})):
            boxes = list(places[mine][:, None] + corners)
            ax.add_collection(PolyCollection(boxes, edgecolors="white", linewidths=0.5, zorder=1, **look_of))
        return
    dots: Any = {"c": shown["array"], "cmap": shown["cmap"], "norm": shown["norm"]} if shown else {"color": colour(0)}
    ax.scatter(places[:, 0], places[:, 1], s=26, edgecolors="white", linewidths=0.5, zorder=3, **dots)


def _arrows(ax: Axes, functionals: Functionals, centres: Array, plane: list[int]) -> None:
    """Arrows in the plane for directions that are measured, rings for those along the line of sight."""
    directions = np.asarray(functionals.directions, dtype=np.float64)
    if not directions.any():
        return
    flat = directions[:, plane]
    across = np.linalg.norm(flat, axis=1) < _FLAT
    reach = np.ptp(centres[:, plane], axis=0).max() or 1.0
    length = 0.4 * min(np.asarray(functionals.spacing)[plane]) if functionals.spacing else 0.07 * reach
    place = centres[:, plane]
    ax.quiver(
        place[~across, 0], place[~across, 1], length * flat[~across, 0], length * flat[~across, 1], angles="xy",
        scale_units="xy", scale=1.0, color=INK, width=0.0035, headwidth=4.0, zorder=4,
    )  # fmt: skip
    if across.any():
        ax.scatter(
            place[across, 0], place[across, 1], s=16, facecolors="none", edgecolors=INK, linewidths=0.7, zorder=4,
            label="measured along the line of sight",
        )  # fmt: skip
