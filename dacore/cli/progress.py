"""What the command line draws: progress bars, the plan, the plugins, the end of a run."""

import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as RichTable
from rich.text import Text

from dacore.pipeline.costs import memory_text, seconds_text
from dacore.pipeline.runner import PlannedStage
from dacore.plugins.registry import Row
from dacore.workflow.board import ProgressBoard
from dacore.workflow.report_parts import Cell, Table

TONE_STYLE = {"": "", "best": "bold green", "bad": "red", "muted": "dim"}
STATUS_STYLE = {"run": "bold", "resume": "bold", "cached": "green", "skipped": "dim"}


class RichBoard(ProgressBoard):
    """Progress bars on a terminal, plain lines elsewhere."""

    def __init__(self) -> None:
        self.console = Console()
        self.bars = Progress(
            TextColumn("  {task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn("left"), TimeRemainingColumn(), console=self.console, transient=True,
        )  # fmt: skip
        self._started: dict[str, float] = {}

    def __enter__(self) -> Self:
        self.bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bars.stop()

    def meter(self, title: str) -> "_Meter":
        """Draw a bar for one piece of work."""
        return _Meter(self.bars, self.bars.add_task(title, total=None))

    def stage(self, name: str, event: str) -> None:
        """Say that a stage was read from the cache or is done."""
        if event == "start":
            self._started[name] = time.perf_counter()
        elif event == "cached":
            self.bars.print(f"  [green]kept[/]  {name}", highlight=False)
        else:
            seconds = time.perf_counter() - self._started[name]
            self.bars.print(f"  [bold]done[/]  {name:<22}{seconds:8.1f} s", highlight=False)

    def show(self, tables: Sequence[Table], files: Sequence[Path]) -> None:
        """Print the tables and where the results are."""
        for table in tables:
            shown = RichTable(
                title=Text(table.caption), title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False,
                caption=Text(table.note) if table.note else None, caption_justify="left",
            )  # fmt: skip
            for k, header in enumerate(table.headers):
                shown.add_column(Text(header), justify="left" if k == 0 else "right")
            for row in table.rows:
                shown.add_row(*(_cell(cell) for cell in row))
            self.console.print(shown)
        for path in files:
            self.console.print(f"  {path}", highlight=False, soft_wrap=True)


def _cell(cell: str | Cell) -> Text:
    if isinstance(cell, str):
        return Text(cell)
    return Text(cell.text, style=TONE_STYLE[cell.tone])


class _Meter:
    """A callback that moves one bar."""

    def __init__(self, bars: Progress, task: TaskID) -> None:
        self.bars, self.task = bars, task

    def __call__(self, done: int, total: int) -> None:
        self.bars.update(self.task, completed=done, total=total, visible=done < total)


def print_plan(rows: Sequence[PlannedStage]) -> None:
    """Print a plan as a table, with what it takes in all."""
    table = RichTable(box=SIMPLE_HEAD, pad_edge=False, show_footer=True)
    known = [row.cost for row in rows if row.cost is not None]
    unknown = any(row.cost is None and row.status != "skipped" for row in rows)
    total = ""
    if known:
        total = f"{seconds_text(sum(cost.seconds for cost in known))}{' and more' if unknown else ''}"
    memory = memory_text(max(cost.memory for cost in known)) if known else ""
    for header, footer in (
        ("stage", "in all"),
        ("", ""),
        ("about", total),
        ("memory", memory),
        ("why", ""),
        ("what", ""),
    ):
        table.add_column(header, Text(footer), justify="right" if header in ("about", "memory") else "left")
    for row in rows:
        table.add_row(
            row.name, f"[{STATUS_STYLE[row.status]}]{row.status}[/]", *_costs(row), Text(row.why), Text(row.purpose)
        )
    console = Console()
    console.print(table)
    console.print(Text(_whence(rows, unknown), style="dim"))


def _costs(row: PlannedStage) -> tuple[str, str]:
    if row.cost is None:
        return ("", "") if row.status == "skipped" else ("?", "?")
    if row.cost.seconds == 0 and row.cost.memory == 0:
        return "", ""
    return seconds_text(row.cost.seconds), memory_text(row.cost.memory)


def _whence(rows: Sequence[PlannedStage], unknown: bool) -> str:
    if unknown:
        return "?: the size is not known before the model is made; plan again when it is."
    if any(row.measured for row in rows):
        return "Estimated by growth laws, corrected by what stages took in this cache."
    return "Estimated by growth laws alone, within a factor of 3; this cache has not measured anything yet."


def print_plugins(rows: Sequence[Row]) -> None:
    """Print installed plugins as a table, with where they come from if there is room."""
    console = Console()
    wide = console.width >= 120
    table = RichTable(box=SIMPLE_HEAD, pad_edge=False)
    for header in ("kind", "name", "status", *(["from"] if wide else []), "what"):
        table.add_column(header, overflow="fold")
    for row in rows:
        ready = row.status == "ready"
        status = Text(row.status, style="green" if ready else "red")
        if row.install:
            status.append(f"\n{row.install}", style="")
        origin, what = f"{row.distribution} {row.version}".strip(), row.summary
        if not wide and (not row.version or row.status.startswith("failed")):
            what = f"{what} (from {origin})".strip()  # of a scene's own file, or one that somebody has to look for
        table.add_row(row.kind, row.name, status, *([origin] if wide else []), what)
    console.print(table)
