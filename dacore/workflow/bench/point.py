"""One measured setting of a benchmark, and the errors it has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.bench.sweeps import EXACT, Sweep

MEASURED = "measured values"


@dataclass(frozen=True, eq=False)
class Point:
    """One measured setting.

    Parameters
    ----------
    sweep : Sweep
    label : str
        What it is, without the sweep's name.
    costs : mapping of str to float
        CPU seconds ("work" is what the diagram shows), MiB ("memory").
    errors : mapping of str to float
        Relative errors, by field, contrast or quantity; NaN where there is nothing to compare with.
    facts : mapping
        Sizes, library and solver.
    error : str
        Why it failed; empty if it did not.
    """

    sweep: Sweep
    label: str
    costs: Mapping[str, float]
    errors: Mapping[str, float]
    facts: Mapping[str, Any]
    error: str = ""

    @property
    def name(self) -> str:
        """Sweep and label."""
        return f"{self.sweep.name}: {self.label}" if self.label else self.sweep.name


def point(sweep: Sweep, label: str, found: Mapping[str, Any], truth: Mapping[str, Any]) -> Point:
    """Make a point of what its process found; `truth` is what the reference's found, empty if there is none."""
    if "error" in found:
        return Point(sweep, label, {}, {}, {}, found["error"])
    costs, facts = dict(found["costs"]), dict(found["facts"])
    errors: dict[str, float] = {}
    if sweep.kind in ("forward", "costs"):
        costs["work"] = costs["assembly"] + costs["analysis"] + costs["trajectory"]
        costs["memory"] = costs["memory solving"]
        costs["memory beyond the start"] = costs["memory solving"] - costs["memory before"]
        if truth and sweep.kind == "forward":
            errors = forward_errors(found["arrays"], truth["arrays"], facts["contrasts"])
    elif sweep.kind == "voxels":
        costs["work"], costs["memory"] = costs["functionals"], costs["memory solving"]
        facts["measured"] = found["arrays"]["trajectory measured"]
    else:
        costs["work"] = costs["preparing"] + costs["estimating"]
        costs["memory"] = costs["memory estimating"]
        errors = _estimate_errors(facts)
    return Point(sweep, label, costs, errors, facts)


def forward_errors(
    arrays: Mapping[str, Array], truth: Mapping[str, Array], contrasts: Sequence[Sequence[Any]]
) -> dict[str, float]:
    """Relative space–time differences at the probes, of every field and contrast."""
    out = {}
    wanted = [(name.partition(" ")[2], name, 0.0) for name in truth if name.startswith("probe ")]
    wanted += [(label, f"probe {field}", constant) for label, field, constant in contrasts]
    for label, name, constant in wanted:
        below = np.linalg.norm(truth[name] - constant)
        out[label] = float(np.linalg.norm(arrays[name] - truth[name]) / below) if below else float("nan")
    return out


def _estimate_errors(facts: Mapping[str, Any]) -> dict[str, float]:
    out: dict[str, float] = {}
    for outcome in facts["outcomes"]:
        if outcome["estimator"] != PRIOR:
            level = f", noise {outcome['noise']:g}"
            errors = {label: value["mean"] for label, value in outcome["errors"].items() if label != JOINT}
            out |= {f"{label}{level}": value for label, value in errors.items()}
    return out


def against_exact(points: Sequence[Point]) -> list[Point]:
    """Errors of quadratures: measured values of a trajectory against those of the sweep's exact point.

    Without it, or where other functionals were found, they are NaN.
    """
    finished = [point for point in points if point.sweep.kind == "voxels" and not point.error]
    exact = {point.sweep.name: point.facts["measured"] for point in finished if point.label == EXACT}
    out = []
    for each in points:
        if each in finished:
            mine, truth = each.facts["measured"], exact.get(each.sweep.name)
            gap = float("nan")
            if truth is not None and mine.shape == truth.shape:
                gap = float(np.linalg.norm(mine - truth) / np.linalg.norm(truth))
            facts = {key: value for key, value in each.facts.items() if key != "measured"}
            out.append(replace(each, errors={MEASURED: gap}, facts=facts))
        else:
            out.append(each)
    return out


def kept_arrays(path: Path) -> dict[str, Array]:
    """Read the values at the probes and what was measured, and nothing else."""
    with np.load(path) as stored:
        wanted = [name for name in stored.files if name.startswith(("probe ", "trajectory measured"))]
        return {name: stored[name] for name in wanted}
