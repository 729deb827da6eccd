"""What a scene shows of itself: its tables in a few words."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from dacore.core.display import Card, count, listed, number

if TYPE_CHECKING:
    from dacore.io.scene import PluginTable, Scene


def scene_card(scene: "Scene") -> Card:
    """Say what a scene solves, measures and estimates, from its tables alone.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Card
    """
    meshed = scene.domain is not None
    physics = scene.physics.kind + (f" on {scene.discretization.backend}" if meshed else "")
    timed = meshed or "time" in scene.model_fields_set
    return Card(
        f"Scene: {scene.title}",
        (
            ("domain", scene.domain.kind if scene.domain is not None else ""),
            ("physics", physics),
            ("times", f"{count(scene.time.steps, 'step')} of {number(scene.time.step)} s" if timed else ""),
            ("ranges set", listed(list(scene.parameters))),
            ("training", f"{count(scene.training.samples, 'sample')}, {scene.training.method}"),
            ("measured", listed([_measured(name, table) for name, table in scene.observation.items()])),
            ("noise", ", ".join(f"{100 * level:g}%" for level in scene.noise.levels)),
            ("quantities", _titled(scene.quantity)),
            ("estimators", _titled(scene.estimator)),
            ("unseen cases", count(scene.validation.cases)),
            ("studies", _titled(scene.study)),
        ),
    )


def _measured(name: str, table: "PluginTable") -> str:
    field = table.settings.get("field")
    return f"{name} ({table.kind}{f' of {field}' if field else ''})"


def _titled(tables: Mapping[str, "PluginTable"]) -> str:
    return listed([name if table.kind == name else f"{name} ({table.kind})" for name, table in tables.items()])
