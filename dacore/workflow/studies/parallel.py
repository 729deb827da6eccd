"""Several studies at once, each in a process of its own; what they find meets in the cache."""

from dataclasses import dataclass
from pathlib import Path

from dacore.execution.foreach import for_each
from dacore.workflow.board import ProgressBoard
from dacore.workflow.session import Session
from dacore.workflow.studies.stage import STUDY


@dataclass(frozen=True)
class Job:
    """Where the studies of a scene find it.

    Parameters
    ----------
    path : Path
    changes : tuple of str
    cache : Path
    """

    path: Path
    changes: tuple[str, ...]
    cache: Path


def run_studies(session: Session, job: Job, workers: int, board: ProgressBoard) -> None:
    """Make the findings that are not kept yet, several studies at once; nothing for fewer than two of them.

    Parameters
    ----------
    session : Session
        With the results of the scene itself in its cache.
    job : Job
    workers : int
    board : ProgressBoard
    """
    runner = session.runner
    missing = [name for name in session.scene.study if runner.needed(f"{STUDY}{name}")]
    if workers < 2 or len(missing) < 2:
        return
    meter = board.meter("studies")
    for done, _ in enumerate(for_each(_run_study, job, missing, min(workers, len(missing)))):
        if meter:
            meter(done + 1, len(missing))
    runner.renewed(f"{STUDY}{name}" for name in missing)


def _run_study(job: Job, name: str) -> None:
    from dacore.workflow.open import open_scene

    stage = f"{STUDY}{name}"
    _ = open_scene(job.path, job.changes, job.cache, fresh=[stage]).runner[stage]
