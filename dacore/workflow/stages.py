"""The stages of a scene: which settings each depends on, and how it is made."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dacore import __version__
from dacore.core.domain import Domain
from dacore.core.estimator import Estimate, PreparedEstimator
from dacore.core.mesh import Mesh
from dacore.core.model import ForwardModel
from dacore.core.noise import WhiteNoise
from dacore.core.observation import Functionals
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.march import MarchedModel
from dacore.errors import SceneError
from dacore.io.functionals import read_functionals, write_functionals
from dacore.io.mesh_cache import read_mesh_cache, write_mesh_cache
from dacore.io.scene import Observed, PluginTable, Scene
from dacore.pipeline.stage import Codec, Pipeline, Results, Stage
from dacore.plugins.versions import source_hash
from dacore.reduction.kinds import Reducible
from dacore.studies.errors import Contrast, ErrorMeter, ProjectedErrors
from dacore.studies.kept import (
    read_judged,
    read_measured,
    read_reference,
    read_refinement,
    write_judged,
    write_measured,
    write_reference,
    write_refinement,
)  # fmt: skip
from dacore.studies.noisy import NoisyData
from dacore.studies.outcomes import Judged, Validation
from dacore.studies.reduction import unseen_errors
from dacore.studies.reference import measure, project
from dacore.studies.refinement import time_refinement
from dacore.studies.validation import PRODUCT, Judge, gather, joint_weights
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.faults import guarded
from dacore.workflow.groundwork import groundwork_stages
from dacore.workflow.laws import priced
from dacore.workflow.studies.stage import STUDY, Means, study_stages
from dacore.workflow.trained import training_stages

_log = logging.getLogger(__name__)

# The parts of dacore whose code decides what a mesh or a trajectory is.
NUMERICS = ("core", "algebra", "geometry", "domains", "dynamics")
# The parts whose code decides how the unseen cases are measured and judged.
JUDGING = ("core", "algebra", "studies")


def scene_pipeline(
    builder: Builder, workers: int = 1, board: ProgressBoard | None = None, scheduler: str | None = None
) -> Pipeline:
    """Return the stages of a scene, each with exactly the settings it depends on.

    Parameters
    ----------
    builder : Builder
    workers : int
        Processes for solving; not part of any key.
    board : ProgressBoard, optional
    scheduler : str, optional
        Of a dask cluster whose workers solve instead; not part of any key either.
    """
    scene, show = builder.scene, board or ProgressBoard()
    ranges = {name: table.model_dump() for name, table in scene.parameters.items()}
    reduced = scene.training.method == "reduced"
    trained, truth = training_stages(builder, workers, show, scheduler)
    groundwork, laid = groundwork_stages(builder)

    def load_functionals(path: Path, results: Results) -> Functionals:
        kept = read_functionals(path)
        # Noise is in no key of theirs, but several units with noise are refused: making them says so.
        return kept if kept.unit != "mixed" else builder.functionals(results["model"].space)

    def make_prepared(name: str) -> Any:
        def prepare(results: Results, _: Path) -> Any:
            estimator = builder.estimators[name]
            background, functionals = results["background"], results["functionals"]
            with builder.blame(f"estimator.{name}"):
                return estimator.prepare(
                    background, functionals, WhiteNoise(1.0), builder.observed(len(background.times))
                )

        return prepare

    def make_checks(results: Results, _: Path) -> tuple[str, ...]:
        """What is measured and asked fits the state and the parameters: known before anything is trained.

        What to beware of is said in the log, and returned for the results.
        """
        builder.check_before_training(results["model"].space, results["parameters"])
        builder.observed(len(results["model"].times))
        if scene.validation.refine_time > 1 and not isinstance(results["model"], MarchedModel):
            raise SceneError(f"{builder.where}: validation.refine_time: this model steps by itself; set it to 0")
        if reduced and not isinstance(results["model"], Reducible):
            raise SceneError(
                f"{builder.where}: training.method: got 'reduced', but this model is not affine in its parameters' "
                "functions, or steps by itself; expected 'full'"
            )
        model: ForwardModel = results["model"]
        if isinstance(model, HarmonicModel):
            check_means()
        cautions = model.cautions(results["parameters"]) if isinstance(model, MarchedModel | HarmonicModel) else ()
        for line in cautions:
            _log.warning("%s: %s", builder.where, line)
        return cautions

    def check_means() -> None:
        """Two phases have no mean that means anything: that of the cycle is zero."""
        if scene.observed.less_mean:
            raise SceneError(
                f"{builder.where}: observed.less_mean: the two steps are the phases of a motion whose mean is zero; "
                "remove it"
            )
        for name, quantity in builder.quantities.items():
            if quantity.over_time == "mean":
                raise SceneError(
                    f"{builder.where}: quantity.{name}.over_time: got 'mean', but the two steps are the phases of a "
                    "motion whose mean is zero; set over_time = 'each'"
                )

    def contrasts(results: Results) -> list[Contrast]:
        return builder.contrasts(results["model"].space, results["parameters"])

    def meter(results: Results) -> ErrorMeter | None:
        if not scene.report.states:
            return None
        return ErrorMeter(results["model"].space, PRODUCT, contrasts(results), joint_weights(results["background"]))

    def judge(results: Results) -> Judge:
        projected = None
        if small:
            projected = ProjectedErrors(results["background"], results["functionals"], results["reference"])
        return Judge(
            results["measured"], builder.quantities, meter(results), projected,
            (lambda: results["truth"]) if scene.report.states else None,
        )  # fmt: skip

    def make_judged(name: str) -> Callable[[Results, Path], Judged]:
        return lambda results, _: judge(results).judge(name, results[f"prepared.{name}"], results["noisy"])

    def read_judged_of(name: str) -> Callable[[Path, Results], Judged]:
        def load(path: Path, results: Results) -> Judged:
            def again(level: float) -> Estimate:
                data: NoisyData = results["noisy"]
                prepared: PreparedEstimator = results[f"prepared.{name}"]
                return prepared.estimate(data.given(level), noise_scale=data.sigmas[level])

            return read_judged(path, again)

        return load

    def make_validation(results: Results, _: Path) -> Validation:
        one = judge(results)
        background = results["background"]
        judged = {name: results[f"judged.{name}"] for name in scene.estimator}
        labels = one.meter.labels if one.meter is not None else ()
        return gather(one.prior(background), judged, results["noisy"], labels, joint_weights(background))

    def make_refinement(results: Results, _: Path) -> Any:
        model: MarchedModel = results["model"]
        factor = scene.validation.refine_time
        errors = ErrorMeter(
            model.space, scene.training.product, contrasts(results), {f.name: 1.0 for f in model.space.fields}
        )
        return time_refinement(model, builder.march(model.model, factor), results["parameters"].middle, factor, errors)

    def make_mesh(domain: Domain) -> Mesh:
        with builder.blame("domain"):
            return domain.mesh()

    def make_noisy(results: Results, _: Path) -> NoisyData:
        data = results["measured"].data
        return NoisyData.drawn(data, scene.noise.levels, scene.noise.seed, builder.observed(data.shape[1]))

    means = Means(lambda other: scene_pipeline(other, workers, show, scheduler), workers, show, scheduler)
    judging = source_hash("dacore", JUDGING)
    observed = {"observed": scene.observed.model_dump()} if scene.observed != Observed() else {}
    asked = [each.model_dump() for each in scene.validation.contrasts] if scene.report.states else []
    small = [
        Stage(
            "reference", ("background", "functionals", "truth"), {"source": judging, "contrasts": asked},
            lambda results, _folder: project(
                results["background"], results["functionals"], results["truth"], contrasts(results),
                show.meter("projection"),
            ),
            Codec(".h5", write_reference, lambda path, _results: read_reference(path)), "unseen cases, projected",
        )
    ] if scene.report.states and scene.training.product == PRODUCT else []  # fmt: skip
    # Errors in another product than the background's are measured on the states themselves.
    against = ("reference",) if small else ("truth",) if scene.report.states else ()
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
            "functionals", ("model",),
            # In their order, which is that of the data.
            {"observations": [[name, _observed(builder, name, t)] for name, t in scene.observation.items()]},
            lambda results, _folder: builder.functionals(results["model"].space),
            Codec(".h5", write_functionals, load_functionals, ("model",)), "what is measured",
        ),
        Stage(
            "checks", ("model", "parameters", "functionals"), {}, make_checks, purpose="the scene fits together",
        ),
        *trained,
        *groundwork,
        *(
            Stage(
                f"prepared.{name}", ("background", "functionals", *laid.get(name, ())),
                _plugin(builder, "estimator", table) | observed,
                make_prepared(name), purpose=table.title or table.kind,
            )
            for name, table in scene.estimator.items()
        ),
        truth,
        Stage(
            "measured", ("functionals", "truth"),
            {"source": judging, "quantities": {n: _plugin(builder, "quantity", t) for n, t in scene.quantity.items()}},
            lambda results, _folder: measure(
                results["model"].space, results["functionals"], results["truth"], builder.quantities
            ),
            Codec(".h5", write_measured, lambda path, _results: read_measured(path)), "exact data of the unseen cases",
        ),
        *small,
        Stage(
            "noisy", ("measured",), scene.noise.model_dump() | observed, make_noisy,
            purpose="data with noise",
        ),
        *(
            Stage(
                f"judged.{name}", ("noisy", f"prepared.{name}", *against),
                {"source": judging, "contrasts": asked}, make_judged(name),
                Codec(".h5", write_judged, read_judged_of(name)), f"errors of {table.title or table.kind}",
            )
            for name, table in scene.estimator.items()
        ),
        Stage(
            "validation", ("background", "noisy", *against, *(f"judged.{name}" for name in scene.estimator)),
            {"contrasts": asked}, make_validation, purpose="errors on unseen cases",
        ),
        *(
            (
                Stage(
                    "reduction", ("training", "background", "truth", "reference"), {"source": judging},
                    lambda results, _folder: unseen_errors(
                        results["training"].model, results["background"], results["reference"],
                        [results["parameters"].as_mapping(row) for row in results["truth"].samples],
                        contrasts(results), scene.observed.less_mean,
                    ), purpose="the reduced model on unseen cases",
                ),
            )
            if judges_reduction(scene)
            else ()
        ),
        Stage(
            "refinement", ("model", "parameters"),
            scene.validation.model_dump(include={"refine_time", "contrasts"})
            | {"product": scene.training.product, "source": judging},
            make_refinement, Codec(".h5", write_refinement, lambda path, _results: read_refinement(path)),
            "discretisation error in time",
        ),
        *study_stages(builder, means),
    ]  # fmt: skip
    return Pipeline(guarded(priced(stages, scene), builder))


def targets(builder: Builder) -> list[str]:
    """The stages that a run of the scene asks for, to find its numbers and to write its report."""
    scene = builder.scene
    return [
        "checks", "validation", *(["refinement"] if scene.validation.refine_time > 1 else []),
        *(["reduction"] if judges_reduction(scene) else []),
        *(["truth", *(f"prepared.{name}" for name in scene.estimator)] if scene.report.states else []),
        *(f"{STUDY}{name}" for name in scene.study),
    ]  # fmt: skip


def judges_reduction(scene: Scene) -> bool:
    """Whether the reduced model is held against the unseen cases: where they are projected anyway."""
    return scene.training.method == "reduced" and scene.report.states and scene.training.product == PRODUCT


def _plugin(builder: Builder, kind: str, table: PluginTable) -> dict[str, Any]:
    return {**_content(table), "version": builder.version_of(kind, table.kind)}


def _observed(builder: Builder, name: str, table: PluginTable) -> dict[str, Any]:
    """Of an observation, with the content of the files that it names."""
    with builder.blame(f"observation.{name}"):
        content = builder.observations[name].fingerprint()
    return _plugin(builder, "observation", table) | ({"content": content} if content else {})


def _content(table: PluginTable) -> dict[str, Any]:
    """What a result depends on: the kind and its settings, not the title."""
    return {"kind": table.kind, "table": table.settings}
