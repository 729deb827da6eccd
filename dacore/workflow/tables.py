"""Tables of a run, for the terminal and the report alike."""

from collections.abc import Sequence
from dataclasses import dataclass

from dacore.studies.validation import PRIOR, Outcome, Validation
from dacore.workflow.build import Builder


@dataclass(frozen=True)
class ResultTable:
    """Headers and rows of text.

    Parameters
    ----------
    title : str
    headers : tuple of str
    rows : tuple of tuple of str
    note : str
    """

    title: str
    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def percent(value: float) -> str:
    """A relative error as a percentage of two digits: "0.13%", "12%", "4.2e+03%"."""
    scaled = 100 * value
    if scaled >= 1000 or 0 < scaled < 1e-3:
        return f"{scaled:.1e}%"
    return f"{scaled:.2g}%" if scaled < 100 else f"{scaled:.0f}%"


def name_of(builder: Builder, estimator: str) -> str:
    """The title an estimator has in the scene, or its name; the training mean has its own."""
    if estimator == PRIOR:
        return "guessing the training mean"
    table = builder.scene.estimator[estimator]
    return table.title or estimator


def error_table(builder: Builder, validation: Validation, level: float) -> ResultTable:
    """Space–time errors, mean and worst over the cases, and quantities, at one noise level."""
    headers = ["estimate", *(f"e({label})" for label in validation.errors)]
    headers += [f"{name} rms (max)" for name in builder.scene.quantity]
    outcomes = [validation.outcome(PRIOR, level)]
    outcomes += [validation.outcome(name, level) for name in builder.scene.estimator]
    rows = [(name_of(builder, o.estimator), *_cells(o, validation.errors)) for o in outcomes]
    noise = "no noise" if level == 0 else f"{percent(level)} noise"
    return ResultTable(
        f"{noise}: relative space–time errors, mean (worst) of {validation.clean.shape[2]} unseen cases",
        tuple(headers),
        tuple(rows),
        "same-discretisation truth",
    )


def _cells(outcome: Outcome, labels: Sequence[str]) -> list[str]:
    cells = []
    for label in labels:
        values = outcome.space_time[label]
        cells.append(f"{percent(float(values.mean()))} ({percent(float(values.max()))})")
    cells += [f"{q.rms:.3g} ({q.worst:.3g})" for q in outcome.quantities.values()]
    return cells
