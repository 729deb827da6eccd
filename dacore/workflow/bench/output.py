"""What a benchmark leaves behind: bench.json, bench.csv, diagrams, one report."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from dacore.figures.work_precision import Diagram, growth, work_precision
from dacore.io.atomic import atomic_write
from dacore.workflow.bench.frontier import frontier
from dacore.workflow.bench.run import Bench
from dacore.workflow.bench.sweeps import Kind
from dacore.workflow.bench.tables import (
    GAIN,
    TITLES,
    advice_table,
    failed_table,
    grown,
    growth_table,
    growths,
    labels_of,
    point_table,
    values,
)
from dacore.workflow.drawn import Drawn, error_name
from dacore.workflow.output import write_figures
from dacore.workflow.report import write_report
from dacore.workflow.report_parts import Provenance, Report, Section, Table
from dacore.workflow.results import circumstances, numbers, write_json

SCHEMA = 1
FACTS = ("library", "n_dofs", "nodes", "steps", "marched", "set-ups", "solver")


def tables(bench: Bench) -> list[Table]:
    """Tables for the terminal: every point, advice, growth, failures."""
    made = [make(bench, kind) for kind in TITLES for make in (point_table, advice_table)]
    return [table for table in (*made, growth_table(bench), failed_table(bench)) if table is not None]


def publish(bench: Bench, out: Path, command: str) -> list[Path]:
    """Write everything; returns the files a reader opens first."""
    pictures = write_figures(_draw(bench), out / "figures")
    summary = summarise(bench)
    write_json(summary, out / "bench.json")
    with atomic_write(out / "bench.csv") as stream:
        stream.write(_csv(bench))
    sections = [
        Section(
            TITLES[kind].partition(",")[0].capitalize(), _text(bench, kind),
            [each for each in (advice_table(bench, kind), point_table(bench, kind)) if each]
            + [picture for name, picture in pictures.items() if name.startswith(kind)],
        )
        for kind in TITLES
    ]  # fmt: skip
    growing = growth_table(bench)
    if growing:
        sections.append(Section("Growth", "", [growing, pictures["growth"]]))
    failed = failed_table(bench)
    if failed:
        sections.append(Section("What failed", "", [failed]))
    facts = {
        "Versions": summary["versions"],
        "Machine": {name: str(value) for name, value in summary["machine"].items()},
        "Command": {"to repeat": command},
        "Reference": {key: str(value) for key, value in bench.reference.items()},
    }
    report = Report(
        bench.title, "work against precision", (), [section for section in sections if section.parts], Provenance(facts)
    )
    write_report(out / "report.html", report)
    return [out / "report.html", out / "bench.json", out / "bench.csv"]


def summarise(bench: Bench) -> dict[str, Any]:
    """Everything that was measured, as JSON values."""
    _, fits = growths(bench)
    return {
        "schema": SCHEMA,
        "title": bench.title,
        "scene": bench.builder.scene.model_dump(mode="json"),
        "reference": dict(bench.reference),
        "reference_moves_when_its_steps_are_halved": dict(bench.doubt),
        **circumstances(bench.builder),
        "failures": dict(bench.failures),
        "growth": {
            name: {"exponent": fit.exponent, "factor": fit.factor, "scatter": fit.scatter} for name, fit in fits.items()
        },
        "points": [
            {
                "sweep": point.sweep.name, "kind": point.sweep.kind, "label": point.label, "error": point.error or None,
                "costs": {name: numbers(value) for name, value in point.costs.items()},
                "errors": {name: numbers(value) for name, value in point.errors.items()},
                "facts": {k: v for k, v in point.facts.items() if k in FACTS},
            }
            for point in bench.points
        ],
    }  # fmt: skip


def _text(bench: Bench, kind: Kind) -> str:
    if kind != "forward":
        return ""
    settings = "; ".join(f"`{key} = {value}`" for key, value in bench.reference.items())
    return (
        "Relative space–time differences at some hundred points inside the domain, parameters in the middle of their "
        f"ranges, from a **reference** computed by dacore itself with {settings}: what it shares with a point, a "
        "mesh say, is not in the point's error. Work is CPU time of assembly, analysis and one trajectory."
    )


def _draw(bench: Bench) -> list[Drawn]:
    out = []
    for kind in TITLES:
        points = bench.of(kind)
        series = list(dict.fromkeys(point.sweep.name for point in points))
        number = np.array([series.index(point.sweep.name) for point in points])
        diagrams = []
        for label in labels_of(points)[:6]:
            for cost, axis in (("work", "work  [s]"), ("memory", "memory  [MiB]"))[: 2 if kind == "forward" else 1]:
                costs, errors = values(points, cost, label)
                diagrams.append(Diagram(error_name(label), axis, costs, errors, number, frontier(costs, errors, GAIN)))
        if diagrams:
            out.append(
                Drawn(
                    f"{kind}_work_precision", work_precision(series, diagrams, bench.title),
                    f"Work against precision of {TITLES[kind]}; ringed points are on the efficient frontier.",
                    f"Logarithmic diagrams of error against cost for {', '.join(series)}.",
                )
            )  # fmt: skip
    points, fits = growths(bench)
    if fits:
        sizes = np.array([point.facts["nodes"] for point in points], dtype=np.float64)
        curves = [(name, unit, values, fit.exponent) for name, unit, values, fit in grown(bench)]
        out.append(
            Drawn(
                "growth", growth(sizes, curves, "nodes", bench.title), "Cost against the number of nodes.",
                "Logarithmic curves of cost against nodes: "
                + ", ".join(f"{name} grows with power {fit.exponent:.2f}" for name, fit in fits.items()) + ".",
            )
        )  # fmt: skip
    return out


def _csv(bench: Bench) -> str:
    """One row a point, columns for every cost and error that some point has."""
    costs = list(dict.fromkeys(name for point in bench.points for name in point.costs))
    errors = list(dict.fromkeys(name for point in bench.points for name in point.errors))
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(
        [
            "kind",
            "sweep",
            "label",
            "nodes",
            "dofs",
            *(f"cost: {c}" for c in costs),
            *(f"error: {e}" for e in errors),
            "failed",
        ]
    )
    for point in bench.points:
        rows.writerow(
            [
                point.sweep.kind, point.sweep.name, point.label, point.facts.get("nodes", ""),
                point.facts.get("n_dofs", ""), *(point.costs.get(c, "") for c in costs),
                *(point.errors.get(e, "") for e in errors), point.error,
            ]
        )  # fmt: skip
    return buffer.getvalue()
