"""Run a benchmark: every point in a process of its own, errors against one reference."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dacore.core.arrays import Array, Sparse
from dacore.core.mesh import Mesh
from dacore.errors import SceneError, ShapeError
from dacore.geometry.locate import PointLocator
from dacore.io.atomic import make_folder
from dacore.io.scene import read_table
from dacore.studies.errors import JOINT
from dacore.studies.validation import PRIOR
from dacore.workflow.bench.sweeps import Kind, Sweep, damped_time, default_sweeps, pick
from dacore.workflow.build import Builder
from dacore.workflow.comparison.measure import Job, read_arrays
from dacore.workflow.comparison.run import checked, make_domains, run_job
from dacore.workflow.comparison.variants import Axis, Variant, combinations
from dacore.workflow.machine import usable_cores
from dacore.workflow.stages import ProgressBoard

PROBES = 400
# The reference divides the finest steps further, damps what they do not resolve, and solves to rounding.
REFERENCE_SUBSTEPS = 32
REFERENCE_GRADED = 8


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
        Relative errors, by field, contrast or quantity.
    facts : mapping
        Sizes and library.
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


@dataclass(frozen=True, eq=False)
class Bench:
    """Everything a benchmark measured.

    Parameters
    ----------
    title : str
    builder : Builder
        Of the scene as it stands.
    reference : mapping of str to object
        The settings of the reference that differ from the scene.
    doubt : mapping of str to float
        How far the reference moves when its steps are halved again: errors near it are not to be trusted.
    points : sequence of Point
    """

    title: str
    builder: Builder
    reference: Mapping[str, Any]
    doubt: Mapping[str, float]
    points: Sequence[Point]

    def of(self, kind: Kind) -> list[Point]:
        """The points of one kind that did not fail."""
        return [point for point in self.points if point.sweep.kind == kind and not point.error]


def bench(
    path: Path,
    changes: Sequence[str] = (),
    sizes: Axis | None = None,
    extra: Sequence[Axis] = (),
    only: Sequence[str] = (),
    cache: Path | None = None,
    workers: int | None = None,
    board: ProgressBoard | None = None,
) -> Bench:
    """Measure error and cost over a scene's settings.

    Parameters
    ----------
    path : Path
        The scene.
    changes : sequence of str
        ``"key=value"`` changes to it.
    sizes : Axis, optional
        Key and values that make the mesh finer, the finest last: it is the reference's.
    extra : sequence of Axis
        Other keys to vary; a sweep each.
    only : sequence of str
        Kinds or starts of names of sweeps to run; all by default.
    cache : Path, optional
        Folder of kept stages; none is kept by default.
    workers : int, optional
        Processes for training.
    board : ProgressBoard, optional

    Raises
    ------
    SceneError
        If a sweep is unknown or a point is not a valid scene.
    """
    board = board or ProgressBoard()
    table = read_table(path, changes)
    builder = checked(Variant("as it stands", table), path)
    sweeps = default_sweeps(builder, sizes, extra)
    if only:
        sweeps = pick(sweeps, only)
    if not sweeps:
        raise SceneError(f"{path}: nothing to vary; name a key: --vary KEY=A,B")
    points = [(sweep, variant) for sweep in sweeps for variant in combinations(table, sweep.axes)]
    builders = [checked(variant, path) for _, variant in points]
    reference, differs = _reference(table, sizes, REFERENCE_SUBSTEPS)
    coarser, _ = _reference(table, sizes, REFERENCE_SUBSTEPS // 2)
    forward = any(sweep.kind == "forward" for sweep in sweeps)
    with tempfile.TemporaryDirectory(prefix="dacore-bench-") as scratch:
        kept = cache or Path(scratch) / "cache"
        make_folder(kept)
        meshes = make_domains([*builders, checked(reference, path)], kept)
        probes = _probes(meshes) if forward else ()

        def measured(variant: Variant, kind: Kind, number: str) -> dict[str, Any]:
            folder = Path(scratch) / number
            folder.mkdir()
            job = Job(
                variant.table, f"{path} ({variant.label})", str(path.parent), str(kept), str(folder),
                "estimate" if kind == "estimate" else "trajectory", workers or usable_cores(), True,
                probes if kind == "forward" else (),
            )  # fmt: skip
            found = run_job(job, variant.label or "as it stands", 0, board)
            if "error" not in found:
                arrays = read_arrays(folder / "arrays.npz")
                wanted = ("probe", "trajectory measured")
                found["arrays"] = {name: array for name, array in arrays.items() if name.startswith(wanted)}
                (folder / "arrays.npz").unlink()
            return found

        truth: dict[str, Any] = measured(reference, "forward", "reference") if forward else {}
        half: dict[str, Any] = measured(coarser, "forward", "coarser") if forward else {}
        for each in (truth, half):
            if "error" in each:
                raise SceneError(f"{path}: the reference failed: {each['error']}")
        doubt = _forward_errors(half["arrays"], truth["arrays"], truth["facts"]["contrasts"]) if forward else {}
        done = [
            _point(sweep, variant, measured(variant, sweep.kind, str(k)), truth)
            for k, (sweep, variant) in enumerate(points)
        ]
    return Bench(builder.scene.title, builder, differs if forward else {}, doubt, _against_exact(done))


def _reference(table: Mapping[str, Any], sizes: Axis | None, substeps: int) -> tuple[Variant, dict[str, Any]]:
    """The finest that the benchmark computes: finest mesh, short damped steps, tight solves."""
    differs: dict[str, Any] = {
        "time": damped_time(dict(table.get("time", {})), substeps, REFERENCE_GRADED),
        "solver.tolerance": 1e-12,
    }
    if sizes is not None:
        differs[sizes.key] = sizes.values[-1]
    made = combinations(table, [Axis(key, (value,)) for key, value in differs.items()])[0]
    return Variant(f"reference, {substeps} substeps", made.table), differs


def _probes(meshes: Sequence[Mesh]) -> list[list[float]]:
    """Points inside every mesh, spread over the first one's cells."""
    coarse = min(meshes, key=lambda mesh: len(mesh.points))
    centres = coarse.points[coarse.cells].mean(axis=1)
    rng = np.random.default_rng(0)
    chosen = centres[rng.permutation(len(centres))[: 2 * PROBES]]
    inside = np.ones(len(chosen), dtype=bool)
    for mesh in meshes:
        inside &= PointLocator(mesh.points, mesh.cells).locate(chosen, "mark")[0] >= 0
    found: list[list[float]] = chosen[inside][:PROBES].tolist()
    if not found:
        raise ShapeError("bench: no point lies inside all meshes; the sizes must be of one domain")
    return found


def _point(sweep: Sweep, variant: Variant, found: dict[str, Any], truth: dict[str, Any]) -> Point:
    if "error" in found:
        return Point(sweep, variant.label, {}, {}, {}, found["error"])
    costs, facts = dict(found["costs"]), dict(found["facts"])
    if sweep.kind == "forward":
        costs["work"] = costs["assembly"] + costs["analysis"] + costs["trajectory"]
        costs["memory"] = costs["memory solving"]
        errors = _forward_errors(found["arrays"], truth["arrays"], facts["contrasts"])
    elif sweep.kind == "voxels":
        costs["work"], costs["memory"] = costs["functionals"], costs["memory solving"]
        errors = {}
        facts["measured"] = found["arrays"]["trajectory measured"]
    else:
        costs["work"] = costs["preparing"] + costs["estimating"]
        costs["memory"] = costs["memory estimating"]
        errors = _estimate_errors(facts)
    return Point(sweep, variant.label, costs, errors, facts)


def _forward_errors(
    arrays: Mapping[str, Array | Sparse], truth: Mapping[str, Array | Sparse], contrasts: Sequence[Sequence[Any]]
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


def _against_exact(points: Sequence[Point]) -> list[Point]:
    """Errors of quadratures: measured values of a trajectory against those of the sweep's last point, the exact one."""
    exact: dict[str, Array] = {}
    for point in points:
        if point.sweep.kind == "voxels" and not point.error:
            exact[point.sweep.name] = point.facts["measured"]
    out = []
    for point in points:
        if point.sweep.kind == "voxels" and not point.error:
            facts = {key: value for key, value in point.facts.items() if key != "measured"}
            mine, truth = point.facts["measured"], exact[point.sweep.name]
            same = mine.shape == truth.shape
            gap = float(np.linalg.norm(mine - truth) / np.linalg.norm(truth)) if same else float("nan")
            out.append(Point(point.sweep, point.label, point.costs, {"measured values": gap}, facts))
        else:
            out.append(point)
    return out
