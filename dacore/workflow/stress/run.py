"""Run the catalogue on a scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dacore.algebra.threads import one_blas_thread
from dacore.workflow.board import ProgressBoard
from dacore.workflow.build import Builder
from dacore.workflow.stress.case import FAILURES, Case, Judged, Verdict, judge
from dacore.workflow.stress.context import Context, open_context
from dacore.workflow.stress.needs import mpmath
from dacore.workflow.stress.reference import check_precision

VERDICTS: tuple[Verdict, ...] = ("stable", "degraded", "refused", "not applicable", *FAILURES)


@dataclass(frozen=True, eq=False)
class Stressed:
    """A catalogue with its verdicts.

    Parameters
    ----------
    scene : str
        The scene's file.
    changes : tuple of str
        What of it was changed.
    judged : tuple of Judged
    builder : Builder
        Of the scene that was used: with a small training set.
    sizes : mapping of str to int
        Unknowns, functionals and so on of that scene.
    """

    scene: str
    changes: tuple[str, ...]
    judged: tuple[Judged, ...]
    builder: Builder
    sizes: dict[str, int]

    def count(self, verdict: Verdict) -> int:
        """How many cases got a verdict."""
        return sum(each.verdict == verdict for each in self.judged)

    @property
    def failed(self) -> tuple[Judged, ...]:
        """Cases with an error that nobody mentions, or a traceback."""
        return tuple(each for each in self.judged if each.failed)


def stress(
    path: Path,
    cases: Sequence[Case],
    changes: Sequence[str] = (),
    cache: Path | None = None,
    workers: int = 1,
    board: ProgressBoard | None = None,
) -> Stressed:
    """Judge cases on a scene, one after the other.

    Parameters
    ----------
    path : Path
        The scene.
    cases : sequence of Case
    changes : sequence of str
        ``"key=value"`` changes to the scene.
    cache : Path, optional
        Folder of kept stages.
    workers : int
        Processes for the small training set.
    board : ProgressBoard, optional

    Raises
    ------
    SceneError
        If the scene is wrong.
    MissingDependencyError
        Without mpmath.
    """
    check_precision()
    mpmath()
    show = board or ProgressBoard()
    context = open_context(path, tuple(changes), cache, workers, show)
    meter = show.meter("cases")
    judged = []
    with one_blas_thread():
        sizes = _sizes(context)
        for done, case in enumerate(cases):
            if meter:
                meter(done, len(cases))
            judged.append(judge(case, context))
    if meter:
        meter(len(cases), len(cases))
    return Stressed(str(path), tuple(changes), tuple(judged), context.builder, sizes)


def _sizes(context: Context) -> dict[str, int]:
    """Sizes of the scene; what several cases share is made here, so that none of them is charged with it."""
    return {
        "unknowns": context.space.n_dofs,
        "functionals": context.functionals.count,
        "trajectories": context.background.n_samples,
        "steps": len(context.background.times),
        "unseen cases": context.truth.shape[2],
    }
