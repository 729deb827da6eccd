"""What was found of the model's parameters, as pictures and tables."""

import numpy as np

from dacore.core.arrays import Array
from dacore.core.estimator import ParameterEstimate
from dacore.figures.learned import UNSEEN, learned
from dacore.figures.parameters import ParameterPanel, parameters
from dacore.figures.style import share_text
from dacore.studies.outcomes import Outcome
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, unit_text
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.results import learned_of, true_parameters
from dacore.workflow.session import Session
from dacore.workflow.tables import name_of, noise_name, number_text, quantity_title


def parametric(session: Session) -> dict[str, list[Outcome]]:
    """Outcomes of the estimators that find parameters, one for each noise level."""
    found = {}
    for name in session.scene.estimator:
        outcomes = [session.validation.outcome(name, level) for level in session.scene.noise.levels]
        if all(outcome.parameters is not None for outcome in outcomes):
            found[name] = outcomes
    return found


def draw_parameters(canvas: Canvas) -> list[Drawn]:
    """For each estimator that finds parameters, estimates against truths and what was learned of each."""
    session, out = canvas.session, []
    levels = session.scene.noise.levels
    for name, outcomes in parametric(session).items():
        who = name_of(session.builder, name)
        found = [o.parameters for o in outcomes if o.parameters is not None]
        names = found[0].names
        truth = true_parameters(session, names)
        panels = []
        for row, each in enumerate(names):
            parameter = session.background.parameters[each]
            panels.append(
                ParameterPanel(
                    each, unit_text(parameter.unit), parameter.low, parameter.high, truth[row],
                    {
                        noise_name(level): (one.values[row], one.deviation[row])
                        for level, one in zip(levels, found, strict=True)
                    },
                    {
                        noise_name(level): float(np.median(one.learned[row]))
                        for level, one in zip(levels, found, strict=True)
                    },
                    parameter.distribution == "log_uniform",
                )
            )  # fmt: skip
        order = ", ".join(noise_name(level) for level in levels)
        out.append(
            Drawn(
                f"parameters_{name}", Plot(parameters, panels, f"{canvas.caption} · {who}"),
                f"Parameters that “{who}” finds, against the true ones: the frame is the range, bars are 90% "
                f"intervals. Above: share of the prior's variance that the data took away, median case ({order}); grey "
                f"where that is below {100 * UNSEEN:.0f}% at every level.",
                "scatter plots of estimated against true parameters",
            )
        )  # fmt: skip
        shares = {
            noise_name(level): np.concatenate([one.learned, *_quantities_learned(session, outcome)])
            for level, one, outcome in zip(levels, found, outcomes, strict=True)
        }
        titles = [*names, *(quantity_title(session.builder, each) for each in outcomes[0].quantities)]
        out.append(
            Drawn(
                f"learned_{name}", Plot(learned, titles, shares, caption=f"{canvas.caption} · {who}"),
                f"Share of the prior's variance of each parameter and number of interest that “{who}” takes away: the "
                "median case and the middle 80%.",
                "bars of the share of variance learned of each parameter and number of interest",
            )
        )  # fmt: skip
    return out


def _quantities_learned(session: Session, outcome: Outcome) -> list[Array]:
    """Share (1, k) of each quantity, over its numbers."""
    return [np.median(learned_of(session.validation, outcome, name), axis=0)[None] for name in outcome.quantities]


def parameter_tables(session: Session) -> list[Table]:
    """For each estimator that finds parameters and each noise level, what it finds of them."""
    out = []
    for name, outcomes in parametric(session).items():
        for level, outcome in zip(session.scene.noise.levels, outcomes, strict=True):
            if outcome.parameters is not None:
                title = f"{name_of(session.builder, name)}, {noise_name(level)}"
                out.append(_table(session, title, outcome.parameters))
    return out


def _table(session: Session, title: str, found: ParameterEstimate) -> Table:
    truth = true_parameters(session, found.names)
    rows: list[list[str | Cell]] = []
    for row, name in enumerate(found.names):
        parameter = session.background.parameters[name]
        share = float(np.median(found.learned[row]))
        seen = share >= UNSEEN
        unit = "" if parameter.unit == "1" else f" [{unit_text(parameter.unit)}]"
        values = (
            found.prior[row],
            np.sqrt(((found.values[row] - truth[row]) ** 2).mean()),
            np.sqrt((found.deviation[row] ** 2).mean()),
        )
        rows.append([
            f"{name}{unit}", f"{number_text(parameter.low)} to {number_text(parameter.high)}",
            *(number_text(float(value)) for value in values),
            Cell(share_text(share) if seen else f"{share_text(share)}, not seen", "" if seen else "bad"),
        ])  # fmt: skip
    return Table(
        ["parameter", "range", "deviation of the prior", "rms error", "claimed deviation", "variance learned"],
        rows, title,
        f"Variance learned: share of the prior's that the data take away, median case; not seen below "
        f"{100 * UNSEEN:.0f}%.",
    )  # fmt: skip


def misfit_table(session: Session) -> Table | None:
    """Whether the data contradict the estimators; None where none can say."""
    levels = session.scene.noise.levels
    rows: list[list[str | Cell]] = []
    for name in session.scene.estimator:
        cells: list[str | Cell] = []
        for level in levels:
            misfit = session.validation.outcome(name, level).misfit
            if misfit is None:
                cells += [Cell("–", "muted"), Cell("–", "muted")]
                continue
            alarms = int(misfit.alarm.sum())
            cells += [
                f"{number_text(float(np.median(misfit.ratio)))} ({number_text(float(misfit.ratio.max()))})",
                Cell(f"{alarms} of {len(misfit.ratio)}", "bad" if alarms else ""),
            ]
        if any(session.validation.outcome(name, level).misfit is not None for level in levels):
            rows.append([name_of(session.builder, name), *cells])
    if not rows:
        return None
    headers = ["estimate"]
    for level in levels:
        headers += [f"residual over expected, {noise_name(level)}", "alarms"]
    return Table(
        headers, rows, "do the data contradict the estimators? Median (largest) over the cases",
        "Residuals are measured in what model, training set and stated noise make one expect: 1 where all is right. An "
        "alarm is a chi-squared probability below 1 in 10,000.",
    )  # fmt: skip
