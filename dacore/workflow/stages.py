"""The stages of a scene: which settings each depends on, and how it is made."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np

from dacore import __version__
from dacore.algebra.compress import compress
from dacore.core.arrays import Array
from dacore.core.domain import Domain
from dacore.core.mesh import Mesh
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.noise import WhiteNoise
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.training import Progress, draw, solve_all
from dacore.errors import SceneError
from dacore.io.background import read_background, write_background
from dacore.io.mesh_cache import read_mesh_cache, write_mesh_cache
from dacore.io.scene import PluginTable
from dacore.io.snapshots import TrajectoryStore
from dacore.pipeline.stage import Codec, Pipeline, Results, Stage
from dacore.studies.errors import Contrast, ErrorMeter
from dacore.studies.refinement import time_refinement
from dacore.studies.validation import validate
from dacore.workflow.build import Builder, source_hash

_log = logging.getLogger(__name__)

# The parts of dacore whose code decides what a mesh or a trajectory is.
NUMERICS = ("core", "algebra", "geometry", "domains", "dynamics")


@dataclass(frozen=True)
class TrajectorySet(Sequence[Trajectory]):
    """Trajectories in a store, read one at a time.

    Parameters
    ----------
    store : TrajectoryStore
    samples : (K, n_parameters) array
    solved : int
        How many were solved in this run.
    """

    store: TrajectoryStore
    samples: Array
    solved: int

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> list[Trajectory]: ...
    def __getitem__(self, index: int | slice) -> Trajectory | list[Trajectory]:
        if isinstance(index, slice):
            return [self.store.read(k)[0] for k in range(len(self))[index]]
        return self.store.read(range(len(self))[index])[0]

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[index] for index in range(len(self)))


class ProgressBoard:
    """Where stages report how far they are; the command line draws it."""

    def meter(self, title: str) -> Progress | None:
        """Return a callback (done, total) for one piece of work, or None for silence."""
        return None

    def stage(self, name: str, event: str) -> None:
        """Hear that stage `name` starts ("start"), is done ("done"), or was kept ("cached")."""


def scene_pipeline(builder: Builder, workers: int = 1, board: ProgressBoard | None = None) -> Pipeline:
    """Return the stages of a scene, each with exactly the settings it depends on.

    Parameters
    ----------
    builder : Builder
    workers : int
        Processes for solving; not part of any key.
    board : ProgressBoard, optional
    """
    scene, show = builder.scene, board or ProgressBoard()
    ranges = {name: table.model_dump() for name, table in scene.parameters.items()}

    def make_training(results: Results, folder: Path) -> TrajectorySet:
        model, parameters = results["model"], results["parameters"]
        samples = draw(parameters, scene.training.samples, scene.training.sampling, scene.training.seed)
        store = TrajectoryStore(folder, folder.name)
        solved = solve_all(model, parameters, samples, store, workers, show.meter("training"))
        return TrajectorySet(store, samples, solved)

    def make_truth(results: Results, folder: Path) -> TrajectorySet:
        model, parameters = results["model"], results["parameters"]
        samples = draw(parameters, scene.validation.cases, "uniform", scene.validation.seed)
        store = TrajectoryStore(folder, folder.name)
        solved = solve_all(model, parameters, samples, store, workers, show.meter("unseen cases"))
        return TrajectorySet(store, samples, solved)

    def make_background(results: Results, _: Path) -> Any:
        training: TrajectorySet = results["training"]
        settings = scene.training
        return compress(
            results["model"].space, training, results["parameters"], training.samples, settings.tolerance,
            settings.product, workers, show.meter("background"),
        )  # fmt: skip

    def make_prepared(name: str) -> Any:
        def prepare(results: Results, _: Path) -> Any:
            estimator = builder.estimators[name]
            background, functionals = results["background"], results["functionals"]
            with builder.blame(f"estimator.{name}"):
                return estimator.prepare(background, functionals, WhiteNoise(1.0))

        return prepare

    def make_checks(results: Results, _: Path) -> tuple[str, ...]:
        """What is measured and asked fits the state and the parameters: known before anything is trained.

        What to beware of is said in the log, and returned for the results.
        """
        builder.check_before_training(results["model"].space, results["parameters"])
        if scene.validation.refine_time > 1 and not isinstance(results["model"], MarchedModel):
            raise SceneError(f"{builder.where}: validation.refine_time: this model steps by itself; set it to 0")
        model: ForwardModel = results["model"]
        cautions = model.cautions(results["parameters"]) if isinstance(model, MarchedModel) else ()
        for line in cautions:
            _log.warning("%s: %s", builder.where, line)
        return cautions

    def contrasts(results: Results) -> list[Contrast]:
        return builder.contrasts(results["model"].space, results["parameters"])

    def make_validation(results: Results, _: Path) -> Any:
        return validate(
            results["background"], results["functionals"],
            {name: results[f"prepared.{name}"] for name in scene.estimator}, results["truth"], builder.quantities,
            contrasts(results), scene.noise.levels, scene.noise.seed, show.meter("errors"),
        )  # fmt: skip

    def make_refinement(results: Results, _: Path) -> Any:
        model: MarchedModel = results["model"]
        middle = {p.name: float(p.quantile(np.array(0.5))) for p in results["parameters"].parameters}
        factor = scene.validation.refine_time
        meter = ErrorMeter(
            model.space, scene.training.product, contrasts(results), {f.name: 1.0 for f in model.space.fields}
        )
        return time_refinement(model, builder.march(model.model, factor), middle, factor, meter)

    def make_mesh(domain: Domain) -> Mesh:
        with builder.blame("domain"):
            return domain.mesh()

    numerics = {"dacore": __version__, "source": source_hash("dacore", NUMERICS)}
    model_settings = {
        "time": scene.time.model_dump(),
        "solver": {"tolerance": scene.solver.tolerance, **_plugin(builder, "solver", scene.solver)},
        "numerics": numerics,
        **_plugin(builder, "model", scene.physics),
    }
    stages = []
    domain = builder.domain
    if domain is not None and scene.domain is not None:
        stages.append(
            Stage(
                "domain", (),
                {"numerics": numerics, "content": domain.fingerprint(), **_plugin(builder, "domain", scene.domain)},
                lambda _results, _folder: make_mesh(domain),
                Codec(".npz", write_mesh_cache, lambda path, _results: read_mesh_cache(path)), "mesh with roles",
            )
        )  # fmt: skip
        backend = scene.discretization.backend
        model_settings |= {
            "backend": [backend, builder.version_of("backend", backend), builder.backend_version],
        }
    stages += [
        Stage(
            "model", ("domain",) if domain is not None else (), model_settings,
            lambda results, _folder: builder.model(results["domain"] if domain is not None else None),
            purpose="parameter-free matrices",
        ),
        Stage(
            "parameters", ("model",), {"ranges": ranges},
            lambda results, _folder: builder.parameters(results["model"]), purpose="ranges",
        ),
        Stage(
            "functionals", ("model",), {name: _content(table) for name, table in scene.observation.items()},
            lambda results, _folder: builder.functionals(results["model"].space), purpose="what is measured",
        ),
        Stage(
            "checks", ("model", "parameters", "functionals"), {}, make_checks, purpose="the scene fits together",
        ),
        Stage(
            "training", ("model", "parameters"),
            scene.training.model_dump(include={"samples", "sampling", "seed"}), make_training, purpose="trajectories",
        ),
        Stage(
            "background", ("training",), scene.training.model_dump(include={"tolerance", "product"}), make_background,
            Codec(
                ".h5", write_background,
                lambda path, results: read_background(path, results["model"].space, results["parameters"]),
                ("model", "parameters"),
            ), "compressed training set",
        ),
        *(
            Stage(
                f"prepared.{name}", ("background", "functionals"), _content(table), make_prepared(name),
                purpose=table.title or table.kind,
            )
            for name, table in scene.estimator.items()
        ),
        Stage(
            "truth", ("model", "parameters"), scene.validation.model_dump(include={"cases", "seed"}), make_truth,
            purpose="unseen cases",
        ),
        Stage(
            "validation", ("background", "functionals", "truth", *(f"prepared.{name}" for name in scene.estimator)),
            {"noise": scene.noise.model_dump(), "contrasts": [c.model_dump() for c in scene.validation.contrasts]},
            make_validation, purpose="errors on unseen cases",
        ),
        Stage(
            "refinement", ("model", "parameters"), scene.validation.model_dump(include={"refine_time", "contrasts"}),
            make_refinement, purpose="discretisation error in time",
        ),
    ]  # fmt: skip
    return Pipeline(stages)


def targets(builder: Builder) -> list[str]:
    """The stages a run of the scene asks for."""
    return ["checks", "validation", *(["refinement"] if builder.scene.validation.refine_time > 1 else [])]


def _plugin(builder: Builder, kind: str, table: PluginTable) -> dict[str, Any]:
    return {**_content(table), "version": builder.version_of(kind, table.kind)}


def _content(table: PluginTable) -> dict[str, Any]:
    """What a result depends on: the kind and its settings, not the title."""
    return {"kind": table.kind, "table": table.settings}
