"""Pictures of fields: what was measured, the worst case, and the strip from one to the other."""

import numpy as np

from dacore.figures.comparison import comparison
from dacore.figures.hero import Hidden, Measured, hero
from dacore.figures.slices import View
from dacore.figures.voxels import measured_slice
from dacore.geometry.cut import cut_plane
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, sheets, tag, time_text, unit_text
from dacore.workflow.tables import name_of, noise_name, percent


def draw_measured(canvas: Canvas) -> list[Drawn]:
    """The measured layer at the scene's time, exact and noisy."""
    session = canvas.session
    found = canvas.layers
    if found is None:
        return []
    axis, places, _ = found
    cells = session.background.space.cells()
    view = View(cut_plane(cells.points, cells.cells, axis, float(places[len(places) // 2])), canvas.frame)
    step = canvas.measured_step(canvas.step_at(session.builder.scene.report.measured_time))
    values = {"exact": session.validation.clean[:, step, 0]}
    for level, data in session.validation.data.items():
        if level > 0:
            values[noise_name(level)] = data[:, step, 0]
    when = f"t = {time_text(session.background.times[step])}, case 1"
    f = session.functionals
    return [
        Drawn(
            "measured_slice",
            Plot(
                measured_slice, view, f.centres, f.directions, f.spacing, values, unit_text(f.unit),
                caption=f"{canvas.caption} · {when}",
            ),
            f"What is measured: {f.count} averages over {f.n_sites} voxels of "
            f"{' × '.join(f'{s:g}' for s in f.spacing)} cm at {when}. Nothing else of the state is known.",
            "pixel images of the measured components over the outline of the slice",
        )
    ]  # fmt: skip


def draw_worst(canvas: Canvas, level: float) -> list[Drawn]:
    """Truth, reconstruction, difference and claimed deviation of each field in the worst case, an estimator a row."""
    session = canvas.session
    view = canvas.view()
    outcomes = [(o, o.estimate) for o in canvas.outcomes(level) if o.estimate is not None]
    step = canvas.shown_step([estimate for _, estimate in outcomes])
    best = session.validation.best(list(session.builder.scene.estimator), level)
    case = best.worst_case(session.validation.headline)
    truth = session.truth[case].states[:, step]
    shown = [(o, estimate, canvas.state(estimate, case, step)) for o, estimate in outcomes if step in estimate.steps]
    when = f"t = {time_text(session.background.times[step])}, case {case + 1}, {noise_name(level)}"
    dashed = " Dashed: the measured slice." if view.slabs else ""
    out = []
    for field in session.background.space.fields:
        rows = [
            canvas.compared(
                view, field.name, truth, state, outcome, canvas.deviation(view, estimate, case, step, field.name)
            )
            for outcome, estimate, state in shown
        ]
        claims = ""
        if any(row.deviation is not None for row in rows):
            claims = (
                " Right: the standard deviation that is claimed, on the scale of the difference"
                + (" (root of the sum of squares over the components)" if field.components > 1 else "")
                + "; of right claims about 95% of the errors"
                + (", component by component," if field.components > 1 else "")
                + " lie within two, though neighbours err together."
            )
        for name, part in sheets(f"worst_{field.name}_{tag(level)}", rows):
            out.append(
                Drawn(
                    name, Plot(comparison, view, part, f"{canvas.caption} · {when}"),
                    f"{rows[0].name} at {when}: the case that “{name_of(session.builder, best.estimator)}” "
                    f"reconstructs worst.{dashed}{claims}",
                    f"slices of true and reconstructed {field.name}, their difference and claimed deviation",
                )
            )  # fmt: skip
    return out


def draw_hero(canvas: Canvas) -> list[Drawn]:
    """From the measured voxels to the hidden field, in one strip: the picture of the README."""
    session = canvas.session
    found, hidden = canvas.layers, canvas.hidden
    if found is None or hidden is None:
        return []
    level = session.builder.scene.noise.levels[-1]
    label = session.validation.headline
    best = session.validation.best(list(session.builder.scene.estimator), level)
    if best.estimate is None:
        return []
    axis, places, _ = found
    cells = session.background.space.cells()
    step = canvas.measured_step(canvas.shown_step([best.estimate]))
    case = int(np.argsort(best.space_time[label])[len(best.space_time[label]) // 2])
    f = session.functionals
    axes = np.abs(f.directions).argmax(axis=1)
    along = 1 if (axes == 1).any() else int(axes[0])
    chosen = (axes == along) & (np.abs(f.directions[:, along]) > 0.99)
    flat = View(cut_plane(cells.points, cells.cells, axis, float(places[len(places) // 2])), canvas.frame)
    view = canvas.view()
    truth = session.truth[case].states[:, step]
    compared = canvas.compared(view, hidden.name, truth, canvas.state(best.estimate, case, step), best)
    f_values = session.validation.data[level][chosen, step, case]
    layout = session.background.space.layout
    field = next(each for each in layout.fields if f.matrix[:, layout.block(each.name)].nnz)
    component = f"_{canvas.frame.names[along]}" if field.components > 1 else ""
    figure = Plot(
        hero,
        Measured(
            flat, f.centres[chosen], f.spacing, f_values, f"measured {field.name}{component}",
            unit_text(f.unit),
            f"{f.n_sites} voxels, {noise_name(level)}",
        ),
        Hidden(
            view, compared.truth, compared.estimate, compared.name, compared.unit,
            f"error {percent(float(best.space_time[label][case]))} over the cycle (training mean: "
            f"{percent(float(session.validation.outcome(PRIOR, level).space_time[label][case]))})",
        ),
    )  # fmt: skip
    return [
        Drawn(
            "hero", figure,
            f"From the measured {field.name} of a slice ({noise_name(level)}) to the unmeasured {compared.name} by "
            f"“{name_of(session.builder, best.estimator)}”: the median case.",
            f"measured voxels, reconstructed and true {hidden.name}",
        )
    ]  # fmt: skip
