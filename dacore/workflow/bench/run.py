"""Run a benchmark: every point in a process of its own, errors against one reference."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dacore.errors import SceneError
from dacore.io.atomic import make_folder
from dacore.io.scene import read_table
from dacore.workflow.bench.point import Point, against_exact, forward_errors, kept_arrays, point
from dacore.workflow.bench.reference import probes, references
from dacore.workflow.bench.sweeps import Kind, default_sweeps, pick
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.comparison.measure import Job
from dacore.workflow.comparison.run import checked, make_domains, run_job
from dacore.workflow.comparison.variants import Axis, Variant, combinations
from dacore.workflow.machine import usable_cores


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
    faults : mapping of str to str
        What else failed, and why: the reference, or its half.
    """

    title: str
    builder: Builder
    reference: Mapping[str, Any]
    doubt: Mapping[str, float]
    points: Sequence[Point]
    faults: Mapping[str, str]

    def of(self, kind: Kind) -> list[Point]:
        """The points of one kind that did not fail."""
        return [each for each in self.points if each.sweep.kind == kind and not each.error]

    @property
    def failures(self) -> dict[str, str]:
        """What failed, and why."""
        return {**self.faults, **{each.name: each.error for each in self.points if each.error}}


def bench(
    path: Path,
    changes: Sequence[str] = (),
    sizes: Axis | None = None,
    extra: Sequence[Sequence[Axis]] = (),
    only: Sequence[str] = (),
    cache: Path | None = None,
    workers: int | None = None,
    board: ProgressBoard | None = None,
    reference: Sequence[Axis] = (),
    larger: Axis | None = None,
) -> Bench:
    """Measure error and cost over a scene's settings.

    A point that fails is one of the result's failures, and so is the reference: without it, trajectories have
    costs and no errors.

    Parameters
    ----------
    path : Path
        The scene.
    changes : sequence of str
        ``"key=value"`` changes to it.
    sizes : Axis, optional
        Key and values that make the mesh finer, the finest last: it is the reference's.
    extra : sequence of sequences of Axis
        Other keys to vary; each is a sweep over every combination of its axes' values.
    only : sequence of str
        Kinds or starts of names of sweeps to run; all by default.
    cache : Path, optional
        Folder of kept stages; none is kept by default.
    workers : int, optional
        Processes for training.
    board : ProgressBoard, optional
    reference : sequence of Axis
        Keys of one value each that the reference has in place of its own.
    larger : Axis, optional
        Key and values whose costs alone are measured, without errors.

    Raises
    ------
    SceneError
        If a sweep is unknown or a point is not a valid scene.
    """
    table = read_table(path, changes)
    builder = checked(Variant("as it stands", table), path)
    sweeps = default_sweeps(builder, sizes, extra, larger)
    if only:
        sweeps = pick(sweeps, only)
    if not sweeps:
        raise SceneError(f"{path}: nothing to vary; name a key: --vary KEY=A,B")
    points = [(sweep, variant) for sweep in sweeps for variant in combinations(table, sweep.axes)]
    builders = [(sweep.kind, checked(variant, path)) for sweep, variant in points]
    compared = [each for kind, each in builders if kind == "forward"]
    others = [each for kind, each in builders if kind != "forward"]
    forward = any(sweep.kind == "forward" for sweep in sweeps)
    finest, coarser, differs = references(table, sizes, reference)
    if forward:
        compared.append(checked(finest, path))
    with tempfile.TemporaryDirectory(prefix="dacore-bench-") as scratch:
        kept = cache or Path(scratch) / "cache"
        make_folder(kept)
        meshes = make_domains(compared, kept)
        make_domains(others, kept)
        process = _Process(path, kept, Path(scratch), workers or usable_cores(), board or ProgressBoard())
        process.probes = probes(meshes) if forward else []
        faults: dict[str, str] = {}
        truth: Mapping[str, Any] = {}
        doubt: dict[str, float] = {}
        if forward:
            truth, why = _without_error(process.measured(finest, "forward"))
            faults |= {"the reference": why} if why else {}
        if truth and coarser is not None:
            half, why = _without_error(process.measured(coarser, "forward"))
            faults |= {"the reference with half its steps": why} if why else {}
            if half:
                doubt = forward_errors(half["arrays"], truth["arrays"], truth["facts"]["contrasts"])
        done = [point(sweep, variant.label, process.measured(variant, sweep.kind), truth) for sweep, variant in points]
    return Bench(builder.scene.title, builder, differs if forward else {}, doubt, against_exact(done), faults)


def _without_error(found: Mapping[str, Any]) -> tuple[Mapping[str, Any], str]:
    return ({}, found["error"]) if "error" in found else (found, "")


class _Process:
    """Measures one variant after the other, each in a process of its own."""

    def __init__(self, path: Path, cache: Path, scratch: Path, workers: int, board: ProgressBoard) -> None:
        self._path, self._cache, self._scratch = path, cache, scratch
        self._workers, self._board = workers, board
        self._number = 0
        self.probes: list[list[float]] = []

    def measured(self, variant: Variant, kind: Kind) -> dict[str, Any]:
        """Costs, facts and arrays of a variant; the error if it failed in whatever way."""
        folder = self._scratch / str(self._number)
        self._number += 1
        try:
            folder.mkdir()
            job = Job(
                variant.table, f"{self._path} ({variant.label})", str(self._path.parent), str(self._cache), str(folder),
                "estimate" if kind == "estimate" else "trajectory", self._workers, True,
                self.probes if kind == "forward" else (), kind != "estimate",
            )  # fmt: skip
            found = run_job(job, variant.label or "as it stands", 0, self._board)
            if "error" not in found:
                found["arrays"] = kept_arrays(folder / "arrays.npz")
                (folder / "arrays.npz").unlink()
        except (OSError, ValueError) as error:
            # No space left, or a file cut short: the other points go on.
            return {"error": f"its results cannot be read: {' '.join(str(error).split())}"}
        return found
