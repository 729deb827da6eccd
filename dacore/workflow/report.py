"""A report: one HTML file with its pictures in it, to read, print and send."""

import logging
from pathlib import Path

from dacore.io.atomic import atomic_write
from dacore.workflow.report_html import render_report
from dacore.workflow.report_parts import Card, Cell, Picture, Provenance, Report, Section, Table, Timing

__all__ = [
    "Card", "Cell", "Picture", "Provenance", "Report", "Section", "Table", "Timing", "render_report", "write_report",
]  # fmt: skip

_LARGE = 12_000_000
_log = logging.getLogger(__name__)


def write_report(path: str | Path, report: Report) -> Path:
    """Write a report as one self-contained HTML file, whole or not at all.

    Raises
    ------
    StoreError
        If the file cannot be written; what was there stays.
    """
    text = render_report(report)
    with atomic_write(path) as stream:
        size = stream.write(text)
    if size > _LARGE:
        _log.warning("report %s has %.1f MB; use SVG for line plots or fewer pictures", path, size / 1e6)
    return Path(path)
