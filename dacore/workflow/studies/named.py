"""Estimators that studies name: those of the scene, and of the kind they need."""

from collections.abc import Sequence

from dacore.errors import ShapeError
from dacore.io.scene import Scene


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
