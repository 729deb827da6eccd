"""Pictures of a reconstruction: data beside their fit, fields with their deviations, numbers over time."""

import numpy as np

from dacore.figures.data_fit import FitSeries, data_fit
from dacore.figures.reconstructed import Reconstructed, reconstructed
from dacore.figures.slices import View
from dacore.figures.voxels import component_name, measured_slice
from dacore.geometry.cut import cut_plane
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, time_text, unit_text
from dacore.workflow.reconstruct.result import Reconstruction
from dacore.workflow.tables import name_of


def draw_all(result: Reconstruction) -> list[Drawn]:
    """Every picture that this reconstruction has."""
    canvas = Canvas(result.session)
    return [*_data(canvas, result), *_measured(canvas, result), *_fields(canvas, result)]


def shown_step(result: Reconstruction) -> int:
    """Which of the estimate's times is shown: that of the scene's report, or where the data are largest."""
    moment = result.session.scene.report.worst_time
    if moment is not None:
        return int(np.argmin(np.abs(result.times - moment)))
    sizes = np.linalg.norm(result.used.values[result.used.mask], axis=0)
    step = int(result.used.steps[int(np.argmax(sizes))])
    return int(np.argmin(np.abs(result.estimate.steps - step)))


def _data(canvas: Canvas, result: Reconstruction) -> list[Drawn]:
    target, used = result.target, result.used
    out: list[Drawn] = []
    for unit in dict.fromkeys(target.units):
        series = []
        names = [component_name(f, d, canvas.frame.names) for f, d in zip(target.fields, target.functionals.directions)]
        for name in dict.fromkeys(names):
            rows = np.array([n == name and u == unit for n, u in zip(names, target.units)]) & used.mask
            if rows.any():
                sigma = np.broadcast_to(result.sigma[rows, None], used.values[rows].shape)
                series.append(
                    FitSeries(name, unit_text(unit), used.values[rows].ravel(), result.fit[rows].ravel(), sigma.ravel())
                )
        if series:
            suffix = "" if len(set(target.units)) == 1 else f"_{len(out) + 1}"
            out.append(
                Drawn(
                    f"data_fit{suffix}", Plot(data_fit, series, canvas.caption),
                    f"What was measured beside what the estimate says of it, {used.count:,} values. {result.verdict}",
                    "scatter of fitted against measured values, and a histogram of residuals",
                )
            )  # fmt: skip
    return out


def _measured(canvas: Canvas, result: Reconstruction) -> list[Drawn]:
    """The measured layer with data and fit; none where voxels fill many layers or are oblique."""
    f = result.target.functionals
    found = canvas.layers
    if found is None or len(set(result.target.fields)) > 1:
        return []
    axis, places, _ = found
    cells = result.session.background.space.cells()
    view = View(cut_plane(cells.points, cells.cells, axis, float(places[len(places) // 2])), canvas.frame)
    step = int(result.estimate.steps[shown_step(result)])
    column = int(np.argmin(np.abs(result.used.steps - step)))
    values = {"measured": result.used.values[:, column], "fit": result.fit[:, column]}
    when = time_text(result.target.times[result.used.steps[column]])
    plot = Plot(
        measured_slice, view, f.centres, f.directions, f.spacing, values, unit_text(f.unit),
        name=result.target.fields[0], caption=f"{canvas.caption} · t = {when}",
    )  # fmt: skip
    return [
        Drawn(
            "measured_slice", plot, f"The measured layer at t = {when}, and what the estimate says of it.",
            "pixel images of the measured components and their fit over the outline of the slice",
        )
    ]  # fmt: skip


def _fields(canvas: Canvas, result: Reconstruction) -> list[Drawn]:
    if not canvas.has_slices:
        return []
    view, step = canvas.view(), shown_step(result)
    space, estimate = result.session.background.space, result.estimate
    state = estimate.state(series=0, step=step)
    shown = []
    for field in space.fields:
        values = canvas.values(view, state, field.name)[0]
        spread = None
        if estimate.uncertainty is not None:
            every = estimate.deviation(canvas.points(view, field.name), step, 0).reshape(field.components, -1)
            spread = np.linalg.norm(every, axis=0) if np.isfinite(every).all() else None
        vector = field.components > 1
        mean = np.linalg.norm(values, axis=0) if vector else values[0]
        shown.append(Reconstructed(f"|{field.name}|" if vector else field.name, unit_text(field.unit), mean, spread))
    when = time_text(result.times[step])
    dashed = " Dashed: the measured slice." if view.slabs else ""
    claimed = ""
    if any(each.deviation is not None for each in shown):
        claimed = " Right: the standard deviation that is claimed (of a vector, the root of the sum of squares)."
    return [
        Drawn(
            "fields", Plot(reconstructed, view, shown, caption=f"{canvas.caption} · t = {when}"),
            f"Reconstructed by “{name_of(result.session.builder, result.estimator)}” at t = {when}.{dashed}{claimed}",
            "slices of every reconstructed field and of its standard deviation",
        )
    ]  # fmt: skip
