"""Tables of a run, for the terminal and the report alike."""

from collections.abc import Sequence

import numpy as np

from dacore.core.space import StateSpace
from dacore.errors import ShapeError
from dacore.reduction.training import Reduced
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR, Outcome, Validation
from dacore.studies.reduction import UnseenErrors
from dacore.studies.refinement import Refinement
from dacore.workflow.build import Builder
from dacore.workflow.drawn import unit_text
from dacore.workflow.report_parts import Cell, Table, Tone


def percent(value: float) -> str:
    """A relative error as a percentage of two digits: "0.13%", "12%", "4200%", "3e5%"."""
    scaled = 100 * value
    if scaled >= 1e5 or 0 < scaled < 1e-3:
        return f"{_short(f'{scaled:.1e}')}%"
    if scaled >= 100:
        return f"{float(f'{scaled:.2g}'):.0f}%"
    return f"{scaled:.2g}%"


def number_text(value: float) -> str:
    """A number of three digits: "2.24", "76.8", "3,450"."""
    if not np.isfinite(value) or abs(value) >= 1e7 or 0 < abs(value) < 1e-3:
        return _short(f"{value:.2e}")
    return f"{float(f'{value:.3g}'):,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _short(text: str) -> str:
    """A number with an exponent, without what says nothing: "2.60e-09" becomes "2.6e-9"."""
    mantissa, _, exponent = text.partition("e")
    return f"{float(mantissa):g}e{int(exponent)}" if exponent else text


def value_text(value: float, deviation: float) -> str:
    """A value with the digits that its deviation leaves certain, and that: "10,252 ± 41", "3.142 ± 0.012"."""
    if not (np.isfinite(value) and np.isfinite(deviation) and deviation > 0):
        return number_text(value)
    digits = int(np.clip(1 - np.floor(np.log10(deviation)), 0, 6))
    return f"{value:,.{digits}f} ± {float(f'{deviation:.2g}'):,.{digits}f}"


def noise_name(level: float) -> str:
    """Say how much noise: "no noise", "10% noise"."""
    return "no noise" if level == 0 else f"{percent(level)} noise"


def name_of(builder: Builder, estimator: str) -> str:
    """The title an estimator has in the scene, or its name; the training mean has its own."""
    if estimator == PRIOR:
        return "guessing the training mean"
    return builder.scene.estimator[estimator].title or estimator.replace("_", " ")


def quantity_title(builder: Builder, name: str) -> str:
    """The title a quantity has in the scene, or its name."""
    return builder.scene.quantity[name].title or name.replace("_", " ")


def error_table(
    builder: Builder, space: StateSpace, validation: Validation, level: float, labels: Sequence[str]
) -> Table:
    """Space–time errors `labels`, mean and worst over the cases, and quantities, at one noise level."""
    units = {name: unit_text(builder.quantities[name].functionals(space).unit) for name in builder.scene.quantity}
    titles = [f"{quantity_title(builder, name)}, rms (max) [{unit}]" for name, unit in units.items()]
    headers = ["estimate", *(f"e of {label}" for label in labels), *titles]
    prior = validation.outcome(PRIOR, level)
    outcomes = [validation.outcome(name, level) for name in builder.scene.estimator]
    numbers = np.array([_numbers(each, labels) for each in (prior, *outcomes)])
    best = np.argmin(numbers[1:], axis=0) + 1
    rows = []
    for index, outcome in enumerate((prior, *outcomes)):
        tones = [tone_of(index, int(best[k]), numbers[index, k], numbers[0, k]) for k in range(numbers.shape[1])]
        cells = [Cell(text, tone) for text, tone in zip(_texts(outcome, labels), tones, strict=True)]
        rows.append([Cell(name_of(builder, outcome.estimator), "muted" if index == 0 else ""), *cells])
    return Table(
        headers,
        rows,
        f"{noise_name(level)}: relative space–time errors, mean (worst) over {validation.clean.shape[2]} unseen cases",
        # Once is enough.
        f"{builder.same_truth.capitalize()}, so these are errors of the reconstruction alone."
        if level == builder.scene.noise.levels[0]
        else "",
    )


def published_table(builder: Builder, space: StateSpace, validation: Validation) -> Table:
    """What was published beside the same figure of every estimator and of guessing the training mean."""
    names = (PRIOR, *builder.scene.estimator)
    rows: list[list[str | Cell]] = []
    for figure in builder.scene.report.published:
        values = []
        for name in names:
            outcome = validation.outcome(name, figure.noise)
            if figure.quantity is not None:
                found = outcome.quantities[figure.quantity]
                values.append(found.rms if figure.statistic == "mean" else found.worst)
            elif figure.error is not None and figure.error in outcome.space_time:
                errors = outcome.space_time[figure.error]
                values.append(float(errors.mean() if figure.statistic == "mean" else errors.max()))
            else:
                raise ShapeError(
                    f"report.published: got the error {figure.error!r}, expected one of {', '.join(validation.errors)}"
                )
        best = int(np.argmin(values[1:])) + 1
        text = percent if figure.quantity is None else number_text
        cells = [Cell(text(value), tone_of(k, best, value, values[0])) for k, value in enumerate(values)]
        unit = ""
        if figure.quantity is not None:
            unit = f" [{unit_text(builder.quantities[figure.quantity].functionals(space).unit)}]"
        what = f"{figure.what}, {noise_name(figure.noise)}, {figure.statistic}{unit}"
        rows.append([what, figure.value, *cells])
    return Table(
        ["figure", "published", *(name_of(builder, name) for name in names)], rows, "Beside what was published",
        "Published figures are of another mesh of another brain.",
    )  # fmt: skip


def refinement_table(refinement: Refinement) -> Table:
    """Discretisation error in time, to hold beside every reconstruction error."""
    rows = [[name, percent(value)] for name, value in refinement.differences.items() if name != JOINT]
    return Table(
        ["of", "relative space–time difference"],
        rows,
        f"discretisation error in time: against {refinement.factor} times as many steps, mid-range parameters",
        "What the time step alone changes; the mesh is the same.",
    )


def _numbers(outcome: Outcome, labels: Sequence[str]) -> list[float]:
    return [
        *(float(outcome.space_time[label].mean()) for label in labels),
        *(q.rms for q in outcome.quantities.values()),
    ]


def _texts(outcome: Outcome, labels: Sequence[str]) -> list[str]:
    texts = []
    for label in labels:
        values = outcome.space_time[label]
        texts.append(f"{percent(float(values.mean()))} ({percent(float(values.max()))})")
    return texts + [f"{number_text(q.rms)} ({number_text(q.worst)})" for q in outcome.quantities.values()]


def tone_of(index: int, best: int, value: float, guess: float) -> Tone:
    """Say whether a number is the guess's (index 0), worse than that, or the best of its column."""
    if index == 0:
        return "muted"
    if value > guess:
        return "bad"
    return "best" if index == best else ""


def reduction_table(reduced: Reduced, unseen: UnseenErrors | None) -> Table:
    """What reduced training estimates of its own error, and what it is on the unseen cases."""
    headers = ["space–time error of", "largest estimate, all samples"]
    if unseen is not None:
        headers += ["unseen cases, mean", "worst", "estimate / error"]
    rows = []
    largest = dict(zip(reduced.model.fields, reduced.estimates.max(axis=1), strict=True))
    for label in unseen.true if unseen is not None else largest:
        row = [label, percent(float(largest[label])) if label in largest else "–"]
        if unseen is not None:
            true = unseen.true[label]
            ratio = unseen.effectivity.get(label)
            row += [percent(float(true.mean())), percent(float(true.max()))]
            row.append("–" if ratio is None else f"{np.nanmin(ratio):.1f} to {np.nanmax(ratio):.1f}")
        rows.append(row)
    count = reduced.estimates.shape[1]
    return Table(
        headers, rows, "Reduced training",
        f"{len(reduced.solved)} of {count} samples solved in full, {reduced.motions} motions each; the others by "
        f"{reduced.model.dimension} modes. Reference of the unseen cases: the full model on the same mesh and steps.",
    )  # fmt: skip
