"""Run a comparison: every variant in a process of its own, in turn, several rounds."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dacore.core.mesh import Mesh
from dacore.errors import SceneError
from dacore.io.atomic import make_folder
from dacore.io.scene import read_table, validate
from dacore.pipeline.runner import Runner
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.comparison.agreement import Agreement, agreement
from dacore.workflow.comparison.measure import DEPTHS, MARK, Depth, Job, read_arrays, write_job
from dacore.workflow.comparison.variants import Axis, Variant, variants
from dacore.workflow.machine import usable_cores
from dacore.workflow.stages import scene_pipeline


@dataclass(frozen=True, eq=False)
class Measured:
    """What became of one variant.

    Parameters
    ----------
    label : str
    rounds : sequence of mapping of str to float
        Costs of each round, by name.
    facts : mapping
        Sizes, library version and, at depth "estimate", errors of every estimator.
    agreement : Agreement or None
        With the reference; None for the reference itself.
    error : str
        Why it failed; empty if it did not.
    """

    label: str
    rounds: Sequence[Mapping[str, float]]
    facts: Mapping[str, Any]
    agreement: Agreement | None
    error: str = ""

    def cost(self, name: str) -> float:
        """Median over the rounds that measured it, NaN if none did; the first round of what happens once."""
        values = [costs[name] for costs in self.rounds if name in costs]
        if not values:
            return float("nan")
        return values[0] if name == "first assembly" else float(np.median(values))


@dataclass(frozen=True, eq=False)
class Comparison:
    """The variants of a scene side by side.

    Parameters
    ----------
    title : str
        Of the scene.
    axes : sequence of Axis
    depth : {"matrices", "trajectory", "estimate"}
    variants : sequence of Measured
        The first that did not fail is the reference of the agreement.
    builders : sequence of Builder
        Of each variant's scene.
    """

    title: str
    axes: Sequence[Axis]
    depth: Depth
    variants: Sequence[Measured]
    builders: Sequence[Builder]

    @property
    def finished(self) -> list[Measured]:
        """The variants that did not fail."""
        return [each for each in self.variants if not each.error]

    @property
    def reference(self) -> str:
        """Label of the variant that the others are held against."""
        return self.finished[0].label if self.finished else "–"


def compare(
    path: Path,
    axes: Sequence[Axis],
    changes: Sequence[str] = (),
    cache: Path | None = None,
    depth: Depth = "estimate",
    rounds: int = 3,
    workers: int | None = None,
    board: ProgressBoard | None = None,
) -> Comparison:
    """Measure every variant of a scene.

    Costs are measured `rounds` times, all variants in turn, so that a busy moment of the machine does
    not fall on one of them alone; training and estimation run once.

    Parameters
    ----------
    path : Path
        The scene.
    axes : sequence of Axis
        What differs.
    changes : sequence of str
        ``"key=value"`` changes common to all variants.
    cache : Path, optional
        Folder of kept stages, shared by the variants as far as their stages are the same; none is kept by default.
    depth : {"matrices", "trajectory", "estimate"}
    rounds : int
    workers : int, optional
        Processes for the training; all usable cores by default.
    board : ProgressBoard, optional

    Raises
    ------
    SceneError
        If there is nothing to compare or a variant is not a valid scene.
    MissingDependencyError
        If a variant needs a library that is not installed.
    """
    if depth not in DEPTHS:
        raise SceneError(f"--until: got {depth!r}, expected one of {', '.join(DEPTHS)}")
    if rounds < 1:
        raise SceneError(f"--rounds: got {rounds}, expected at least 1")
    board = board or ProgressBoard()
    chosen = variants(read_table(path, changes), axes)
    builders = [checked(variant, path) for variant in chosen]
    with tempfile.TemporaryDirectory(prefix="dacore-compare-") as scratch:
        kept = cache or Path(scratch) / "cache"
        make_folder(kept)
        make_domains(builders, kept)
        results: list[list[dict[str, Any]]] = [[] for _ in chosen]
        for number in range(rounds):
            for k, variant in enumerate(chosen):
                if any("error" in result for result in results[k]):
                    continue
                folder = Path(scratch) / str(k)
                folder.mkdir(exist_ok=True)
                job = Job(
                    variant.table, f"{path} ({variant.label})", str(path.parent), str(kept), str(folder), depth,
                    workers or usable_cores(), save=number == 0,
                )  # fmt: skip
                results[k].append(run_job(job, variant.label, number, board))
        return Comparison(builders[0].scene.title, axes, depth, _collect(chosen, results, Path(scratch)), builders)


def checked(variant: Variant, path: Path) -> Builder:
    """Return what makes a variant's objects; SceneError if it is not a valid scene."""
    where = f"{path} ({variant.label})"
    builder = Builder(validate(variant.table, where), where, path.parent)
    builder.check()
    return builder


def make_domains(builders: Sequence[Builder], cache: Path) -> list[Mesh]:
    """Make every different domain once, before anything is measured: or the first variant would pay for it."""
    different = {str(each.scene.domain): each for each in builders if each.scene.domain is not None}
    return [Runner(scene_pipeline(each), cache)["domain"] for each in different.values()]


def run_job(job: Job, label: str, number: int, board: ProgressBoard) -> dict[str, Any]:
    """Run a job in a process of its own and return its result."""
    out = Path(job.folder) / "measured.json"
    out.unlink(missing_ok=True)
    name = f"{label}, round {number + 1}"
    board.stage(name, "start")
    # One thread each, also where a library reads the number at its start only.
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "dacore.workflow.comparison.measure", str(write_job(job))]
    with (
        (Path(job.folder) / "stderr").open("w+b") as errors,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, stdin=subprocess.DEVNULL, env={**os.environ, **threads},
            encoding="utf-8", errors="replace",
        ) as process,
    ):  # fmt: skip
        _listen(process, label, board)
        code = process.wait()
        errors.seek(0)
        said = errors.read().decode("utf-8", "replace").strip().splitlines()
    if not out.exists():
        how = f"was stopped by signal {-code}" if code < 0 else f"ended with code {code}"
        return {"error": f"its process {how}" + (f": {said[-1]}" if said else "")}
    board.stage(name, "done")
    result: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return result


def _listen(process: "subprocess.Popen[str]", label: str, board: ProgressBoard) -> None:
    """Pass a process's progress on to the board."""
    meters: dict[str, Any] = {}
    for line in process.stdout or ():
        if not line.startswith(MARK):
            continue
        with contextlib.suppress(json.JSONDecodeError):
            content = json.loads(line[1:])
            if "meter" in content:
                title = content["meter"]
                if title not in meters:
                    meters[title] = board.meter(f"{label}: {title}")
                if meters[title] is not None:
                    meters[title](content["done"], content["total"])


def _collect(chosen: Sequence[Variant], results: Sequence[list[dict[str, Any]]], scratch: Path) -> list[Measured]:
    out: list[Measured] = []
    reference = None
    for k, (variant, rounds) in enumerate(zip(chosen, results, strict=True)):
        error = next((result["error"] for result in rounds if "error" in result), "")
        if error:
            out.append(Measured(variant.label, [], {}, None, error))
            continue
        arrays = read_arrays(scratch / str(k) / "arrays.npz")
        held = None if reference is None else agreement(arrays, reference)
        if reference is None:
            reference = arrays
        del arrays
        (scratch / str(k) / "arrays.npz").unlink()
        out.append(Measured(variant.label, [result["costs"] for result in rounds], rounds[0]["facts"], held))
    return out
