"""The stages that solve: training, by every sample or by a reduced model, and the unseen cases."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from dacore.algebra.compress import compress
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.dynamics.training import draw, solve_all
from dacore.io.background import read_background, write_background
from dacore.io.snapshots import TrajectoryStore
from dacore.pipeline.stage import Codec, Results, Stage
from dacore.plugins.versions import source_hash
from dacore.reduction.greedy import Settings as ReductionSettings
from dacore.reduction.kept import read_reduced, write_reduced
from dacore.reduction.training import Reduced, Solve, train_reduced
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.motions import solved_or_kept
from dacore.workflow.trajectories import TrajectorySet, read_note, write_note


def training_stages(
    builder: Builder, workers: int, show: ProgressBoard, scheduler: str | None
) -> tuple[list[Stage], Stage]:
    """Return the stages from parameters to a background, and the stage of the unseen cases.

    Parameters
    ----------
    builder : Builder
    workers : int
        Processes for solving; not part of any key.
    show : ProgressBoard
    scheduler : str, optional
        Of a dask cluster whose workers solve instead; not part of any key either.
    """
    scene, reduced = builder.scene, builder.scene.training.method == "reduced"
    less_mean = scene.observed.less_mean

    def solve(results: Results, samples: Array, store: TrajectoryStore, title: str) -> int:
        return solve_all(results["model"], results["parameters"], samples, store, workers, show.meter(title), scheduler)

    def trajectories(results: Results, folder: Path, samples: Array, title: str) -> TrajectorySet:
        store = TrajectoryStore(folder, folder.name)
        solved = solve(results, samples, store, title)
        return TrajectorySet(store, samples, solved, lambda: solve(results, samples, store, title))

    def drawn(results: Results) -> Array:
        settings = scene.training
        return draw(results["parameters"], settings.samples, settings.sampling, settings.seed)

    def make_training(results: Results, folder: Path) -> TrajectorySet:
        return trajectories(results, folder, drawn(results), "training")

    def make_truth(results: Results, folder: Path) -> TrajectorySet:
        samples = draw(results["parameters"], scene.validation.cases, "uniform", scene.validation.seed)
        return seen(results, trajectories(results, folder, samples, "unseen cases"))

    def seen(results: Results, stored: TrajectorySet) -> TrajectorySet:
        layout = results["model"].space.layout
        return replace(stored, less_mean=tuple(layout.block(name) for name in less_mean))

    def noted(title: str) -> Codec:
        """Keeps no trajectory, which the store does, but that all are there: they are not read to find out."""

        def load(path: Path, results: Results) -> TrajectorySet:
            return read_note(path, path.with_suffix(""), lambda samples, store: solve(results, samples, store, title))

        return Codec(".json", write_note, load)

    def make_motions(results: Results, folder: Path) -> Callable[[], AbstractContextManager[Solve]]:
        samples, store = drawn(results), TrajectoryStore(folder, folder.name)
        return lambda: solved_or_kept(results["parameters"], samples, store, workers, scheduler)

    def make_reduced(results: Results, _: Path) -> Reduced:
        settings, report = scene.training, show.meter("training")

        def tell(done: int, _: float) -> None:
            if report:
                report(done, settings.most)

        with builder.blame("training"), results["motions"]() as solve_motions:
            return train_reduced(
                results["model"], results["parameters"], drawn(results), solve_motions,
                ReductionSettings(settings.reduction, settings.most, settings.seed, settings.product),
                settings.tolerance, tell,
            )  # fmt: skip

    def make_background(results: Results, _: Path) -> Background:
        if reduced:
            made: Background = results["training"].background
        else:
            training: TrajectorySet = results["training"]
            settings = scene.training
            made = compress(
                results["model"].space, training, results["parameters"], training.samples, settings.tolerance,
                settings.product, workers, show.meter("background"), settings.memory,
            )  # fmt: skip
        return made.less_mean(less_mean) if less_mean else made

    kept = noted("unseen cases")
    without = {"less_mean": less_mean} if less_mean else {}
    truth = Stage(
        "truth", ("model", "parameters"), scene.validation.model_dump(include={"cases", "seed"}) | without, make_truth,
        replace(kept, load=lambda path, results: seen(results, kept.load(path, results)), load_needs=("model",)),
        "unseen cases",
    )  # fmt: skip
    if reduced:
        return [
            Stage(
                "motions", ("model", "parameters"),
                scene.training.model_dump(include={"samples", "sampling", "seed"}), make_motions,
                purpose="trajectories load by load, where they are needed",
            ),
            Stage(
                "training", ("model", "parameters", "motions"),
                {**scene.training.model_dump(exclude={"memory"}), "source": source_hash("dacore", ("reduction",))},
                make_reduced,
                Codec(
                    ".h5", write_reduced,
                    lambda path, results: read_reduced(path, results["model"], results["parameters"]),
                    ("model", "parameters"),
                ), "a reduced model and its trajectories",
            ),
            Stage("background", ("training",), without, make_background, purpose="compressed training set"),
        ], truth  # fmt: skip
    return [
        Stage(
            "training", ("model", "parameters"),
            scene.training.model_dump(include={"samples", "sampling", "seed"}), make_training,
            noted("training"), "trajectories",
        ),
        Stage(
            "background", ("training",),
            scene.training.model_dump(include={"tolerance", "product", "memory"}) | without, make_background,
            Codec(
                ".h5", write_background,
                lambda path, results: read_background(path, results["model"].space, results["parameters"]),
                ("model", "parameters"),
            ), "compressed training set",
        ),
    ], truth  # fmt: skip
