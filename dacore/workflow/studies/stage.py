"""Studies as stages: each depends on its settings, on the results it asks for, and on those of its variants."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dacore.errors import SceneError
from dacore.io.arrays import read_arrays, write_arrays
from dacore.io.scene import apply, validate
from dacore.pipeline.runner import Runner
from dacore.pipeline.stage import Codec, Pipeline, Results, Stage
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.laws import sizes_of
from dacore.workflow.session import Session
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.study import Findings, Study

STUDY = "study."
_MAGIC = "dacore findings 1"


@dataclass(frozen=True, eq=False)
class Means:
    """What stages of studies have at hand.

    Parameters
    ----------
    pipeline_of : callable
        Makes the pipeline of a variant.
    workers : int
    board : ProgressBoard
    scheduler : str, optional
    """

    pipeline_of: Callable[[Builder], Pipeline]
    workers: int
    board: ProgressBoard
    scheduler: str | None


def study_stages(builder: Builder, means: Means) -> list[Stage]:
    """Return a stage for each study of a scene."""
    return [_stage(builder, name, study, means) for name, study in builder.studies.items()]


def varied(builder: Builder, changes: Mapping[str, Any], where: str) -> Builder:
    """Return a scene with some keys changed and without studies; SceneError says which variant cannot be."""
    table = builder.scene.model_dump(exclude_unset=True)
    table.pop("study", None)
    for key, value in changes.items():
        try:
            # A later change may reach into this value, which other variants share.
            apply(table, key, deepcopy(value))
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from error
    return replace(builder, scene=validate(table, where), where=where)


def _stage(builder: Builder, name: str, study: Study, means: Means) -> Stage:
    table, keys = builder.scene.study[name], {}
    with builder.blame(f"{STUDY}{name}"):
        # First what a study needs: it refuses names that the scene does not have.
        needs, variants = study.needs(builder.scene), study.variants(builder.scene)
    for label, variant in variants.items():
        pipeline = means.pipeline_of(varied(builder, variant.changes, _where(builder, name, label)))
        keys[label] = [pipeline.key(each) for each in variant.needs]
    settings = {
        "kind": table.kind,
        "table": table.settings,
        "version": builder.version_of("study", table.kind),
        "variants": keys,
    }

    def compute(results: Results, folder: Path) -> Findings:
        if not isinstance(results, Runner):
            raise TypeError("a study's results must come from a runner")
        opened: dict[str, Session] = {}

        def variant(label: str) -> Session:
            if label not in opened:
                other = varied(builder, variants[label].changes, _where(builder, name, label))
                sizes = sizes_of(other.scene, other.domain, means.workers)
                runner = Runner(means.pipeline_of(other), folder.parent, sizes=sizes, elder=results)
                opened[label] = Session(other, runner)
            return opened[label]

        meter = means.board.meter(f"{STUDY}{name}")
        with builder.blame(f"{STUDY}{name}"):
            return study.run(Bench(Session(builder, results), variant, means.workers, means.scheduler, meter))

    codec = Codec(".h5", _write, lambda path, _: _read(path))
    return Stage(f"{STUDY}{name}", needs, settings, compute, codec, table.title or study.heading)


def _where(builder: Builder, name: str, label: str) -> str:
    return f"{builder.where}: {STUDY}{name}: {label}"


def _write(found: Findings, path: Path) -> None:
    write_arrays(path, _MAGIC, found.arrays, found.facts)


def _read(path: Path) -> Findings:
    return Findings(*read_arrays(path, _MAGIC))
