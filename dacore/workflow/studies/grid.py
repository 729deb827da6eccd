"""Settings × estimators × noise levels: the table that most studies end in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR, Outcome, Validation
from dacore.workflow.build import Builder
from dacore.workflow.canvas import Canvas
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.studies.study import Findings, Score
from dacore.workflow.tables import name_of, noise_name, number_text, percent, quantity_title, tone_of

_STATISTICS = ("mean", "worst", "rms", "largest", "alarms")


@dataclass(frozen=True, eq=False)
class Grid:
    """Errors of every estimator at every noise level in every setting.

    Parameters
    ----------
    settings, estimators : tuple of str
        Estimators with the training mean ("prior") first.
    levels : tuple of float
    errors, quantities : tuple of str
        Labels of relative errors; names of quantities.
    mean, worst : (settings, estimators, levels, errors) array
        Relative space–time errors over the cases.
    rms, largest : (settings, estimators, levels, quantities) array
    alarms : (settings, estimators, levels) array
        Share of the cases whose data contradict the estimator; NaN where it does not tell.
    """

    settings: tuple[str, ...]
    estimators: tuple[str, ...]
    levels: tuple[float, ...]
    errors: tuple[str, ...]
    quantities: tuple[str, ...]
    mean: Array
    worst: Array
    rms: Array
    largest: Array
    alarms: Array

    @classmethod
    def of(cls, found: Mapping[str, Validation], estimators: Sequence[str], levels: Sequence[float]) -> "Grid":
        """Collect the outcomes of several settings.

        Parameters
        ----------
        found : mapping of str to Validation
            By the name of the setting.
        estimators : sequence of str
        levels : sequence of float
        """
        if not found:
            raise ShapeError("study: got no settings, expected at least one")
        first = next(iter(found.values()))
        errors = tuple(label for label in first.errors if label != JOINT)
        quantities = tuple(first.outcomes[0].quantities)
        names = (PRIOR, *estimators)
        table = [[[each.outcome(name, level) for level in levels] for name in names] for each in found.values()]

        def collect(take: Any) -> Array:
            return np.array([[[take(one) for one in row] for row in rows] for rows in table], dtype=np.float64)

        return cls(
            tuple(found), names, tuple(levels), errors, quantities,
            collect(lambda o: [o.space_time[label].mean() for label in errors]),
            collect(lambda o: [o.space_time[label].max() for label in errors]),
            collect(lambda o: [o.quantities[name].rms for name in quantities]),
            collect(lambda o: [o.quantities[name].worst for name in quantities]),
            collect(_alarms),
        )  # fmt: skip

    def findings(self, **facts: Any) -> Findings:
        """What is kept of it, with more facts beside it."""
        names = {key: list(getattr(self, key)) for key in ("settings", "estimators", "levels", "errors", "quantities")}
        return Findings({key: getattr(self, key) for key in _STATISTICS}, {**names, **facts})

    @classmethod
    def kept(cls, found: Findings) -> "Grid":
        """Return the grid of findings."""
        facts = found.facts
        return cls(
            tuple(facts["settings"]), tuple(facts["estimators"]), tuple(facts["levels"]), tuple(facts["errors"]),
            tuple(facts["quantities"]), *(found.arrays[key] for key in _STATISTICS),
        )  # fmt: skip

    def tables(self, canvas: Canvas, note: str = "", alarms: bool = False) -> list[Table]:
        """One table a noise level: settings and estimators down, errors across.

        Parameters
        ----------
        canvas : Canvas
        note : str
        alarms : bool
            Whether to show how often the data contradict the estimator.
        """
        builder = canvas.session.builder
        titles = [
            f"{quantity_title(builder, name)}, rms (max) [{canvas.quantity_unit(name)}]" for name in self.quantities
        ]
        headers = ["setting", "estimate", *(f"e of {label}" for label in self.errors), *titles]
        headers += ["alarm"] if alarms else []
        return [
            Table(headers, self._rows(builder, level, alarms), f"{noise_name(self.levels[level])}: mean (worst)", note)
            for level in range(len(self.levels))
        ]

    def _rows(self, builder: Builder, level: int, alarms: bool) -> list[list[str | Cell]]:
        rows: list[list[str | Cell]] = []
        for s, setting in enumerate(self.settings):
            numbers = np.concatenate([self.mean[s, :, level], self.rms[s, :, level]], axis=1)
            best = np.nanargmin(np.where(np.isfinite(numbers[1:]), numbers[1:], np.inf), axis=0) + 1
            for e, name in enumerate(self.estimators):
                tones = [
                    tone_of(e, int(best[k]), float(numbers[e, k]), float(numbers[0, k]))
                    for k in range(numbers.shape[1])
                ]
                texts = [
                    f"{percent(float(a))} ({percent(float(b))})"
                    for a, b in zip(self.mean[s, e, level], self.worst[s, e, level], strict=True)
                ] + [
                    f"{number_text(float(a))} ({number_text(float(b))})"
                    for a, b in zip(self.rms[s, e, level], self.largest[s, e, level], strict=True)
                ]
                cells = [Cell(text, tone) for text, tone in zip(texts, tones, strict=True)]
                share = float(self.alarms[s, e, level])
                told = [Cell("–" if np.isnan(share) else percent(share))] if alarms else []
                title = Cell(name_of(builder, name), "muted" if e == 0 else "")
                rows.append([setting if e == 0 else "", title, *cells, *told])
        return rows

    def scores(self) -> list[Score]:
        """Every mean error and root mean square, for the table of all studies."""
        return [
            Score(f"{setting}, {noise_name(level)}", name, label, float(values[s, e, k, j]))
            for s, setting in enumerate(self.settings)
            for k, level in enumerate(self.levels)
            for e, name in enumerate(self.estimators)
            for values, labels in ((self.mean, self.errors), (self.rms, self.quantities))
            for j, label in enumerate(labels)
        ]


def _alarms(outcome: Outcome) -> float:
    return float("nan") if outcome.misfit is None else float(outcome.misfit.alarm.mean())
