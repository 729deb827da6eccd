"""All cases, theme by theme."""

from collections.abc import Sequence

from dacore.errors import SceneError
from dacore.workflow.stress import data, discretisation, noise, observations, physics, solvers, spaces, training
from dacore.workflow.stress.case import Case

CATALOGUE: tuple[Case, ...] = (
    *physics.CASES,
    *discretisation.CASES,
    *solvers.CASES,
    *observations.CASES,
    *data.CASES,
    *spaces.CASES,
    *noise.CASES,
    *training.CASES,
)


def themes() -> tuple[str, ...]:
    """Themes in the order of the catalogue."""
    return tuple(dict.fromkeys(case.theme for case in CATALOGUE))


def chosen(only: Sequence[str] = (), text: str = "") -> tuple[Case, ...]:
    """Cases of some themes (all if none is named) whose name contains `text`; SceneError if there are none."""
    if unknown := [theme for theme in only if theme not in themes()]:
        raise SceneError(f"--themes: got {unknown[0]!r}, expected any of {', '.join(themes())}")
    found = tuple(case for case in CATALOGUE if (not only or case.theme in only) and text in case.name)
    if not found:
        raise SceneError(f"--case: no name contains {text!r}, expected part of a name in docs/stress.md")
    return found
