"""The same truths estimated from other data or with other settings: how much, how fine, how many phases."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from dacore.errors import ShapeError
from dacore.io.scene import Scene
from dacore.workflow.canvas import Canvas
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.drawing import draw_amounts
from dacore.workflow.studies.grid import Grid
from dacore.workflow.studies.named import Setting, check_labels, chosen_estimators
from dacore.workflow.studies.study import Exhibit, Findings, Study, Variant

# What every row of a table has in common.
_FIXED = ("noise", "validation", "quantity", "study", "report")


@dataclass(frozen=True)
class Variants(Study):
    """Settings of the study.

    Parameters
    ----------
    settings : tuple of Setting
    base : str
        What the scene itself is called; empty to leave it out.
    estimators : tuple of str
        All of the scene by default.
    about : str
        What is varied and why, for the report.
    """

    heading = "Variants of the scene"

    settings: tuple[Setting, ...]
    base: str = "this scene"
    estimators: tuple[str, ...] = ()
    about: str = ""

    def __post_init__(self) -> None:
        for each in self.settings:
            for key in each.set:
                if key.partition(".")[0] in _FIXED:
                    raise ShapeError(
                        f"settings: {each.label!r} sets {key}, and could not be compared with others; change it for "
                        "the whole scene"
                    )
        check_labels("settings", self.settings, self.base)

    def variants(self, scene: Scene) -> Mapping[str, Variant]:
        """The scene with each setting, and with the chosen estimators only."""
        chosen = chosen_estimators(scene, self.estimators)
        kept = {name: scene.estimator[name].model_dump(exclude_unset=True) for name in chosen}
        # Changes come last: they may be of an estimator.
        return {each.label: Variant({"estimator": kept, **each.set}) for each in self.settings}

    def run(self, bench: Bench) -> Findings:
        """Validate every variant."""
        scene = bench.session.scene
        chosen = chosen_estimators(scene, self.estimators)
        found, counts = {}, []
        if self.base:
            found[self.base] = bench.session.validation
            counts.append(bench.session.functionals.count)
        for done, each in enumerate(self.settings):
            session = bench.variant(each.label)
            found[each.label] = session.validation
            counts.append(session.functionals.count)
            bench.tell(done + 1, len(self.settings))
        return Grid.of(found, chosen, scene.noise.levels).findings(measurements=counts)

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Tables and bars of errors, setting by setting."""
        grid = Grid.kept(found)
        counts = found.facts["measurements"]
        named = replace(
            grid, settings=tuple(f"{name} (m = {m:,})" for name, m in zip(grid.settings, counts, strict=True))
        )
        drawn = draw_amounts(grid, counts, canvas)
        return Exhibit(self.about, [*drawn, *named.tables(canvas)], grid.scores())
