"""Tables of a comparison, for the terminal and the report alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.comparison.agreement import ESTIMATES, GROUPS, worst
from dacore.workflow.comparison.run import Comparison, Measured
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.tables import noise_name, number_text, percent, quantity_title

# Title, cost, unit, and what it means.
COSTS = {
    "matrices": (
        ("first assembly", "first assembly", "s", "wall time, with importing the library and what it compiles once"),
        ("assembly", "assembly", "CPU s", "all matrices and loads of the model"),
        ("functionals", "functionals", "CPU s", "of all observations"),
        ("memory, assembling", "memory assembling", "MiB", "peak of the process, the library's own included"),
    ),
    "trajectory": (
        ("analysis", "analysis", "CPU s", "system of a time step and what the solver does once for all samples"),
        ("trajectory", "trajectory", "CPU s", "set-up of the solver and all steps of one sample"),
        ("memory, solving", "memory solving", "MiB", "peak of the process so far"),
    ),
    "estimate": (
        ("training", "training", "s", "training and unseen trajectories, wall time, workers together"),
        ("preparing", "preparing", "s", "all estimators, wall time"),
        ("estimating", "estimating", "s", "all cases and noise levels, wall time"),
    ),
}


@dataclass(frozen=True)
class Line:
    """One cost of every variant that finished.

    Parameters
    ----------
    title, unit, meaning : str
    values : (v,) array
        NaN where it was not measured.
    """

    title: str
    unit: str
    meaning: str
    values: Array


def lines(comparison: Comparison) -> list[Line]:
    """The costs that the comparison went far enough for and that some variant has."""
    depth = list(COSTS).index(comparison.depth)
    out = []
    for title, cost, unit, meaning in (each for name in list(COSTS)[: depth + 1] for each in COSTS[name]):
        values = np.array([variant.cost(cost) for variant in comparison.finished])
        if np.isfinite(values).any():
            out.append(Line(title, unit, meaning, values))
    return out


def cost_table(comparison: Comparison) -> Table:
    """Costs side by side: the least of each line, and how many times as much the others take."""
    finished = comparison.finished
    rows: list[list[str | Cell]] = []
    if any("library" in variant.facts for variant in finished):
        rows.append(["library version", "", *(str(variant.facts.get("library", "–")) for variant in finished)])
    rows += [
        [line.title, line.unit, *(_ratio(value, line.values) for value in line.values)] for line in lines(comparison)
    ]
    if comparison.depth == "estimate":
        solved = [variant.facts["trajectories"] for variant in finished]
        rows.append(["trajectories solved", "", *(f"{each['solved']} of {each['of']}" for each in solved)])
    rounds = max((len(variant.rounds) for variant in finished), default=0)
    return Table(
        ["cost", "", *(variant.label for variant in finished)],
        rows,
        f"cost, median of {rounds} rounds in turn, one thread each" if rounds > 1 else "cost, one round, one thread",
        "CPU s: processor seconds of one thread; s: wall time. ×: times the least of the line.",
    )


def agreement_table(comparison: Comparison) -> Table | None:
    """Largest differences from the reference, group by group; None where nothing can be compared."""
    found = {v.label: v.agreement.groups() for v in comparison.finished if v.agreement is not None}
    groups = [g for g in (*GROUPS.values(), ESTIMATES) if any(g in each for each in found.values())]
    if not groups:
        return None
    return Table(
        ["variant", *groups],
        [[label, *(_gap(each.get(group)) for group in groups)] for label, each in found.items()],
        f"largest difference from {comparison.reference}, max|a − b| / max|b|",
    )


def item_table(comparison: Comparison) -> Table | None:
    """Difference of every single item, the worst of all variants."""
    agreements = [v.agreement for v in comparison.finished if v.agreement is not None]
    items = list(dict.fromkeys(name for each in agreements for name in each.differences))
    if not items:
        return None
    headers = [v.label for v in comparison.finished if v.agreement is not None]
    rows = [[item, *(_gap(each.differences.get(item)) for each in agreements)] for item in items]
    order = np.argsort([-worst(agreements, item) for item in items], kind="stable")
    return Table(["item", *headers], [rows[k] for k in order], f"every item against {comparison.reference}")


def error_tables(comparison: Comparison) -> list[Table]:
    """Errors on the unseen cases of every variant and estimator, a table a noise level."""
    found = [(v, outcome) for v in comparison.finished for outcome in v.facts.get("outcomes", [])]
    out = []
    for level in dict.fromkeys(outcome["noise"] for _, outcome in found):
        mine = [(v, o) for v, o in found if o["noise"] == level and o["estimator"] != PRIOR]
        prior = next((o for _, o in found if o["estimator"] == PRIOR), None)
        if prior is not None:
            out.append(_error_table(comparison, level, mine, prior))
    return out


def _error_table(
    comparison: Comparison, level: float, mine: Sequence[tuple[Measured, dict[str, Any]]], prior: dict[str, Any]
) -> Table:
    builder = comparison.builders[0]
    labels = [label for label in prior["errors"] if label != JOINT]
    quantities = list(prior["quantities"])
    guess: list[str | Cell] = [Cell("guessing the training mean", "muted")]
    guess += [Cell(text, "muted") for text in _texts(prior, labels, quantities)]
    rows: list[list[str | Cell]] = [guess]
    single = any(axis.key == "estimators" for axis in comparison.axes)
    if not single:  # the variants of one estimator stand together
        mine = sorted(mine, key=lambda each: list(builder.scene.estimator).index(each[1]["estimator"]))
    for variant, outcome in mine:
        name = variant.label if single else f"{outcome['estimator']}, {variant.label}"
        rows.append([name.replace("_", " "), *_texts(outcome, labels, quantities)])
    titles = [f"{quantity_title(builder, name)}, rms (max)" for name in quantities]
    return Table(
        ["estimate", *(f"e of {label}" for label in labels), *titles],
        rows,
        f"{noise_name(level)}: relative space–time errors, mean (worst) over the unseen cases",
        "Truth of each variant computed with its own mesh, scheme and library.",
    )


def _texts(outcome: dict[str, Any], labels: Sequence[str], quantities: Sequence[str]) -> list[str]:
    texts = [f"{percent(outcome['errors'][x]['mean'])} ({percent(outcome['errors'][x]['worst'])})" for x in labels]
    for name in quantities:
        found = outcome["quantities"][name]
        texts.append(f"{number_text(found['rms_error'])} ({number_text(found['largest_error'])})")
    return texts


def _ratio(value: float, every: Array) -> Cell | str:
    if not np.isfinite(value):
        return "–"
    least = float(np.nanmin(every))
    text = f"{value:,.0f}" if value >= 100 else f"{value:.2g}" if value < 10 else f"{value:.3g}"
    if value <= least * 1.05:
        return Cell(text, "best")
    return f"{text} ×{value / least:.2g}" if least > 0 and value / least < 100 else text


def _gap(value: float | None) -> str:
    return "–" if value is None else "0" if value == 0 else f"{value:.0e}"
