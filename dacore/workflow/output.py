"""What a run leaves behind: results.json, figures, fields for ParaView, one report."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dacore.core.space import StateSpace
from dacore.figures.style import png
from dacore.io.atomic import atomic_write
from dacore.io.fields import write_series, write_vtu
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR, Outcome, Validation
from dacore.workflow.build import Builder
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, tag, unit_text
from dacore.workflow.pictures import draw_all
from dacore.workflow.pictures_parameters import misfit_table, parameter_tables, parametric
from dacore.workflow.report import write_report
from dacore.workflow.report_parts import Card, Picture, Provenance, Report, Section, Table, Timing
from dacore.workflow.session import Session
from dacore.workflow.stages import judges_reduction
from dacore.workflow.studies.output import Shown, score_tables, show_studies
from dacore.workflow.tables import (
    error_table,
    name_of,
    noise_name,
    number_text,
    percent,
    published_table,
    quantity_title,
    reduction_table,
    refinement_table,
    value_text,
)  # fmt: skip

_OF_PARAMETERS = ("parameters", "learned")
_END_OF_PNG = b"IEND\xaeB`\x82"


def tables(session: Session, joint: bool = True) -> list[Table]:
    """Error tables of every noise level, and the discretisation error if it was asked for.

    Parameters
    ----------
    session : Session
    joint : bool
        Whether to show the error of the joint norm, which a narrow terminal has no room for.
    """
    builder, space, validation = session.builder, session.model.space, session.validation
    labels = [label for label in validation.errors if joint or label != JOINT]
    out = [error_table(builder, space, validation, level, labels) for level in builder.scene.noise.levels]
    if (misfits := misfit_table(session)) is not None:
        out.append(misfits)
    if builder.scene.report.published:
        out.append(published_table(builder, space, validation))
    if builder.scene.validation.refine_time > 1:
        out.append(refinement_table(session.refinement))
    if builder.scene.training.method == "reduced":
        out.append(reduction_table(session.reduced, session.unseen_errors if judges_reduction(builder.scene) else None))
    return out


@dataclass(frozen=True, eq=False)
class Published:
    """What a run wrote, and what of it belongs on a terminal.

    Parameters
    ----------
    files : list of Path
        Those that a reader opens first.
    studies : list of Table
        All studies side by side; none without studies.
    """

    files: list[Path]
    studies: list[Table]


def write_figures(pictures: Iterable[Drawn], folder: Path, kept: Path | None = None) -> dict[str, Picture]:
    """Write every figure as PNG and return them for the report, by name.

    Parameters
    ----------
    pictures : iterable of Drawn
    folder : Path
    kept : Path, optional
        Folder of figures drawn before: one that shows the same is not drawn again.
    """
    out = {}
    for drawn in pictures:
        data = _png_of(drawn, kept)
        with atomic_write(folder / f"{drawn.name}.png") as stream:
            stream.write(data)
        out[drawn.name] = Picture(data, drawn.caption, drawn.alt)
    return out


def _png_of(drawn: Drawn, kept: Path | None) -> bytes:
    if not isinstance(drawn.figure, Plot):
        return png(drawn.figure)
    key = drawn.figure.key() if kept is not None else None
    if kept is None or key is None:
        return png(drawn.figure.draw())
    path = kept / f"{drawn.name}-{key}.png"
    data = path.read_bytes() if path.exists() else b""
    if not data.endswith(_END_OF_PNG):  # none yet, or damaged
        data = png(drawn.figure.draw())
        with atomic_write(path) as stream:
            stream.write(data)
    return data


def write_fields(session: Session, folder: Path) -> list[Path]:
    """Write the worst case of the best estimator at each noise level as time series, and the first modes.

    In ParaView, open the ``.xdmf`` files: fields truth_*, estimate_* and difference_* over the cycle.
    """
    builder, background, validation = session.builder, session.background, session.validation
    files = []
    for level in builder.scene.noise.levels:
        best = validation.best(list(builder.scene.estimator), level)
        if best.estimate is None:
            continue
        case = best.worst_case(validation.headline)
        steps = best.estimate.steps
        truth, estimate = session.truth[case].states[:, steps], best.estimate.state(series=case)
        path = folder / f"worst_case_{tag(level)}.xdmf"
        series = {"truth_": truth, "estimate_": estimate, "difference_": estimate - truth}
        write_series(background.space, series, background.times[steps], path)
        files.append(path)
    spaces = Canvas(session).spaces
    if spaces:
        modes = background.lift(next(iter(spaces.values()))[0].modes[:, :8])
        path = folder / "modes.vtu"
        write_vtu(background.space, {f"mode{k + 1}_": modes[:, k] for k in range(modes.shape[1])}, path)
        files.append(path)
    return files


def make_report(
    session: Session,
    pictures: dict[str, Picture],
    summary: dict[str, Any],
    scene_text: str,
    studies: Sequence[Shown],
    side_by_side: Sequence[Table],
) -> Report:
    """Put results and figures together for reading."""
    builder, validation = session.builder, session.validation
    facts = {
        "Versions": summary["versions"],
        "Seeds": {name: str(seed) for name, seed in summary["seeds"].items()},
        "Machine": {name: str(value) for name, value in summary["machine"].items()},
        "Size": {
            **({"nodes": f"{summary['mesh']['nodes']:,}"} if summary["mesh"] else {}),
            "degrees of freedom": f"{summary['n_dofs']:,}",
            "measurements": f"{summary['observation']['functionals']:,}",
            "training trajectories": str(summary["background"]["samples"]),
            "modes kept": ", ".join(f"{n} of {name}" for name, n in summary["background"]["modes"].items()),
        },
    }
    expected, states = summary["estimated"], session.runner.states
    timings = [
        Timing(name, seconds, states.get(name, "run"), expected[name]["seconds"] if name in expected else None)
        for name, seconds in session.runner.timings.items()
    ]
    memory = int(max(summary["peak_memory_mib"].values()) * 2**20)
    named = dict(pictures)

    def take(*names: str) -> list[Picture]:
        """Pictures of these names, or numbered parts of them, each once."""
        found = [each for name in names for each in named if each == name or each.startswith(f"{name}_")]
        return [named.pop(each) for each in dict.fromkeys(found)]

    levels = builder.scene.noise.levels
    tags = [tag(level) for level in levels]
    sections = [
        Section("In one picture", "", take("hero")),
        Section(
            "How well",
            f"**Reference:** {summary['reference']}. Every error stands beside the error of guessing the training "
            "mean, because a field that hardly varies flatters any estimate. Green: the best of its column; red: worse "
            "than guessing." + "".join(f"\n\n**Beware:** {line}." for line in session.cautions),
            [*tables(session), *take("summary")],
        ),
        Section("What was measured", "", take("measured_slice")),
        Section(
            "Reconstructed fields",
            "",
            take(*(f"worst_{f.name}_{t}" for t in tags for f in reversed(session.background.space.fields))),
        ),
        Section("Errors over the cycle", "", take(*(f"errors_{t}" for t in tags))),
        Section("Numbers of interest", "", take(*(f"quantity_{name}" for name in builder.scene.quantity))),
        Section(
            "Parameters",
            "",
            [
                *parameter_tables(session),
                *take(*(f"{what}_{name}" for name in parametric(session) for what in _OF_PARAMETERS)),
            ],
        ),
        Section("Background spaces", "", take("singular_values", "inf_sup", "bound", "modes")),
        *(each.section(pictures) for each in studies),
        Section("All studies", "", side_by_side),
    ]
    scene = builder.scene
    return Report(
        scene.title,
        f"dacore {summary['versions']['dacore']} · {scene.physics.kind}"
        + (f" on {scene.discretization.backend}" if scene.domain is not None else ""),
        [*cards(builder, session.model.space, validation), *quantity_cards(builder, session.model.space, validation)],
        [section for section in sections if section.parts],
        Provenance(facts, timings, memory),
        scene_text,
    )


def cards(builder: Builder, space: StateSpace, validation: Validation) -> list[Card]:
    """Headline numbers: the best estimator of each noise level beside the guess."""
    prior = validation.outcome(PRIOR, 0.0)
    out = []
    for level in builder.scene.noise.levels:
        best = validation.best(list(builder.scene.estimator), level)
        if label := validation.headline:
            what, mean, guess = f"error of {label}", _mean(best, label), _mean(prior, label)
            value, known = percent(mean), percent(guess)
        else:
            name = next(iter(builder.scene.quantity))
            what, mean, guess = quantity_title(builder, name), best.quantities[name].rms, prior.quantities[name].rms
            what = f"error of {what}, rms"
            unit = unit_text(builder.quantities[name].functionals(space).unit)
            value, known = f"{number_text(mean)} {unit}", number_text(guess)
        out.append(
            Card(
                f"{what}, {noise_name(level)}", value,
                f"{name_of(builder, best.estimator)}; guessing the mean: {known}",
                "good" if mean < 0.5 * guess else "bad" if mean > guess else "",
            )
        )  # fmt: skip
    return out


def quantity_cards(builder: Builder, space: StateSpace, validation: Validation) -> list[Card]:
    """The number of interest of the median case at the highest noise level, as whoever finds it best gives it."""
    level, out = max(builder.scene.noise.levels), []
    for name in list(builder.scene.quantity)[:2]:
        quantity = builder.quantities[name]
        best = min(
            (validation.outcome(each, level) for each in builder.scene.estimator), key=lambda o: o.quantities[name].rms
        )
        found, guess = best.quantities[name], validation.outcome(PRIOR, 0.0).quantities[name]
        if len(found.truth) > 1 or best.estimate is None:
            # A number for each time is a curve, and no headline.
            continue
        errors = np.abs(found.estimate - found.truth)[0]
        case = int(np.argsort(errors)[len(errors) // 2])
        value, truth, claimed = (float(each[0, case]) for each in (found.estimate, found.truth, found.deviation))
        # As many digits as mean something: those of the deviation, or of the error without one.
        size = claimed if np.isfinite(claimed) and claimed > 0 else found.rms
        note = f"true: {value_text(truth, size).partition(' ')[0]}"
        tone: Literal["", "good", "bad"] = ""
        if best.estimate.uncertainty is not None and np.isfinite(claimed):
            low, high = (float(each[0, case]) for each in best.estimate.interval(quantity))
            ends = (value_text(each, size).partition(" ")[0] for each in (low, high))
            note += f"; 90% interval: {' to '.join(ends)}"
            tone = "good" if low <= truth <= high and size < 0.5 * guess.rms else ""
        shown = value_text(value, size).partition(" ")[0]
        out.append(
            Card(
                f"{quantity_title(builder, name)}, {noise_name(level)}, median case",
                f"{shown} {unit_text(quantity.functionals(space).unit)}",
                f"{note}; training mean: {value_text(float(guess.estimate[0, case]), guess.rms)}. "
                f"{name_of(builder, best.estimator)}",
                tone,
            )
        )  # fmt: skip
    return out


def _mean(outcome: Outcome, label: str) -> float:
    return float(outcome.space_time[label].mean())


def publish(session: Session, out: Path, summary: dict[str, Any], scene_text: str) -> Published:
    """Write figures, fields and the report."""
    canvas = Canvas(session)
    studies = show_studies(canvas)
    units = {name: canvas.quantity_unit(name) for name in session.scene.quantity}
    side_by_side = score_tables(session.builder, units, studies, session.validation.headline)
    drawn = chain(draw_all(canvas), *(each.drawn for each in studies))
    pictures = write_figures(drawn, out / "figures", session.runner.cache / "figures")
    fields = []
    if session.scene.report.states and "cells" in session.model.space.capabilities:
        fields = write_fields(session, out / "fields")
    report = out / "report.html"
    write_report(report, make_report(session, pictures, summary, scene_text, studies, side_by_side))
    return Published([report, *fields], side_by_side)
