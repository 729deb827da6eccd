"""Tables of a benchmark: every point, what to take for a wanted error, how costs grow."""

from collections.abc import Sequence

import numpy as np

from dacore.core.arrays import Array
from dacore.workflow.bench.frontier import Growth, cheapest, frontier, growth
from dacore.workflow.bench.point import Point
from dacore.workflow.bench.run import Bench
from dacore.workflow.bench.sweeps import GROWTH, Kind
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.tables import number_text, percent

# Two settings whose errors are closer are as accurate as each other: the cheaper one will do.
GAIN = 0.05
WANTED = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
TITLES: dict[Kind, str] = {
    "forward": "the forward model, errors against the reference",
    "voxels": "the functionals, errors of the measured values against exact integrals",
    "estimate": "the estimates, errors on unseen cases",
    "costs": "costs alone",
}
# Title, cost, unit.
GROWING = (
    ("assembly", "assembly", "CPU s"),
    ("ordering", "analysis", "CPU s"),
    ("set-up", "set-up", "CPU s"),
    ("a step", "step", "CPU s"),
    ("trajectory", "trajectory", "CPU s"),
    ("memory", "memory beyond the start", "MiB"),
)
_FRONTIER_NOTE = "Green: no cheaper point is as accurate in this error, to within 5%. –: nothing to compare it with."
_GROWTH_NOTE = (
    "Assembly: all matrices and loads. Ordering: pattern and order of elimination, once for all samples. Set-up: of "
    "the solver, once a sample and length of step. Trajectory: set-up and all steps. Memory: peak while solving, "
    "beyond the process at its start. Off by: largest ratio to the fitted power. 10⁶ nodes: that power continued, no "
    "measurement."
)


def labels_of(points: Sequence[Point]) -> list[str]:
    """Every error that some point has."""
    return list(dict.fromkeys(label for point in points for label in point.errors))


def values(points: Sequence[Point], cost: str, error: str) -> tuple[Array, Array]:
    """Costs and errors (k,) of points, NaN where missing."""
    costs = np.array([point.costs.get(cost, np.nan) for point in points])
    return costs, np.array([point.errors.get(error, np.nan) for point in points])


def point_table(bench: Bench, kind: Kind) -> Table | None:
    """Every point of one kind; on the frontier of an error the error is marked."""
    points = bench.of(kind)
    labels = labels_of(points)
    if not points:
        return None
    marks = [frontier(*values(points, "work", label), GAIN) for label in labels]
    rows: list[list[str | Cell]] = []
    for k, point in enumerate(points):
        errors = [
            Cell(percent(point.errors[label]), "best" if marks[j][k] else "")
            if np.isfinite(point.errors.get(label, np.nan))
            else "–"
            for j, label in enumerate(labels)
        ]
        rows.append([point.name, number_text(point.costs["work"]), f"{point.costs['memory']:,.0f}", *errors])
    if kind == "forward" and bench.doubt:
        doubts = [percent(bench.doubt[label]) if label in bench.doubt else "–" for label in labels]
        rows.append(
            [Cell("the reference itself, by halving its steps", "muted"), "", "", *(Cell(d, "muted") for d in doubts)]
        )
    return Table(
        ["setting", "work [s]", "memory [MiB]", *(f"e of {label}" for label in labels)],
        rows,
        TITLES[kind],
        _FRONTIER_NOTE if labels else "",
    )


def advice_table(bench: Bench, kind: Kind) -> Table | None:
    """The cheapest measured setting for each wanted error; None where there is nothing to choose from."""
    points = bench.of(kind)
    labels = labels_of(points)
    if not labels:
        return None
    rows = []
    for label in labels:
        costs, errors = values(points, "work", label)
        known = errors[np.isfinite(errors)]
        if not known.size:
            continue
        for wanted in WANTED:
            # An error that everything has is no wish, and one that nothing reaches is said once.
            if wanted > known.max():
                continue
            chosen = cheapest(costs, errors, wanted)
            if chosen is None:
                rows.append([f"e of {label} ≤ {percent(wanted)}", f"none; least is {percent(known.min())}", "", "", ""])
                break
            point = points[chosen]
            rows.append(
                [
                    f"e of {label} ≤ {percent(wanted)}", point.name, percent(errors[chosen]),
                    number_text(costs[chosen]), f"{point.costs['memory']:,.0f}",
                ]
            )  # fmt: skip
    if not rows:
        return None
    return Table(
        ["wanted", "take", "it has", "work [s]", "memory [MiB]"],
        rows,
        f"what to take: {TITLES[kind].partition(',')[0]}",
    )


def growths(bench: Bench) -> tuple[list[Point], dict[str, Growth]]:
    """Points of the sweep over sizes, and the fitted growth of each of their costs with the number of nodes."""
    own = [point for point in bench.of("costs") if point.sweep.name == GROWTH]
    points = own or [point for point in bench.of("forward") if point.sweep.name == "mesh"]
    points = [point for point in points if "nodes" in point.facts]
    sizes = [point.facts["nodes"] for point in points]
    found = {name: growth(sizes, _costs(points, cost)) for name, cost, _ in GROWING}
    return points, {name: fit for name, fit in found.items() if fit is not None}


def grown(bench: Bench) -> list[tuple[str, str, Array, Growth]]:
    """Title, unit, values (k,) and fit of every cost that grows with the size."""
    points, fits = growths(bench)
    return [(name, unit, _costs(points, cost), fits[name]) for name, cost, unit in GROWING if name in fits]


def _costs(points: Sequence[Point], cost: str) -> Array:
    return np.array([point.costs.get(cost, np.nan) for point in points], dtype=np.float64)


def growth_table(bench: Bench) -> Table | None:
    """How costs grow with the mesh, and what the fit says of a million nodes."""
    points, fits = growths(bench)
    if not fits:
        return None
    rows = [
        [
            f"{name} [{unit}]", *map(number_text, values), f"{fit.exponent:.2f}", f"{fit.scatter:.2f}",
            number_text(fit.at(1e6)),
        ]
        for name, unit, values, fit in grown(bench)
    ]  # fmt: skip
    if any("solver" in point.facts for point in points):
        rows.append(["solver", *(str(point.facts.get("solver", "–")) for point in points), "", "", ""])
    sizes = [f"{point.facts['nodes']:,} nodes" for point in points]
    headers = ["cost", *sizes, "exponent", "off by", "10⁶ nodes?"]
    return Table(headers, rows, "growth with the mesh", _GROWTH_NOTE)


def failed_table(bench: Bench) -> Table | None:
    """What failed, and why."""
    rows = [[name, error] for name, error in bench.failures.items()]
    return Table(["setting", "error"], rows, "what failed") if rows else None
