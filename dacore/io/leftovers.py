"""Half-written files of killed processes: how they are told from those of living ones, and removed.

A temporary file's name says who writes it: a machine (to be exact one boot of it, and one namespace
of process numbers, since two containers may number theirs alike), a process number and the moment
that process began, since numbers are used again. So no lock is needed, which would not be reliable
on every network file system.
"""

import hashlib
import os
import platform
import re
import secrets
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from dacore.errors import StoreError

AGE_ELSEWHERE = 24 * 3600.0
"""Seconds [s] after which a temporary file of another machine is taken for left behind."""

_PRESENT = ".present."
_NAME = re.compile(r"\..+\.dacore-(?P<place>[0-9a-f]{8})-(?P<process>\d+)-(?P<began>\d+)-[0-9a-f]{8}(\.[^.]*)?")


def mark() -> str:
    """What this process puts into the names of its temporary files."""
    return f"dacore-{_place()}-{os.getpid()}-{_began(os.getpid()) or 0}"


def sweep(folder: Path) -> None:
    """Remove temporary files in `folder` (not below it) whose process no longer lives.

    A file of another machine is removed once nobody has written to it for a day. What cannot be
    removed stays: it is in nobody's way.
    """
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _NAME.fullmatch(entry.name)
            if found and _abandoned(entry, found):
                with suppress(OSError):
                    Path(entry.path).unlink()


def abandoned(entry: os.DirEntry[str]) -> bool:
    """Whether something is named as temporary by a process that no longer lives."""
    found = _NAME.fullmatch(entry.name)
    return found is not None and _abandoned(entry, found)


@contextmanager
def present(folder: Path) -> Iterator[int]:
    """Tell other processes that this one works in `folder`, and learn how many living ones began before.

    A hint for who begins where, not a lock: nothing goes wrong where it is not seen.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    int
        0 for the first.

    Raises
    ------
    StoreError
        If nothing can be written into the folder.
    """
    mine = folder / f"{_PRESENT}{mark()}-{secrets.token_hex(4)}"
    try:
        mine.touch()
    except OSError as error:
        raise StoreError(f"{folder}: cannot write into this folder ({error.strerror})") from error
    try:
        sweep(folder)
        # Each makes its own file before it looks, so two that begin at once see the same order.
        yield sorted(folder.glob(f"{_PRESENT}*"), key=_age).index(mine)
    finally:
        with suppress(OSError):
            mine.unlink()


def _age(path: Path) -> tuple[int, str]:
    try:
        return path.stat().st_mtime_ns, path.name
    except OSError:
        return sys.maxsize, path.name


def _abandoned(entry: os.DirEntry[str], found: re.Match[str]) -> bool:
    if found["place"] == _place():
        return _began(int(found["process"])) != int(found["began"])
    try:
        return time.time() - entry.stat(follow_symlinks=False).st_mtime > AGE_ELSEWHERE
    except OSError:
        return False


@cache
def _place() -> str:
    """Eight hexadecimal digits for this boot of this machine and this namespace of process numbers."""
    parts = [platform.node()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
    with suppress(OSError):
        parts.append(str(Path("/proc/self/ns/pid").stat().st_ino))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:8]


def _began(process: int) -> int | None:
    """When a process began, in clock ticks since the machine did; None if there is no such process."""
    try:
        # The name of the program, in parentheses, may hold anything; the 20th field after it is the start.
        fields = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[19])
