"""The stages of what estimators make of a background alone: kept once for all who need the same."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dacore.core.estimator import Estimator
from dacore.errors import DacoreError, StoreError
from dacore.io.arrays import read_arrays, write_arrays
from dacore.pipeline.stage import Codec, Results, Stage
from dacore.workflow.build import Builder

GROUNDWORK = "groundwork."
KIND = "dacore groundwork 1"


def groundwork_stages(builder: Builder) -> tuple[list[Stage], dict[str, tuple[str, ...]]]:
    """Return the stages, and those that an estimator needs, by names of estimators.

    Estimators of one kind and the same settings share a stage, in whatever scene on the same background.
    """
    stages: dict[str, Stage] = {}
    needed: dict[str, tuple[str, ...]] = {}
    for name, table in builder.scene.estimator.items():
        estimator = builder.estimators[name]
        asked = estimator.groundwork()
        if asked is None:
            continue
        settings = {
            "kind": table.kind, "version": builder.version_of("estimator", table.kind), "settings": dict(asked),
        }  # fmt: skip
        text = json.dumps([table.kind, settings["settings"]], sort_keys=True)
        stage = f"{GROUNDWORK}{table.kind}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
        needed[name] = (stage,)
        if stage not in stages:
            stages[stage] = _stage(stage, settings, estimator, builder, name)
    return list(stages.values()), needed


def _stage(stage: str, settings: Mapping[str, Any], estimator: Estimator, builder: Builder, name: str) -> Stage:
    def make(results: Results, _: Path) -> Any:
        background = results["background"]
        with builder.blame(f"estimator.{name}"):
            return estimator.pack(background)

    def load(path: Path, results: Results) -> Any:
        arrays, facts = read_arrays(path, KIND)
        try:
            estimator.unpack(arrays, facts, results["background"])
        except (KeyError, TypeError, ValueError, DacoreError) as error:
            raise StoreError(f"{path}: not what its background needs ({error}); delete it and run again") from error
        return arrays, facts

    return Stage(
        stage, ("background",), settings, make,
        Codec(".h5", lambda made, path: write_arrays(path, KIND, *made), load, ("background",)),
        f"what {settings['kind']} makes of the background",
    )  # fmt: skip
