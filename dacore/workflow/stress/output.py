"""What the catalogue leaves behind: tables, stress.json, a report, and the table of docs/stress.md."""

import math
import re
from pathlib import Path
from typing import Any

from dacore.errors import StoreError
from dacore.io.atomic import atomic_write
from dacore.workflow.report import write_report
from dacore.workflow.report_parts import Card, Cell, Provenance, Report, Section, Table
from dacore.workflow.results import circumstances, write_json
from dacore.workflow.stress.case import Judged
from dacore.workflow.stress.run import VERDICTS, Stressed

SCHEMA = 1
BEGIN, END = "<!-- begin: dacore stress -->", "<!-- end: dacore stress -->"

_SHORT = 64
_TONES: dict[str, Any] = {"stable": "best", "wrong": "bad", "crashed": "bad", "not applicable": "muted"}
_MEANING = (
    "**stable**: the answer agrees with an independent reference within what conditioning, or the nominal case, "
    "explains. **degraded**: it does not, and the user is told: by a warning, an uncertainty that covers the error, a "
    "small β in the report. **refused**: an error in one line that says what to do. **wrong**: an error that nobody "
    "mentions. **crashed**: a traceback."
)


def tables(stressed: Stressed, short: bool = True) -> list[Table]:
    """One table a theme, and the count of the verdicts."""
    out = []
    for theme in dict.fromkeys(each.case.theme for each in stressed.judged):
        mine = [each for each in stressed.judged if each.case.theme == theme]
        headers = ["case", "verdict", "error", "bound", "what is said"]
        if not short:
            headers[1:1] = ["what is asked", "why it is hard"]
        out.append(Table(headers, [_row(each, short) for each in mine], theme))
    counts = [[verdict, Cell(str(stressed.count(verdict)), _tone(stressed, verdict))] for verdict in VERDICTS]
    return [*out, Table(["verdict", "cases"], counts, f"{len(stressed.judged)} cases")]


def _tone(stressed: Stressed, verdict: str) -> Any:
    return "bad" if verdict in ("wrong", "crashed") and any(j.verdict == verdict for j in stressed.judged) else ""


def _row(judged: Judged, short: bool) -> list[str | Cell]:
    said = "; ".join(part for part in (judged.said, judged.note) if part)
    if short and len(said) > _SHORT:
        said = said[: _SHORT - 1] + "…"
    row: list[str | Cell] = [judged.case.name, Cell(judged.verdict, _TONES.get(judged.verdict, ""))]
    if not short:
        row[1:1] = [judged.case.stressed, judged.case.hard]
    return [*row, _number(judged.error), _number(judged.bound), said]


def _number(value: float) -> str:
    """One digit and a power of ten, with a minus that no line is broken at."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    return "0" if value == 0 else f"{value:.0e}".replace("-", "\N{MINUS SIGN}")


def publish(stressed: Stressed, out: Path, command: str) -> list[Path]:
    """Write stress.json and the report; returns the files a reader opens first."""
    summary = summarise(stressed)
    write_json(summary, out / "stress.json")
    write_report(out / "report.html", _report(stressed, summary, command))
    return [out / "report.html", out / "stress.json"]


def summarise(stressed: Stressed) -> dict[str, Any]:
    """Everything as JSON values."""
    return {
        "schema": SCHEMA,
        "scene": stressed.scene,
        "changes": list(stressed.changes),
        "sizes": stressed.sizes,
        **circumstances(stressed.builder),
        "verdicts": {verdict: stressed.count(verdict) for verdict in VERDICTS},
        "cases": [
            {
                "name": each.case.name,
                "theme": each.case.theme,
                "stressed": each.case.stressed,
                "hard": each.case.hard,
                "verdict": each.verdict,
                "error": each.error if math.isfinite(each.error) else None,
                "bound": each.bound if math.isfinite(each.bound) else None,
                "said": each.said,
                "note": each.note,
                "seconds": round(each.seconds, 3),
            }
            for each in stressed.judged
        ],
    }


def _report(stressed: Stressed, summary: dict[str, Any], command: str) -> Report:
    cards = [
        Card(verdict, str(stressed.count(verdict)), tone="bad" if verdict in ("wrong", "crashed") else "")
        for verdict in VERDICTS
        if stressed.count(verdict)
    ]
    sections = [Section("What the verdicts mean", _MEANING)]
    sections += [Section(table.caption.capitalize(), "", [table]) for table in tables(stressed, short=False)[:-1]]
    facts = {
        "Versions": summary["versions"],
        "Sizes": {name: str(value) for name, value in summary["sizes"].items()},
        "Machine": {name: str(value) for name, value in summary["machine"].items()},
        "Command": {"to repeat": command},
    }
    return Report(stressed.builder.scene.title, "what breaks first", cards, sections, Provenance(facts))


def markdown(stressed: Stressed) -> str:
    """The tables for a page of the documentation, with the scene and versions and without a date."""
    versions = stressed.builder.versions()
    named = [
        f"{name} {versions[name]}" for name in versions if name in ("dacore", "numpy", "scipy") or "backend" in name
    ]
    sizes = ", ".join(f"{value:,} {name}" for name, value in stressed.sizes.items())
    changed = "".join(f" --set {change}" for change in stressed.changes)
    counts = ", ".join(f"{stressed.count(v)} {v}" for v in VERDICTS if stressed.count(v))
    lines = [f"Scene `{stressed.scene}`{changed} ({sizes}); {', '.join(named)}: **{counts}**.", ""]
    for table in tables(stressed, short=False)[:-1]:
        lines += [f"### {table.caption.capitalize()}", "", "| " + " | ".join(table.headers) + " |"]
        lines.append("|" + "---|" * len(table.headers))
        lines += ["| " + " | ".join(_text(cell) for cell in row) + " |" for row in table.rows]
        lines.append("")
    return "\n".join(lines)


def _text(cell: str | Cell) -> str:
    text = cell if isinstance(cell, str) else f"**{cell.text}**" if cell.tone == "bad" else cell.text
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*") if isinstance(cell, str) else text


def update(stressed: Stressed, page: Path) -> None:
    """Replace the tables of a Markdown page between its two markers; StoreError without them."""
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise StoreError(f"{page}: cannot be read ({error.strerror}); expected a Markdown page") from error
    found = re.search(f"{re.escape(BEGIN)}.*?{re.escape(END)}", text, re.DOTALL)
    if found is None:
        raise StoreError(f"{page}: has no part to replace; expected lines {BEGIN} and {END}")
    new = f"{BEGIN}\n\n{markdown(stressed)}\n{END}"
    with atomic_write(page) as stream:
        stream.write(text[: found.start()] + new + text[found.end() :])
