"""The numbers of a reconstruction: as tables to read, as CSV and as JSON to go on with."""

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from dacore.core.data import SensorData
from dacore.workflow.drawn import time_text, unit_text
from dacore.workflow.reconstruct.result import LEVEL, Reconstruction
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.results import circumstances, numbers
from dacore.workflow.tables import name_of, number_text, quantity_title, value_text

SCHEMA = 1
# More numbers of one quantity are a curve, which the CSV holds.
_MOST = 12
_TINY = 1e-5


def quantities_csv(result: Reconstruction) -> str:
    """Every quantity of interest with its interval, a row each."""
    rows = [
        [
            n.quantity,
            n.label,
            _plain(n.time),
            _plain(n.value),
            _plain(n.deviation),
            _plain(n.low),
            _plain(n.high),
            n.unit,
        ]
        for n in result.numbers
    ]
    percent = f"{100 * LEVEL:g}"
    head = [
        "quantity",
        "label",
        "time [s]",
        "value",
        "standard deviation",
        f"low {percent}%",
        f"high {percent}%",
        "unit",
    ]
    return _csv(head, rows)


def residuals_csv(result: Reconstruction) -> str:
    """What was measured and what the estimate says of it, a row for each functional and step of the scene."""
    f, used = result.target.functionals, result.used
    head = ["label", *"xyz"[: f.centres.shape[1]], "time [s]", "value", "fit", "residual", "sigma", "unit", "used"]
    rows, fit, residual = [], result.fit, result.residual
    for k in range(f.count):
        for j, step in enumerate(used.steps):
            taken = bool(used.mask[k])
            rows.append(
                [
                    f.labels[k], *map(_plain, f.centres[k]), _plain(result.target.times[step]),
                    _plain(used.values[k, j]), _plain(fit[k, j]), _plain(residual[k, j]),
                    _plain(result.sigma[k]) if taken else "", result.target.units[k], "yes" if taken else "no",
                ]
            )  # fmt: skip
    return _csv(head, rows)


def summary(result: Reconstruction, command: str) -> dict[str, Any]:
    """Everything that was found, and what it was made of, as JSON values."""
    session, used, misfit = result.session, result.used, result.estimate.misfit
    background = session.background
    out: dict[str, Any] = {
        "schema": SCHEMA,
        "title": session.scene.title,
        "command": command,
        "scene": session.scene.model_dump(mode="json"),
        "data": [
            {"file": str(s.path), "format": s.format or "mask or phase", "sha256": s.sha256} for s in result.sources
        ],
        "training": session.runner.pipeline.key("background"),
        **circumstances(session.builder),
        "seconds": round(result.seconds, 3),
        "estimator": result.estimator,
        "measurements": {
            "of_the_scene": result.target.count,
            "used": int(used.mask.sum()),
            "steps_used": (used.steps + 1).tolist(),
            "values_used": used.count,
        },
        "noise": {"least": float(result.sigma[used.mask].min()), "largest": float(result.sigma[used.mask].max())},
        "residual": {
            "root_mean_square_over_noise": numbers(result.ratio),
            "relative": numbers(
                np.linalg.norm(result.residual[used.mask]) / max(float(np.linalg.norm(used.values[used.mask])), 1e-300)
            ),
        },
        "verdict": result.verdict,
        "warnings": list(result.warnings),
        "notes": list(result.notes),
        "quantities": [
            {
                "name": n.quantity, "label": n.label, "unit": n.unit, "time": n.time, "value": numbers(n.value),
                "standard_deviation": numbers(n.deviation), "interval": [numbers(n.low), numbers(n.high)],
                "level": LEVEL, "training_mean": numbers(n.training),
            }
            for n in result.numbers
        ],
        "times": numbers(result.times),
        "modes": {name: basis.dimension for name, basis in background.bases.items()},
    }  # fmt: skip
    if misfit is not None:
        out["misfit"] = {
            "ratio": numbers(misfit.ratio[0]), "probability": numbers(misfit.probability[0]),
            "alarm": bool(misfit.alarm[0]),
        }  # fmt: skip
    if (found := result.estimate.parameters) is not None:
        out["parameters"] = {
            name: {
                "estimate": numbers(found.values[k, 0]),
                "standard_deviation": numbers(found.deviation[k, 0]),
                "deviation_of_the_prior": numbers(found.prior[k]),
                "variance_learned": numbers(found.learned[k, 0]),
            }
            for k, name in enumerate(found.names)
        }
    return out


def data_table(result: Reconstruction) -> Table:
    """What was given."""
    rows: list[list[str | Cell]] = []
    for each in result.data:
        there = int((~np.isnan(each.values)).sum())
        if isinstance(each, SensorData):
            what = f"sensors: {each.values.shape[0]}, times: {each.values.shape[1]}"
        else:
            times, parts = each.values.shape[-2:]
            what = f"image of {' × '.join(map(str, each.shape))} voxels, times: {times}, components: {parts}"
        kind = ", complex" if np.iscomplexobj(each.values) else ""
        rows.append([each.name, what + kind, unit_text(each.unit or "–"), f"{there:,}"])
    used = result.used
    return Table(
        ["data", "what", "unit", "values"], rows, "What was given",
        f"Used: {int(used.mask.sum()):,} of the scene's {result.target.count:,} measurements at {len(used.steps)} of "
        f"its {len(result.target.times)} recorded steps.",
    )  # fmt: skip


def quantity_table(result: Reconstruction) -> Table | None:
    """Quantities of interest with intervals; curves are left to the CSV."""
    rows: list[list[str | Cell]] = []
    shown = {name: [n for n in result.numbers if n.quantity == name] for name in result.session.quantities}
    for name, members in shown.items():
        for n in members if len(members) <= _MOST else members[:: max(1, len(members) // 6)]:
            when = "" if n.time is None else f", t = {time_text(n.time)}"
            span = "–"
            if np.isfinite(n.low):
                low, high = (_with_deviation(each, n.deviation).partition(" ")[0] for each in (n.low, n.high))
                span = f"{low} to {high}"
            rows.append(
                [
                    f"{quantity_title(result.session.builder, name)}{when} [{unit_text(n.unit)}]",
                    _with_deviation(n.value, n.deviation), span, Cell(number_text(n.training), "muted"),
                ]
            )  # fmt: skip
    if not rows:
        return None
    return Table(
        ["quantity", "estimate ± standard deviation", f"{100 * LEVEL:g}% interval", "training mean"], rows,
        f"Numbers of interest, by {name_of(result.session.builder, result.estimator)}",
    )  # fmt: skip


def parameter_table(result: Reconstruction) -> Table | None:
    """What was learned of the parameters; None for an estimator that finds none."""
    found = result.estimate.parameters
    if found is None:
        return None
    rows: list[list[str | Cell]] = []
    for k, name in enumerate(found.names):
        learned = float(found.learned[k, 0])
        parameter = result.session.background.parameters[name]
        rows.append(
            [
                f"{name} [{unit_text(parameter.unit)}]",
                value_text(float(found.values[k, 0]), float(found.deviation[k, 0])),
                f"{number_text(parameter.low)} to {number_text(parameter.high)}",
                Cell(f"{max(learned, 0.0):.0%}", "" if learned > 0.5 else "muted"),
            ]
        )
    return Table(
        ["parameter", "estimate ± standard deviation", "range of the scene", "variance learned"], rows,
        "Parameters of the model",
        "Of a parameter that little is learned of, the estimate is the middle of what was known.",
    )  # fmt: skip


def notes_table(result: Reconstruction) -> Table | None:
    """Warnings and suppositions; None without any."""
    rows: list[list[str | Cell]] = [[Cell(f"beware: {line}", "bad")] for line in result.warnings]
    rows += [[Cell(f"supposed: {line}", "muted")] for line in result.notes]
    return Table(["what to beware of, and what was supposed"], rows) if rows else None


def _with_deviation(value: float, deviation: float) -> str:
    """A value with its deviation; with exponents where digits after the point would show nothing."""
    if 0 < deviation < _TINY:
        return f"{number_text(value)} ± {number_text(deviation)}"
    return value_text(value, deviation)


def _plain(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else repr(float(value))


def _csv(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()
