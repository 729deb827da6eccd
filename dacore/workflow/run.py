"""Run a scene from file to results, or say what a run would do."""

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from dacore.algebra.threads import one_blas_thread
from dacore.io.atomic import make_folder
from dacore.pipeline.costs import Cost, Record, processor_time
from dacore.pipeline.runner import PlannedStage
from dacore.workflow.board import ProgressBoard
from dacore.workflow.laws import REPORT, report
from dacore.workflow.machine import usable_cores
from dacore.workflow.open import open_scene
from dacore.workflow.report_parts import Table
from dacore.workflow.results import summarise, write_json
from dacore.workflow.session import Session
from dacore.workflow.stages import targets
from dacore.workflow.studies.parallel import Job, run_studies
from dacore.workflow.studies.stage import STUDY


@dataclass(frozen=True)
class Finished:
    """What a run leaves.

    Parameters
    ----------
    tables : tuple of Table
    files : tuple of Path
    seconds : float
    """

    tables: tuple[Table, ...]
    files: tuple[Path, ...]
    seconds: float


def run_scene(
    path: Path,
    changes: Sequence[str],
    out: Path,
    cache: Path | None = None,
    workers: int | None = None,
    board: ProgressBoard | None = None,
    scheduler: str | None = None,
    fresh: Collection[str] = (),
) -> Finished:
    """Run a scene and write its results.

    Parameters
    ----------
    path : Path
        The scene.
    changes : sequence of str
        ``"key=value"`` changes to it.
    out : Path
        Folder of the results.
    cache : Path, optional
        Folder of kept stages; ``out/cache`` by default.
    workers : int, optional
        Processes for solving; all usable cores by default.
    board : ProgressBoard, optional
    scheduler : str, optional
        ``tcp://host:port`` or the scheduler file of a dask cluster whose workers solve; asked before
        anything is computed.
    fresh : collection of str
        Stages to make anew whatever is kept, "all" for all of them; what is made replaces what was kept.
    """
    started = time.perf_counter()
    # Drawing needs matplotlib; a plan does not.
    from dacore.workflow.output import publish, tables
    from dacore.workflow.studies.output import study_numbers

    board = board or ProgressBoard()
    workers = workers or usable_cores()
    session = open_scene(path, changes, cache or out / "cache", workers, board, scheduler, fresh)
    if scheduler is not None:
        from dacore.execution.cluster import connected

        with connected(scheduler):
            pass
    make_folder(out)
    expected = planned(session)
    # The dense work is many small factorisations: a second BLAS thread gains little on an idle machine and
    # costs ten times and more on a busy one. The cores go to the worker processes.
    with one_blas_thread():
        wanted = targets(session.builder)
        for target in [each for each in wanted if not each.startswith(STUDY)]:
            session.runner[target]
        run_studies(session, Job(path, tuple(changes), session.runner.cache), workers, board)
        for target in wanted:
            session.runner[target]
        summary = summarise(session, time.perf_counter() - started, expected)
        summary["studies"] = study_numbers(session)
        results = out / "results.json"
        write_json(summary, results)
        text = path.read_text(encoding="utf-8") + "".join(f"\n# --set {change}" for change in changes)
        board.stage("report", "start")
        drawing, used = time.perf_counter(), processor_time()
        published = publish(session, out, summary, text)
        board.stage("report", "done")
        law = report(session.runner.known_sizes(), session.scene.report.states)
        record = Record(REPORT, time.perf_counter() - drawing, processor_time() - used, law.seconds, {})
        session.runner.ledger.keep("latest", record)
    shown = (*tables(session, joint=False), *published.studies)
    return Finished(shown, (*published.files, results), time.perf_counter() - started)


def plan_scene(
    path: Path,
    changes: Sequence[str],
    out: Path,
    cache: Path | None = None,
    workers: int | None = None,
    fresh: Collection[str] = (),
) -> list[PlannedStage]:
    """Say what `run_scene` would do, stage by stage and with the report, and what it would cost."""
    return planned(open_scene(path, changes, cache or out / "cache", workers or usable_cores(), fresh=fresh))


def planned(session: Session) -> list[PlannedStage]:
    """Return the plan of a run: the stages, and the report."""
    runner = session.runner
    law, factor = report(runner.known_sizes(), session.scene.report.states), runner.ledger.factor(REPORT)
    cost = Cost(law.seconds * (factor or 1.0), law.memory)
    last = PlannedStage(REPORT, "tables and figures", "run", "made in every run", "", cost, factor is not None)
    return [*runner.plan(targets(session.builder)), last]
