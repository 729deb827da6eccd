"""What studies add to the results: sections of the report, figures, numbers, and one table of them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dacore.studies.outcomes import PRIOR
from dacore.workflow.build import Builder
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn
from dacore.workflow.report_parts import Cell, Picture, Section, Table
from dacore.workflow.results import numbers
from dacore.workflow.session import Session
from dacore.workflow.studies.stage import STUDY
from dacore.workflow.studies.study import Exhibit, Findings, Score
from dacore.workflow.tables import name_of, number_text, percent, quantity_title, tone_of


@dataclass(frozen=True, eq=False)
class Shown:
    """A study as the report shows it.

    Parameters
    ----------
    name, title : str
    exhibit : Exhibit
    """

    name: str
    title: str
    exhibit: Exhibit

    @property
    def drawn(self) -> list[Drawn]:
        """Its figures."""
        return [part for part in self.exhibit.parts if isinstance(part, Drawn)]

    @property
    def tables(self) -> list[Table]:
        """Its tables."""
        return [part for part in self.exhibit.parts if isinstance(part, Table)]

    def section(self, pictures: Mapping[str, Picture]) -> Section:
        """Its section, with the figures as they were drawn."""
        parts = [part if isinstance(part, Table) else pictures[part.name] for part in self.exhibit.parts]
        return Section(self.title, self.exhibit.text, parts)


def show_studies(canvas: Canvas) -> list[Shown]:
    """Show every study of a scene, in its order."""
    session, out = canvas.session, []
    for name, study in session.builder.studies.items():
        title = session.scene.study[name].title or study.heading
        exhibit = study.show(session.runner[f"{STUDY}{name}"], canvas)
        # Two studies of one kind would draw over each other.
        parts = [
            replace(part, name=f"study_{name}_{part.name}") if isinstance(part, Drawn) else part
            for part in exhibit.parts
        ]
        out.append(Shown(name, title, replace(exhibit, parts=parts)))
    return out


def score_tables(builder: Builder, units: Mapping[str, str], shown: Sequence[Shown], headline: str) -> list[Table]:
    """All studies side by side: the headline error and every quantity, settings down, estimators across."""
    scores = [(each, score) for each in shown for score in each.exhibit.scores]
    labels = [label for label in (headline, *units) if any(score.label == label for _, score in scores)]
    return [_score_table(builder, units, [s for s in scores if s[1].label == label], label) for label in labels]


def _score_table(
    builder: Builder, units: Mapping[str, str], scores: Sequence[tuple[Shown, Score]], label: str
) -> Table:
    cells = {(study.name, score.setting, score.estimator): score.value for study, score in scores}
    columns = [PRIOR, *(name for name in builder.scene.estimator if any(s.estimator == name for _, s in scores))]
    titles = {study.name: study.title for study, _ in scores}
    rows: list[list[str | Cell]] = []
    before = ""
    for study, setting in dict.fromkeys((study.name, score.setting) for study, score in scores):
        values = [cells.get((study, setting, name), float("nan")) for name in columns]
        known = [k for k in range(1, len(values)) if values[k] == values[k]]
        best = min(known, key=values.__getitem__) if known else 0
        row: list[str | Cell] = [titles[study] if study != before else "", setting]
        before = study
        for k, value in enumerate(values):
            if value != value:
                row.append(Cell("–", "muted"))
            else:
                text = number_text(value) if label in units else percent(value)
                row.append(Cell(text, tone_of(k, best, value, values[0] if values[0] == values[0] else value)))
        rows.append(row)
    what = f"{quantity_title(builder, label)}, rms [{units[label]}]" if label in units else f"error of {label}, mean"
    headers = ["study", "setting", *(name_of(builder, name) for name in columns)]
    return Table(headers, rows, what, "Green: the best of its row; red: worse than guessing the training mean.")


def study_numbers(session: Session) -> dict[str, Any]:
    """Every array and fact of every study, as JSON values."""
    out = {}
    for name, table in session.scene.study.items():
        found: Findings = session.runner[f"{STUDY}{name}"]
        arrays = {key: numbers(values) for key, values in found.arrays.items()}
        out[name] = {"kind": table.kind, "settings": table.settings, "facts": dict(found.facts), "arrays": arrays}
    return out
