"""Run stages when their results are asked for, and say beforehand what would be done and what it would cost."""

import logging
import shutil
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from dacore.errors import DacoreError, StoreError
from dacore.io.atomic import make_folder
from dacore.pipeline.costs import READING, Cost, Ledger, Record, processor_time, size_on_disk
from dacore.pipeline.stage import Pipeline, Stage

logger = logging.getLogger(__name__)

Status = Literal["run", "resume", "cached", "skipped"]
Observer = Callable[[str, str], None]
ALL = "all"


@dataclass(frozen=True)
class PlannedStage:
    """One row of a plan.

    Parameters
    ----------
    name, purpose : str
    status : {"run", "resume", "cached", "skipped"}
    why : str
    key : str
    cost : Cost, optional
        What it will take; None for a skipped stage, and where the size is not known before other stages ran.
    measured : bool
        Whether the estimate leans on what this kind of stage took in this cache.
    """

    name: str
    purpose: str
    status: Status
    why: str
    key: str
    cost: Cost | None = None
    measured: bool = False


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
    fresh : collection of str
        Stages to make anew whatever is kept; "all" for all of them. What is made replaces what was kept.
    sizes : mapping of str to float
        What is known of the scene's size before anything runs, for the stages' laws of cost.
    elder : Runner, optional
        Of another pipeline: what has the same key there is taken from it, and made there if it must be.

    Attributes
    ----------
    timings : dict of str to float
        Seconds each stage took by itself, without the stages it asked for.
    states : dict of str to str
        Whether each was "run" or "cached".

    Raises
    ------
    DacoreError
        If there is no such stage to make anew.
    """

    pipeline: Pipeline
    cache: Path
    observer: Observer | None = None
    fresh: Collection[str] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)
    elder: "Runner | None" = None
    timings: dict[str, float] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)
    _results: dict[str, Any] = field(default_factory=dict)
    _inner: list[tuple[float, float]] = field(default_factory=list)
    _resumed: set[str] = field(default_factory=set)
    _renewed: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        known = [stage.name for stage in self.pipeline.stages]
        if unknown := [name for name in self.fresh if name not in (ALL, *known)]:
            raise DacoreError(f"fresh: got {unknown[0]!r}, expected all, or any of {', '.join(known)}")

    @cached_property
    def ledger(self) -> Ledger:
        """What stages of this cache took."""
        return Ledger(self.cache)

    def __getitem__(self, name: str) -> Any:
        if name not in self._results:
            elder = self.elder
            if elder is not None and elder.pipeline.has(name, self.pipeline.key(name)):
                self._results[name] = elder[name]
            else:
                self._results[name] = self._make(self.pipeline[name])
        return self._results[name]

    def needed(self, name: str) -> bool:
        """Whether the stage's result would have to be made: not kept, or to be made anew."""
        stage = self.pipeline[name]
        return self._anew(name) or not (stage.codec and self.path(stage).exists())

    def state(self, name: str) -> str:
        """Say how far a stage is, and make or read nothing: "made", "kept", "3 of 16 done" or "not yet"."""
        stage = self.pipeline[name]
        if name in self._results:
            return "made"
        if not self.needed(name):
            return "kept"
        done = 0 if self._anew(name) else self._pieces(stage)
        return f"{min(done, stage.pieces)} of {stage.pieces} done" if done else "not yet"

    def renewed(self, names: Iterable[str]) -> None:
        """Hear that the results of these stages were made and kept elsewhere, so that they are read."""
        self._renewed.update(names)

    def _anew(self, name: str) -> bool:
        return name not in self._renewed and (ALL in self.fresh or name in self.fresh)

    def path(self, stage: Stage) -> Path:
        """Where the stage's result is kept."""
        folder = self.folder(stage)
        return folder.with_name(folder.name + stage.codec.suffix) if stage.codec else folder

    def folder(self, stage: Stage) -> Path:
        """The stage's own folder, for work that resumes."""
        return self.cache / f"{stage.name}-{self.pipeline.key(stage.name)}"

    def _make(self, stage: Stage) -> Any:
        started, used = time.perf_counter(), processor_time()
        self._inner.append((0.0, 0.0))
        try:
            result = self._load_or_compute(stage)
        finally:
            total, cpu = time.perf_counter() - started, processor_time() - used
            inner = self._inner.pop()
            self.timings[stage.name] = total - inner[0]
            if self._inner:
                above = self._inner[-1]
                self._inner[-1] = (above[0] + total, above[1] + cpu)
        self._record(stage, result, cpu - inner[1])
        return result

    def _record(self, stage: Stage, result: Any, cpu: float) -> None:
        """Keep what the stage took, and how large its result is: later stages' laws ask for it."""
        key, found = self.pipeline.key(stage.name), dict(stage.size(result)) if stage.size else {}
        known = self.ledger.find(stage.name, key)
        if self.states.get(stage.name) == "cached":
            if known is None and found:
                self.ledger.keep(key, Record(stage.name, 0.0, 0.0, 0.0, found))
        elif stage.cost or found:
            law = _law(stage, self.known_sizes()) if stage.name not in self._resumed else None
            self.ledger.keep(key, Record(stage.name, self.timings[stage.name], cpu, law.seconds if law else 0.0, found))

    def _load_or_compute(self, stage: Stage) -> Any:
        anew = self._anew(stage.name)
        if stage.codec and not anew and self.path(stage).exists():
            try:
                result = stage.codec.load(self.path(stage), self)
            except StoreError as error:
                logger.warning("%s; computing it again", str(error).partition(";")[0])
            else:
                self.states[stage.name] = "cached"
                self._tell(stage.name, "cached")
                return result
        for need in stage.needs:
            self[need]
        self.states[stage.name] = "run"
        self._tell(stage.name, "start")
        if anew and self.folder(stage).is_dir():
            shutil.rmtree(self.folder(stage))
        if self._pieces(stage):
            self._resumed.add(stage.name)
        result = stage.compute(self, self.folder(stage))
        if stage.codec:
            make_folder(self.cache)
            stage.codec.save(result, self.path(stage))
        self._tell(stage.name, "done")
        return result

    def _tell(self, name: str, event: str) -> None:
        if self.observer:
            self.observer(name, event)

    def _pieces(self, stage: Stage) -> int:
        """How many pieces of work that resumes are done."""
        folder = self.folder(stage)
        return sum(1 for _ in folder.glob("[!.]*.h5")) if stage.pieces and folder.is_dir() else 0

    def known_sizes(self) -> dict[str, float]:
        """All that is known of the scene's size: what was given, and what these very stages were once found to be."""
        out = dict(self.sizes)
        for stage in self.pipeline.stages:
            if stage.size is None:
                continue
            if stage.name in self._results:
                out |= stage.size(self._results[stage.name])
            elif (record := self.ledger.find(stage.name, self.pipeline.key(stage.name))) is not None:
                out |= record.sizes
        return out

    def plan(self, targets: Sequence[str]) -> list[PlannedStage]:
        """Say for every stage whether it would run, resume, be read, or be skipped, why, and what it would take.

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
            anew = self._anew(name)
            if stage.codec and not anew and self.path(stage).exists():
                status[name] = ("cached", f"kept at {self.path(stage).name}")
                needs = stage.codec.load_needs
            else:
                done = 0 if anew else self._pieces(stage)
                if done:
                    status[name] = ("resume", f"{min(done, stage.pieces)} of {stage.pieces} done")
                else:
                    status[name] = ("run", "to be made anew" if anew and stage.codec else why)
                needs = stage.needs
            for need in needs:
                visit(need, f"{name} needs it")

        for target in targets:
            visit(target, "asked for")
        sizes = self.known_sizes()
        rows = []
        for stage in self.pipeline.stages:
            what, why = status.get(stage.name, ("skipped", "nothing asks for it"))
            cost, measured = self._cost(stage, what, sizes)
            key = self.pipeline.key(stage.name)
            rows.append(PlannedStage(stage.name, stage.purpose, what, why, key, cost, measured))
        return rows

    def _cost(self, stage: Stage, status: Status, sizes: Mapping[str, float]) -> tuple[Cost | None, bool]:
        if status == "skipped":
            return None, False
        if status == "cached":
            size = size_on_disk(self.path(stage))
            return Cost(size / READING, 2.0 * size), False
        if stage.cost is None:
            return Cost(0.0, 0.0), False
        law = _law(stage, sizes)
        if law is None:
            return None, False
        factor = self.ledger.factor(stage.name)
        left = 1.0 - min(self._pieces(stage) / stage.pieces, 1.0) if status == "resume" else 1.0
        return Cost(law.seconds * left * (factor or 1.0), law.memory), factor is not None


def _law(stage: Stage, sizes: Mapping[str, float]) -> Cost | None:
    """What a stage takes by its law; None without one, and where a size that it asks for is not known."""
    try:
        return stage.cost(sizes) if stage.cost is not None else None
    except KeyError:
        return None
