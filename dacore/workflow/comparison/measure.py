"""One variant in a process of its own: what its parts cost, and the arrays that agreement is measured on.

Run as ``python -m dacore.workflow.comparison.measure JOB.json`` by the comparison: a process of its own
gives the real cost of starting a library and a peak of memory that is nobody else's. Progress goes
line by line to standard output, the result to ``measured.json`` and ``arrays.npz`` in the job's folder.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.threads import one_blas_thread
from dacore.core.arrays import Array, Sparse
from dacore.core.model import AffineModel, ForwardModel
from dacore.core.observation import Functionals
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.training import Progress
from dacore.errors import DacoreError
from dacore.io.scene import validate
from dacore.pipeline.runner import Runner
from dacore.reduction.training import Reduced
from dacore.studies.outcomes import Outcome
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.comparison.clock import Clocked
from dacore.workflow.laws import sizes_of
from dacore.workflow.machine import memory_now, peak_memory
from dacore.workflow.session import Session
from dacore.workflow.stages import scene_pipeline

Depth = Literal["matrices", "trajectory", "estimate"]
DEPTHS: tuple[Depth, ...] = ("matrices", "trajectory", "estimate")

T = TypeVar("T")

# Before every line meant for the comparison: a library may print what it likes.
MARK = "\x1e"


@dataclass(frozen=True)
class Job:
    """What a process measures.

    Parameters
    ----------
    table : mapping
        The scene.
    where : str
        What to call it in messages.
    base, cache, folder : str
        Folder of the scene, of kept stages, and of this job's results.
    depth : {"matrices", "trajectory", "estimate"}
        How far to go.
    workers : int
        Processes for the training.
    save : bool
        Whether to write the arrays.
    probes : sequence of d floats [cm]
        Points at which the trajectory's fields are kept too, under "probe …"; they compare across meshes.
    lean : bool
        Whether to keep of matrices and trajectories only what is measured and the values at the probes.
    """

    table: Mapping[str, Any]
    where: str
    base: str
    cache: str
    folder: str
    depth: Depth
    workers: int
    save: bool
    probes: Sequence[Sequence[float]] = ()
    lean: bool = False


class LineBoard(ProgressBoard):
    """Progress as lines of JSON."""

    def meter(self, title: str) -> Progress:
        """Report (done, total) of one piece of work."""
        return lambda done, total: tell(meter=title, done=done, total=total)

    def stage(self, name: str, event: str) -> None:
        """Report a stage's start and end."""
        tell(stage=name, event=event)


def tell(**content: Any) -> None:
    """Send one line to the comparison."""
    sys.stdout.write(f"{MARK}{json.dumps(content)}\n")
    sys.stdout.flush()


class Measurement:
    """Costs and arrays of one variant, filled step by step.

    Attributes
    ----------
    costs : dict of str to float
        Seconds of wall time ("library"), CPU seconds ("assembly") and MiB ("memory …"), by name.
    arrays : dict of str to array
        What is compared, by name.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self.costs: dict[str, float] = {}
        self.facts: dict[str, Any] = {}
        self.arrays: dict[str, Array] = {}
        self._measured: Functionals
        builder = Builder(validate(job.table, job.where), job.where, Path(job.base))
        self.costs["memory before"] = memory_now()
        builder.check()
        pipeline = scene_pipeline(builder, job.workers, LineBoard())
        sizes = sizes_of(builder.scene, builder.domain, job.workers)
        self.session = Session(builder, Runner(pipeline, Path(job.cache), sizes=sizes))

    @contextmanager
    def _timed(self, name: str, clock: Callable[[], float] = time.process_time) -> Iterator[None]:
        start = clock()
        yield
        self.costs[name] = clock() - start

    def matrices(self) -> AffineModel | ForwardModel:
        """Build the model twice: the first time the library is also imported, and compiles or warms up."""
        builder = self.session.builder
        mesh = self.session.mesh if builder.scene.domain is not None else None
        with self._timed("first assembly", time.perf_counter):
            model = builder.assemble(mesh)
        if mesh is not None:
            self.facts["library"] = builder.backend_version
        del model
        with self._timed("assembly"):
            model = builder.assemble(mesh)
        self.costs["memory assembling"] = peak_memory()
        with self._timed("functionals"):
            functionals = builder.functionals(model.space)
        self._measured = functionals
        self.facts |= {"n_dofs": model.space.n_dofs, "functionals": functionals.count}
        if mesh is not None:
            self.facts |= {"nodes": len(mesh.points), "cells": len(mesh.cells)}
        if self.job.save and not self.job.lean:
            if isinstance(model, AffineModel):
                for term in (*model.second_order, *model.first_order, *model.zeroth_order):
                    self._keep_matrix(f"matrix {term.name}", term.matrix)
                for load in model.loads:
                    start = 0.0 if load.initial is None else load.initial
                    self.arrays[f"load {load.name}"] = load.force + load.prescribed + start
            for field in model.space.fields:
                self._keep_matrix(f"matrix ⟨{field.name}, {field.name}⟩", model.space.scalar_product(field.name))
            self._keep_matrix("functionals", functionals.matrix)
        return model

    def trajectory(self, built: AffineModel | ForwardModel) -> None:
        """Solve once with parameters in the middle of their ranges."""
        builder = self.session.builder
        clock: Clocked | None = None
        with self._timed("analysis"):
            model = builder.complete(built)
            if isinstance(model, MarchedModel):
                model.method = clock = Clocked(model.method)
                _ = model.analysis
        parameters = builder.parameters(model).middle
        with self._timed("trajectory"):
            solved = model.solve(parameters)
        self.costs["memory solving"] = peak_memory()
        self.facts["steps"] = len(solved.times)
        if isinstance(model, MarchedModel) and clock is not None and clock.seconds:
            marched = len(model.grid.lengths)
            self.costs["set-up"] = float(np.mean(clock.seconds))
            self.costs["step"] = (self.costs["trajectory"] - sum(clock.seconds)) / marched
            self.facts |= {
                "marched": marched,
                "set-ups": len(clock.seconds),
                "solver": clock.solvers[-1].partition(" (")[0],
            }
        contrasts = builder.contrasts(model.space, builder.parameters(model))
        self.facts["contrasts"] = [[each.label, each.field, each.constant] for each in contrasts]
        if self.job.save:
            for field in model.space.fields:
                if not self.job.lean:
                    self.arrays[f"trajectory {field.name}"] = solved.states[model.space.layout.block(field.name)]
                if self.job.probes:
                    at = model.space.evaluation(np.array(self.job.probes), field.name)
                    self.arrays[f"probe {field.name}"] = np.asarray(at @ solved.states)
            self.arrays["trajectory measured"] = self._measured(solved.states)

    def estimate(self) -> None:
        """Train, prepare and validate every estimator, as a run of the scene does."""
        session = self.session
        validation = session.validation
        timings = session.runner.timings
        training, truth = session.runner["training"], session.runner["truth"]
        if isinstance(training, Reduced):  # the others are marched by the reduced model
            solved, trained = len(training.solved), len(training.estimates[0])
        else:
            solved, trained = training.solved, len(training)
        self.facts["trajectories"] = {"solved": solved + truth.solved, "of": trained + len(truth)}
        self.costs["training"] = timings["training"] + timings["truth"]
        self.costs["preparing"] = sum(seconds for name, seconds in timings.items() if name.startswith("prepared."))
        self.costs["memory estimating"] = peak_memory()
        layout = session.model.space.layout
        outcomes = []
        for outcome in validation.outcomes:
            outcomes.append(_figures(outcome))
            if outcome.estimate is None or not self.job.save:
                continue
            name = f"{outcome.estimator}, noise {outcome.noise:g}"
            for quantity, values in outcome.quantities.items():
                self.arrays[f"{quantity} ({name})"] = values.estimate
            state = outcome.estimate.state(series=0)
            for field in layout.fields:
                self.arrays[f"{field.name} ({name})"] = state[layout.block(field.name)]
        self.costs["estimating"] = sum(outcome.seconds for outcome in validation.outcomes)
        self.facts["outcomes"] = outcomes
        self.facts["dimensions"] = {
            name: [space.n for space in session.prepared(name).spaces()] for name in session.scene.estimator
        }

    def _keep_matrix(self, name: str, matrix: Sparse) -> None:
        for part, array in zip(
            ("data", "indices", "indptr"), (matrix.data, matrix.indices, matrix.indptr), strict=True
        ):
            self.arrays[f"{name}\n{part}"] = array
        self.arrays[f"{name}\nshape"] = np.array(matrix.shape)


def _figures(outcome: Outcome) -> dict[str, Any]:
    return {
        "estimator": outcome.estimator,
        "noise": outcome.noise,
        "errors": {
            label: {"mean": float(values.mean()), "worst": float(values.max())}
            for label, values in outcome.space_time.items()
        },
        "quantities": {
            name: {"rms_error": quantity.rms, "largest_error": quantity.worst}
            for name, quantity in outcome.quantities.items()
        },
        "seconds": outcome.seconds,
    }


def read_arrays(path: Path) -> dict[str, Array | Sparse]:
    """Read what a measurement kept: arrays, and matrices put together again."""
    with np.load(path) as stored:
        parts = {name: stored[name] for name in stored.files}
    out: dict[str, Array | Sparse] = {}
    for name, array in parts.items():
        stem, newline, part = name.partition("\n")
        if not newline:
            out[name] = array
        elif part == "data":
            given = (array, parts[f"{stem}\nindices"], parts[f"{stem}\nindptr"])
            out[stem] = csr_array(given, shape=tuple(parts[f"{stem}\nshape"]))
    return out


def measure(job: Job) -> dict[str, Any]:
    """Measure one variant as far as the job says, and write its arrays."""
    with one_blas_thread():
        measurement = Measurement(job)
        tell(stage="assembly", event="start")
        model = measurement.matrices()
        tell(stage="assembly", event="done")
        if job.depth != "matrices":
            tell(stage="trajectory", event="start")
            measurement.trajectory(model)
            tell(stage="trajectory", event="done")
        del model
        if job.depth == "estimate" and job.save:
            measurement.estimate()
    if job.save:
        stored: dict[str, Any] = measurement.arrays
        np.savez(Path(job.folder) / "arrays.npz", **stored)
    return {"costs": measurement.costs, "facts": measurement.facts}


def main(path: str) -> int:
    """Measure the job in a file; an error becomes part of the result."""
    job = Job(**json.loads(Path(path).read_text(encoding="utf-8")))
    try:
        result = measure(job)
    except DacoreError as error:
        result = {"error": " ".join(str(error).split())}
    except Exception as error:  # noqa: BLE001 (a library may raise anything, and the other variants go on)
        result = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    (Path(job.folder) / "measured.json").write_text(json.dumps(result), encoding="utf-8")
    return 0


def write_job(job: Job) -> Path:
    """Write a job to its folder."""
    path = Path(job.folder) / "job.json"
    path.write_text(json.dumps(asdict(job)), encoding="utf-8")
    return path


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
