"""What studies name: variants of the scene by a label, and estimators of the scene, of the kind they need."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dacore.errors import ShapeError
from dacore.io.scene import Scene


@dataclass(frozen=True)
class Setting:
    """One variant of the scene.

    Parameters
    ----------
    label : str
    set : mapping of str to object
        Dotted keys of the scene and their values.
    """

    label: str
    set: Mapping[str, Any]


def check_labels(what: str, settings: Sequence[Setting], base: str = "") -> None:
    """Raise ShapeError unless there is a setting, and each label, with that of the scene itself, is there once."""
    labels = [*([base] if base else []), *(each.label for each in settings)]
    if not settings or len(set(labels)) < len(labels):
        raise ShapeError(f"{what}: got the labels {', '.join(labels)}; expected at least one and each once")


def chosen_estimators(scene: Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Return the estimators of a study, all of the scene for none; ShapeError names one that it does not have."""
    for name in names:
        if name not in scene.estimator:
            raise ShapeError(f"estimators: got {name!r}, expected some of {', '.join(scene.estimator)}")
    return tuple(names) or tuple(scene.estimator)


def expect_kind(scene: Scene, name: str, kind: str) -> None:
    """Raise ShapeError unless the scene has an estimator of this name and kind."""
    table = scene.estimator.get(name)
    if table is None or table.kind != kind:
        fitting = [each for each, other in scene.estimator.items() if other.kind == kind]
        told = f": {', '.join(fitting)}" if fitting else "; add one to the scene"
        raise ShapeError(f"estimator: got {name!r}, expected one of kind {kind!r}{told}")
