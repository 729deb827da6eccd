"""Names on their way out: what still works is said once, with what to use instead and until when.

The policy is in docs/versions.md: how long a name lives after it was deprecated, and what is public at all.
"""

import functools
import logging
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_log = logging.getLogger("dacore")


@dataclass(frozen=True)
class Renamed:
    """A key of a table that has another name now; see `renamed_keys`.

    Parameters
    ----------
    to : str
        The name of today.
    since, removed_in : str
        Versions: of the change, and from which on the old name is refused.
    """

    to: str
    since: str
    removed_in: str


def warn_deprecated(what: str, *, since: str, removed_in: str, instead: str, stacklevel: int = 2) -> None:
    """Warn the caller's caller with a `DeprecationWarning`, which Python shows once for each place.

    Parameters
    ----------
    what : str
        Name of what is deprecated.
    since, removed_in : str
        Versions: of the deprecation, and from which on it is gone.
    instead : str
        What to use.
    stacklevel : int
        2 points at who called the function that calls this one, as in `warnings.warn`.
    """
    text = f"{what} is deprecated since {since} and will be removed in {removed_in}; use {instead}"
    warnings.warn(text, DeprecationWarning, stacklevel=stacklevel + 1)


def deprecated(*, since: str, removed_in: str, instead: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function or method that still works: each call warns at the caller.

    Parameters
    ----------
    since, removed_in, instead : str
        As for `warn_deprecated`.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        what = f"{function.__module__}.{function.__qualname__}"

        @functools.wraps(function)
        def wrapper(*arguments: P.args, **named: P.kwargs) -> R:
            warn_deprecated(what, since=since, removed_in=removed_in, instead=instead)
            return function(*arguments, **named)

        return wrapper

    return decorate


def renamed_keys(table: Mapping[str, Any], renamed: Mapping[str, Renamed], where: str) -> dict[str, Any]:
    """Return a table of a scene with old names of keys replaced; each is said in dacore's log.

    Users of a scene see the log and no `DeprecationWarning`, which is for authors of code. A table that has a
    key under both names keeps both, so that the old one is refused as an unknown key.

    Parameters
    ----------
    table : mapping
    renamed : mapping of str to Renamed
        By the old name.
    where : str
        Place of the table, for the message.
    """
    out: dict[str, Any] = {}
    for key, value in table.items():
        change = renamed.get(key)
        if change is None or change.to in table:
            out[key] = value
            continue
        _log.warning(
            "%s.%s: deprecated since %s and refused from %s on; write %s", where, key, change.since, change.removed_in,
            change.to,
        )  # fmt: skip
        out[change.to] = value
    return out
