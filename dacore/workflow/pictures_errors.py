"""Pictures of errors and of numbers of interest."""

import numpy as np

from dacore.figures.cycle import ErrorHistory, cycle_errors
from dacore.figures.quantity import QuantityPanel, quantity
from dacore.figures.summary import summary
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, error_name, sheets, tag
from dacore.workflow.results import learned_of
from dacore.workflow.tables import name_of, noise_name, quantity_title


def draw_histories(canvas: Canvas) -> list[Drawn]:
    """Errors over the cycle for every case, a figure a noise level."""
    session = canvas.session
    prior = session.validation.outcome(PRIOR, 0.0)
    out = []
    for level in session.builder.scene.noise.levels:
        histories = [
            ErrorHistory(name_of(session.builder, o.estimator), {error_name(k): v for k, v in o.per_step.items()})
            for o in canvas.outcomes(level)
        ]
        guess = {error_name(label): values for label, values in prior.per_step.items()}
        caption = f"{canvas.caption} · {noise_name(level)}"
        for name, part in sheets(f"errors_{tag(level)}", histories):
            out.append(
                Drawn(
                    name, Plot(cycle_errors, session.background.times, part, guess, caption),
                    f"Relative errors at each step, {noise_name(level)}: a thin line for each unseen case, the mean in "
                    "bold, and the error of guessing the training mean dashed.",
                    "grids of error curves over the cycle, one column an estimator",
                )
            )  # fmt: skip
    return out


def draw_summary(canvas: Canvas) -> Drawn:
    """Space–time errors of every estimator at every noise level beside the guess."""
    session = canvas.session
    levels = session.builder.scene.noise.levels
    names = list(session.builder.scene.estimator)
    prior = session.validation.outcome(PRIOR, 0.0)
    errors, guess, units = {}, {}, {}
    for label in [each for each in session.validation.errors if each != JOINT]:
        table = [
            [session.validation.outcome(name, level).space_time[label].mean() for level in levels] for name in names
        ]
        errors[error_name(label)] = np.array(table)
        guess[error_name(label)] = float(prior.space_time[label].mean())
    for title in session.builder.scene.quantity:
        name = quantity_title(session.builder, title)
        errors[f"{name} (rms)"] = np.array(
            [[session.validation.outcome(n, level).quantities[title].rms for level in levels] for n in names]
        )
        guess[f"{name} (rms)"] = prior.quantities[title].rms
        units[f"{name} (rms)"] = canvas.quantity_unit(title)
    figure = Plot(
        summary, [name_of(session.builder, name) for name in names], [noise_name(level) for level in levels], errors,
        guess, canvas.caption, units,
    )  # fmt: skip
    return Drawn(
        "summary", figure,
        "Mean space–time errors over the unseen cases. Right of the dashed line, guessing is better.",
        "points of the error of each estimator at each noise level beside the training mean",
    )  # fmt: skip


def draw_quantities(canvas: Canvas) -> list[Drawn]:
    """Estimated against true quantities, a panel an estimator and noise level."""
    session = canvas.session
    prior = session.validation.outcome(PRIOR, 0.0)
    out = []
    for title in session.builder.scene.quantity:
        guess = prior.quantities[title]
        name, unit = quantity_title(session.builder, title), canvas.quantity_unit(title)
        known = (float(guess.estimate.mean()), guess.rms)
        for stem, part in sheets(f"quantity_{title}", list(session.scene.estimator)):
            panels = [_panel(canvas, title, each, level) for level in session.scene.noise.levels for each in part]
            out.append(
                Drawn(
                    stem, Plot(quantity, panels, name, unit, known, canvas.caption),
                    f"{name}: estimate against truth for every unseen case, with the 90% interval each estimator "
                    "claims; the band is the training mean and its error. Learned: share of the training set's "
                    "variance that the claimed one takes away, median.",
                    f"scatter plots of estimated against true {name}",
                )
            )  # fmt: skip
    return out


def _panel(canvas: Canvas, title: str, estimator: str, level: float) -> QuantityPanel:
    outcome = canvas.session.validation.outcome(estimator, level)
    q = outcome.quantities[title]
    deviation = q.deviation.ravel() if np.isfinite(q.deviation).all() else None
    name = name_of(canvas.session.builder, estimator)
    shares = learned_of(canvas.session.validation, outcome, title)
    learned = float(np.median(shares)) if np.isfinite(shares).all() else None
    return QuantityPanel(name, noise_name(level), q.truth.ravel(), q.estimate.ravel(), deviation, learned)
