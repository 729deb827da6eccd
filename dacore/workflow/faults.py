"""Whose fault it is when a stage fails in a way that nobody foresaw: one line that names the plugin's file and line."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dacore.errors import DacoreError, SceneError
from dacore.execution.worker_frames import frames_of
from dacore.pipeline.stage import Results, Stage
from dacore.workflow.build import Builder


def guarded(stages: Sequence[Stage], builder: Builder) -> list[Stage]:
    """Return the stages; errors that come out of a plugin's code are errors of the scene that say where.

    Errors of dacore pass as they are, and so do those without a plugin on their way: they are bugs of dacore,
    which must not be taken for somebody else's.
    """
    return [replace(stage, compute=_guard(stage.name, stage.compute, builder)) for stage in stages]


def _guard(name: str, compute: Callable[[Results, Path], Any], builder: Builder) -> Callable[[Results, Path], Any]:
    def guard(results: Results, folder: Path) -> Any:
        try:
            return compute(results, folder)
        except (DacoreError, MemoryError, OSError):
            raise
        except Exception as error:
            place = _place(error, builder)
            if not place:
                raise
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise SceneError(
                f"{builder.where}: {name}: a plugin failed at {place} ({reason}); dacore --debug shows all of it"
            ) from error

    return guard


def _place(error: Exception, builder: Builder) -> str:
    """Return "file line N" of the innermost frame in a plugin's code, or nothing."""
    packages = {each.spec.target.partition(":")[0].partition(".")[0] for each in builder.registry.declarations}
    files = [getattr(sys.modules.get(package), "__file__", None) for package in packages - {"dacore"}]
    single = {file for file in files if file and Path(file).name != "__init__.py"}
    roots = [Path(file).parent for file in files if file and Path(file).name == "__init__.py"]
    for file, line in reversed(frames_of(error)):
        if file in single or any(Path(file).is_relative_to(root) for root in roots):
            return f"{Path(file).name} line {line}"
    return ""
