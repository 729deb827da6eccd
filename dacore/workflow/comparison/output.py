"""What a comparison leaves behind: comparison.json, two figures, one report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dacore.figures.costs import Cost, costs, differences
from dacore.workflow.comparison.agreement import group_of
from dacore.workflow.comparison.run import Comparison
from dacore.workflow.comparison.tables import (
    agreement_table,
    cost_table,
    error_tables,
    item_table,
    lines,
)
from dacore.workflow.drawn import Drawn
from dacore.workflow.output import write_figures
from dacore.workflow.report import write_report
from dacore.workflow.report_parts import Picture, Provenance, Report, Section, Table
from dacore.workflow.results import circumstances, numbers, write_json

SCHEMA = 1


def tables(comparison: Comparison) -> list[Table]:
    """Tables for the terminal: cost, agreement, errors."""
    agreed = agreement_table(comparison)
    return [cost_table(comparison), *([agreed] if agreed else []), *error_tables(comparison)]


def publish(comparison: Comparison, out: Path, command: str) -> list[Path]:
    """Write figures, comparison.json and the report; returns the files a reader opens first."""
    pictures = write_figures(_draw(comparison), out / "figures")
    summary = summarise(comparison)
    write_json(summary, out / "comparison.json")
    write_report(out / "report.html", _report(comparison, pictures, summary, command))
    return [out / "report.html", out / "comparison.json"]


def summarise(comparison: Comparison) -> dict[str, Any]:
    """Everything that was measured, as JSON values."""
    return {
        "schema": SCHEMA,
        "title": comparison.title,
        "varied": {axis.key: list(axis.values) for axis in comparison.axes},
        "depth": comparison.depth,
        "reference": comparison.reference,
        **circumstances(comparison.builders[0]),
        "variants": [
            {
                "label": variant.label,
                "scene": builder.scene.model_dump(mode="json"),
                "error": variant.error or None,
                "facts": dict(variant.facts),
                "rounds": [{name: numbers(value) for name, value in costs_.items()} for costs_ in variant.rounds],
                "differences": None
                if variant.agreement is None
                else {name: numbers(value) for name, value in variant.agreement.differences.items()},
                "not_comparable": None if variant.agreement is None else list(variant.agreement.apart),
            }
            for variant, builder in zip(comparison.variants, comparison.builders, strict=True)
        ],
    }


def _draw(comparison: Comparison) -> list[Drawn]:
    finished = comparison.finished
    if not finished:
        return []
    labels = [variant.label for variant in finished]
    shown = [Cost(line.title, line.unit, line.values) for line in lines(comparison)]
    out = [
        Drawn(
            "costs", costs(labels, shown, comparison.title),
            "What each variant costs: median over the rounds, one thread.",
            f"Bars of {', '.join(cost.name for cost in shown)} for {', '.join(labels)}.",
        )
    ]  # fmt: skip
    others = [variant for variant in finished if variant.agreement is not None]
    items = _items([variant.agreement.differences for variant in others if variant.agreement])
    if items:
        gaps = np.array([[v.agreement.differences.get(i, np.nan) for i in items] for v in others if v.agreement])
        named = [variant.label for variant in others]
        out.append(
            Drawn(
                "agreement", differences(named, items, gaps, comparison.reference, comparison.title),
                f"Largest difference of every item from {comparison.reference}, relative to its largest entry.",
                f"Dots on a logarithmic axis; the largest relative difference is {np.nanmax(gaps):.0e}.",
            )
        )  # fmt: skip
    return out


def _items(found: Sequence[Any]) -> list[str]:
    """All items, group by group."""
    items = list(dict.fromkeys(name for differences_ in found for name in differences_))
    order = list(dict.fromkeys(group_of(item) for item in items))
    return sorted(items, key=lambda item: order.index(group_of(item)))


def _report(comparison: Comparison, pictures: dict[str, Picture], summary: dict[str, Any], command: str) -> Report:
    failed = [f"**{variant.label}** failed: {variant.error}" for variant in comparison.variants if variant.error]
    agreed, single, errors = agreement_table(comparison), item_table(comparison), error_tables(comparison)
    sections = [
        Section("What did not finish", "\n\n".join(failed)) if failed else None,
        Section(
            "What each costs",
            "Every variant ran in a process of its own, in turn with the others, on one machine in one run. "
            + "; ".join(f"**{line.title}**: {line.meaning}" for line in lines(comparison))
            + ".",
            [cost_table(comparison), *_some(pictures, "costs")],
        ),
        Section(
            "How far they agree",
            f"Every item against **{comparison.reference}**. Rounding alone gives about 1e-16 in a matrix; a solver's "
            "tolerance shows in a trajectory, and an estimate multiplies both by the condition of its system.",
            [*([agreed] if agreed else []), *_some(pictures, "agreement")],
        )
        if agreed
        else None,
        Section("How well they estimate", "", errors) if errors else None,
        Section("Every item", "", [single]) if single else None,
    ]
    facts = {
        "Versions": summary["versions"],
        "Machine": {name: str(value) for name, value in summary["machine"].items()},
        "Command": {"to repeat": command},
    }
    varied = ", ".join(axis.key for axis in comparison.axes)
    return Report(
        comparison.title, f"comparison of {varied}", (), [each for each in sections if each], Provenance(facts)
    )


def _some(pictures: dict[str, Picture], name: str) -> list[Picture]:
    return [pictures[name]] if name in pictures else []
