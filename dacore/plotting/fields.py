"""Fields on a plane: of a state, and of an estimate beside its deviation and the truth."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dacore.core.arrays import Array
from dacore.core.display import unit_text
from dacore.core.estimator import Estimate
from dacore.core.model import Trajectory
from dacore.core.timegrid import time_unit
from dacore.errors import ShapeError
from dacore.figures.slices import Scale, bar, dress, paint, scale
from dacore.figures.style import SPREAD, look, pretty
from dacore.plotting.axes import AxesArray, axes_for, figure_of, row_for
from dacore.plotting.subject import Axis, Subject, on_view, one_state, shown_part, slice_of, space_of

_WIDTH = 4.2


def plot_slice(
    subject: Subject,
    state: Array,
    field: str,
    component: int | Axis | None = None,
    axis: Axis = "x",
    position: float | None = None,
    ax: Axes | None = None,
    *,
    limits: tuple[float, float] | None = None,
    colorbar: bool = True,
) -> Axes:
    """Draw a field of one state on a plane.

    Parameters
    ----------
    subject : Session, ForwardModel, Background, Estimate or StateSpace
        Whose state it is.
    state : (n_dofs,) array
    field : str
    component : int or {"x", "y", "z"}, optional
        Of a vector field; its length by default.
    axis : {"x", "y", "z"}
        Normal of the plane; a planar domain is shown whole.
    position : float, optional [cm]
        Where the plane is; the middle of the domain by default.
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    limits : (float, float), optional [unit of the field]
        Ends of the colour scale; those of the values by default.
    colorbar : bool

    Returns
    -------
    Axes

    Raises
    ------
    CapabilityError
        If the state has no such field, or its space no cells.
    ShapeError
        If the state is none of the space, or the plane misses the domain.
    """
    space = space_of(subject)
    given = one_state(space, state)
    view = slice_of(space, field, axis, position)
    parts = space.layout.field(field).components
    values, name = shown_part((on_view(space, view, field) @ given).reshape(parts, -1), component, field)
    colours = scale(values, signed=False if name.startswith("|") else None)
    if limits is not None:
        colours = Scale(*limits, colours.colours)
    with look():
        drawn = axes_for(ax, _WIDTH, 0.8 + 0.75 * _WIDTH * float(np.clip(view.aspect, 0.3, 2.0)))
        paint(drawn, view, values, colours)
        dress(drawn, view, left=True, bottom=True)
        drawn.set_title(
            view.title if view.cut.point_cells.size and space.cells().points.shape[1] == 3 else pretty(name)
        )
        if colorbar:
            label = colours.label(name, unit_text(space.layout.field(field).unit))
            bar(figure_of(drawn), [drawn], colours, label, (values,))
    return drawn


def plot_estimate(
    estimate: Estimate,
    field: str,
    truth: Trajectory | Array | None = None,
    *,
    series: int = 0,
    time: float | None = None,
    component: int | Axis | None = None,
    axis: Axis = "x",
    position: float | None = None,
    axes: Sequence[Axes] | AxesArray | None = None,
) -> AxesArray:
    """Draw an estimated field on a plane, with its standard deviation, and the truth beside it.

    Parameters
    ----------
    estimate : Estimate
    field : str
    truth : Trajectory or (n_dofs,) array, optional
        A trajectory at all times of the background, or the state at the time that is shown.
    series : int
        Which series of the estimate.
    time : float, optional [s]
        The nearest time of the estimate is shown, and none beyond its ends; the middle one by default.
    component : int or {"x", "y", "z"}, optional
        Of a vector field; its length by default.
    axis : {"x", "y", "z"}
        Normal of the plane; a planar domain is shown whole.
    position : float, optional [cm]
        Where the plane is; the middle of the domain by default.
    axes : sequence of Axes, optional
        Where to draw, as many as there are pictures; a figure of its own by default.

    Returns
    -------
    (1 to 3,) array of Axes
        Truth where it is given, estimate, standard deviation where the estimate has one. Truth and estimate share
        a scale, that of the truth.

    Raises
    ------
    CapabilityError
        If the state has no such field, or its space no cells.
    ShapeError
        If the truth does not fit, the plane misses the domain, or the estimate holds no such time.
    """
    space = space_of(estimate)
    step = len(estimate.steps) // 2 if time is None else _step_at(estimate, time)
    if not 0 <= series < estimate.n_series:
        raise ShapeError(f"series: got {series}, expected 0 to {estimate.n_series - 1}")
    view = slice_of(space, field, axis, position)
    parts, unit = space.layout.field(field).components, unit_text(space.layout.field(field).unit)
    points = on_view(space, view, field)
    found, name = shown_part((points @ estimate.state(series, step)).reshape(parts, -1), component, field)
    panels: list[tuple[str, Array, Scale, str]] = []
    shared = found
    if truth is not None:
        state = one_state(space, _state_of(truth, estimate, step))
        shared, _ = shown_part((points @ state).reshape(parts, -1), component, field)
    colours = scale(shared, signed=False if name.startswith("|") else None)
    if truth is not None:
        panels.append(("truth", shared, colours, name))
    panels.append(("estimate", found, colours, name))
    if estimate.uncertainty is not None:
        spread = estimate.deviation(points, step, series).reshape(parts, -1)
        # Of a vector's length: the root of the sum of squares over the components.
        wide, _ = shown_part(spread, component, field)
        panels.append(("standard deviation", wide, scale(wide, signed=False, colours=SPREAD), "std"))
    with look():
        aspect = float(np.clip(view.aspect, 0.3, 2.0))
        row = row_for(axes, len(panels), 3.1 * len(panels), 3.1 * 0.75 * aspect + 0.9)
        for place, (ax, (title, values, colour_scale, label)) in enumerate(zip(row, panels, strict=True)):
            paint(ax, view, values, colour_scale)
            dress(ax, view, left=place == 0, bottom=True)
            ax.set_title(title)
            bar(figure_of(ax), [ax], colour_scale, colour_scale.label(label, unit), (values,))
        factor, unit_of_time = time_unit(float(estimate.times[-1]))
        moment = f"{factor * float(estimate.times[step]):.3g} {unit_of_time}"
        row[0].set_title(f"{view.title}, {moment}", loc="left", fontsize=8, fontweight="normal", y=1.08)
    return np.array(row, dtype=object)


def _state_of(truth: Trajectory | Array, estimate: Estimate, step: int) -> Array:
    if not isinstance(truth, Trajectory):
        return np.asarray(truth)
    moment = int(np.argmin(np.abs(truth.times - estimate.times[step])))
    return np.asarray(truth.states[:, moment])


def _step_at(estimate: Estimate, time: float) -> int:
    """The nearest step, of a time that is the estimate's but for a step; milliseconds for seconds are not."""
    times = estimate.times
    near = estimate.nearest(time)
    step = float(np.diff(times).max()) if len(times) > 1 else max(abs(float(times[0])), 1e-12)
    if not abs(times[near] - time) <= step:
        raise ShapeError(f"time: got {time:g} s, expected {times[0]:g} to {times[-1]:g} s as the estimate has")
    return near
