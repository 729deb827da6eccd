"""Run stages when their results are asked for, and say beforehand what would be done."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from dacore.errors import StoreError
from dacore.io.atomic import make_folder
from dacore.pipeline.stage import Pipeline, Stage

logger = logging.getLogger(__name__)

Status = Literal["run", "resume", "cached", "skipped"]
Observer = Callable[[str, str], None]


@dataclass(frozen=True)
class PlannedStage:
    """One row of a plan.

    Parameters
    ----------
    name, purpose : str
    status : {"run", "resume", "cached", "skipped"}
    why : str
    key : str
    """

    name: str
    purpose: str
    status: Status
    why: str
    key: str


@dataclass
class Runner:
    """Results of a pipeline's stages, each made at most once.

    Parameters
    ----------
    pipeline : Pipeline
    cache : Path
        Folder of results kept on disk.
    observer : callable, optional
        Called with (stage name, "start" | "done" | "cached").

    Attributes
    ----------
    timings : dict of str to float
        Seconds each stage took by itself, without the stages it asked for.
    """

    pipeline: Pipeline
    cache: Path
    observer: Observer | None = None
    timings: dict[str, float] = field(default_factory=dict)
    _results: dict[str, Any] = field(default_factory=dict)
    _inner: list[float] = field(default_factory=list)

    def __getitem__(self, name: str) -> Any:
        if name not in self._results:
            self._results[name] = self._make(self.pipeline[name])
        return self._results[name]

    def path(self, stage: Stage) -> Path:
        """Where the stage's result is kept."""
        folder = self.folder(stage)
        return folder.with_name(folder.name + stage.codec.suffix) if stage.codec else folder

    def folder(self, stage: Stage) -> Path:
        """The stage's own folder, for work that resumes."""
        return self.cache / f"{stage.name}-{self.pipeline.key(stage.name)}"

    def _make(self, stage: Stage) -> Any:
        started = time.perf_counter()
        self._inner.append(0.0)
        try:
            return self._load_or_compute(stage)
        finally:
            total = time.perf_counter() - started
            self.timings[stage.name] = total - self._inner.pop()
            if self._inner:
                self._inner[-1] += total

    def _load_or_compute(self, stage: Stage) -> Any:
        if stage.codec and self.path(stage).exists():
            try:
                result = stage.codec.load(self.path(stage), self)
            except StoreError as error:
                logger.warning("%s; computing it again", str(error).partition(";")[0])
            else:
                self._tell(stage.name, "cached")
                return result
        for need in stage.needs:
            self[need]
        self._tell(stage.name, "start")
        result = stage.compute(self, self.folder(stage))
        if stage.codec:
            make_folder(self.cache)
            stage.codec.save(result, self.path(stage))
        self._tell(stage.name, "done")
        return result

    def _tell(self, name: str, event: str) -> None:
        if self.observer:
            self.observer(name, event)

    def plan(self, targets: Sequence[str]) -> list[PlannedStage]:
        """Say for every stage whether it would run, resume, be read, or be skipped, and why.

        Parameters
        ----------
        targets : sequence of str
            The stages whose results are wanted.
        """
        status: dict[str, tuple[Status, str]] = {}

        def visit(name: str, why: str) -> None:
            if name in status:
                return
            stage = self.pipeline[name]
            if stage.codec and self.path(stage).exists():
                status[name] = ("cached", f"kept at {self.path(stage).name}")
                needs = stage.codec.load_needs
            else:
                resumes = self.folder(stage).is_dir() and any(self.folder(stage).iterdir())
                status[name] = ("resume" if resumes else "run", why)
                needs = stage.needs
            for need in needs:
                visit(need, f"{name} needs it")

        for target in targets:
            visit(target, "asked for")
        return [
            PlannedStage(
                s.name, s.purpose, *status.get(s.name, ("skipped", "nothing asks for it")), self.pipeline.key(s.name)
            )
            for s in self.pipeline.stages
        ]
