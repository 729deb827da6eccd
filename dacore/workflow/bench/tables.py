"""Tables of a benchmark: every point, what to take for a wanted error, how costs grow."""

from collections.abc import Sequence

import numpy as np

from dacore.core.arrays import Array
from dacore.workflow.bench.frontier import Growth, cheapest, frontier, growth
from dacore.workflow.bench.run import Bench, Point
from dacore.workflow.bench.sweeps import Kind
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.tables import number_text, percent

WANTED = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
TITLES: dict[Kind, str] = {
    "forward": "the forward model, errors against the reference",
    "voxels": "the functionals, errors of the measured values against exact integrals",
    "estimate": "the estimates, errors on unseen cases",
}
GROWING = (("assembly", "assembly", "CPU s"), ("analysis", "analysis", "CPU s"), ("trajectory", "trajectory", "CPU s"),
           ("memory", "memory", "MiB"))  # fmt: skip


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
    if not labels:
        return None
    marks = [frontier(*values(points, "work", label)) for label in labels]
    rows: list[list[str | Cell]] = []
    for k, point in enumerate(points):
        errors = [
            Cell(percent(point.errors[label]), "best" if marks[j][k] else "")
            if np.isfinite(point.errors.get(label, np.nan))
            else "–"
            for j, label in enumerate(labels)
        ]
        rows.append([point.name, number_text(point.costs["work"]), f"{point.costs['memory']:,.0f}", *errors])
    if kind == "forward":
        doubts = [percent(bench.doubt[label]) if label in bench.doubt else "–" for label in labels]
        rows.append(
            [Cell("the reference itself, by halving its steps", "muted"), "", "", *(Cell(d, "muted") for d in doubts)]
        )
    return Table(
        ["setting", "work [s]", "memory [MiB]", *(f"e of {label}" for label in labels)],
        rows,
        TITLES[kind],
        "Green: no other point is both cheaper and more accurate in this error. –: other functionals, not comparable.",
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
        for wanted in WANTED:
            # An error that everything has is no wish, and one that nothing reaches is said once.
            if known.size and wanted > known.max():
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
    return Table(
        ["wanted", "take", "it has", "work [s]", "memory [MiB]"],
        rows,
        f"what to take: {TITLES[kind].partition(',')[0]}",
    )


def growths(bench: Bench) -> tuple[list[Point], dict[str, Growth]]:
    """The points of the mesh sweep and the fitted growth of each of their costs with the number of nodes."""
    points = [point for point in bench.of("forward") if point.sweep.name == "mesh"]
    sizes = [point.facts["nodes"] for point in points]
    found = {name: growth(sizes, [point.costs[cost] for point in points]) for name, cost, _ in GROWING}
    return points, {name: fit for name, fit in found.items() if fit is not None}


def growth_table(bench: Bench) -> Table | None:
    """How costs grow with the mesh, and what the fit says of a million nodes."""
    points, fits = growths(bench)
    if not fits:
        return None
    rows = [
        [
            f"{name} [{unit}]", *(number_text(point.costs[cost]) for point in points), f"{fits[name].exponent:.2f}",
            number_text(fits[name].at(1e6)),
        ]
        for name, cost, unit in GROWING
        if name in fits
    ]  # fmt: skip
    sizes = [f"{point.facts['nodes']:,} nodes" for point in points]
    return Table(
        ["cost", *sizes, "exponent", "10⁶ nodes?"],
        rows,
        "growth with the mesh",
        "The last column continues the fitted power; it is no measurement. Memory is that of the whole process.",
    )


def failed_table(bench: Bench) -> Table | None:
    """Points that failed, and why."""
    rows = [[point.name, point.error] for point in bench.points if point.error]
    return Table(["setting", "error"], rows, "what failed") if rows else None
