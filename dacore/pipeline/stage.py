"""Stages: what depends on what, and the key that says whether a result still holds."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from dacore.errors import DacoreError
from dacore.pipeline.costs import Cost


class Results(Protocol):
    """What a stage sees of the others: their results, made when asked for."""

    def __getitem__(self, name: str) -> Any:
        """Return the result of stage `name`."""
        ...


@dataclass(frozen=True)
class Codec:
    """How a result is kept on disk.

    Parameters
    ----------
    suffix : str
        File ending; empty for a folder.
    save : callable
        (result, path): writes atomically.
    load : callable
        (path, results) -> result; may ask for other stages.
    load_needs : tuple of str
        The stages that `load` asks for.
    """

    suffix: str
    save: Callable[[Any, Path], None]
    load: Callable[[Path, Results], Any]
    load_needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stage:
    """One step of a scene's work.

    Parameters
    ----------
    name : str
    needs : tuple of str
        Stages whose results it uses.
    settings : mapping
        Everything else the result depends on, as JSON values.
    compute : callable
        (results, folder) -> result; `folder` is the stage's own place in the cache for work that
        resumes, made only if used.
    codec : Codec, optional
        How to keep the result; None computes it anew in each run.
    purpose : str
        A few words for the plan.
    cost : callable, optional
        Sizes by name -> what it takes by its growth law, None where a size is missing; None: next to nothing.
    size : callable, optional
        result -> sizes by name, which laws of later stages use.
    pieces : int
        How many ``.h5`` files work that resumes leaves in the stage's folder; 0 for work that does not resume.
    """

    name: str
    needs: tuple[str, ...]
    settings: Mapping[str, Any]
    compute: Callable[[Results, Path], Any]
    codec: Codec | None = None
    purpose: str = ""
    cost: Callable[[Mapping[str, float]], Cost | None] | None = None
    size: Callable[[Any], Mapping[str, float]] | None = None
    pieces: int = 0


@dataclass(frozen=True)
class Pipeline:
    """Stages that need one another without a circle.

    Parameters
    ----------
    stages : sequence of Stage
        Each after those it needs.
    """

    stages: Sequence[Stage]
    _by_name: dict[str, Stage] = field(default_factory=dict, init=False)
    _keys: dict[str, str] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        for stage in self.stages:
            for name in (*stage.needs, *(stage.codec.load_needs if stage.codec else ())):
                if name not in self._by_name:
                    raise DacoreError(f"stage {stage.name} needs {name}, which does not come before it")
            if stage.name in self._by_name:
                raise DacoreError(f"stage {stage.name} is there twice")
            self._by_name[stage.name] = stage

    def __getitem__(self, name: str) -> Stage:
        return self._by_name[name]

    def has(self, name: str, key: str) -> bool:
        """Whether there is a stage of this name with this very key."""
        return name in self._by_name and self.key(name) == key

    def key(self, name: str) -> str:
        """Content key: a hash of the stage's settings and of the keys of what it needs."""
        if name in self._keys:
            return self._keys[name]
        stage = self[name]
        content = {
            "name": name,
            "settings": stage.settings,
            "needs": {need: self.key(need) for need in stage.needs},
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        self._keys[name] = hashlib.sha256(text.encode()).hexdigest()[:24]
        return self._keys[name]
