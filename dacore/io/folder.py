"""Folders that appear whole or not at all."""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dacore.errors import StoreError
from dacore.io.atomic import make_folder
from dacore.io.leftovers import abandoned, mark


@contextmanager
def atomic_folder(folder: Path, sign: str) -> Iterator[Path]:
    """Give a temporary folder beside `folder` and move it there when the block ends well.

    If the block raises, `folder` stays as it was and the temporary one is removed; if the process is killed, the
    next use removes it.

    Parameters
    ----------
    folder : Path
        An earlier one, known by `sign`, is replaced.
    sign : str
        Name of a file that only such folders hold: what else is there is never deleted.

    Yields
    ------
    Path
        An empty folder to write into.

    Raises
    ------
    StoreError
        If `folder` holds something else, or cannot be written.
    """
    check_folder(folder, sign)
    make_folder(folder.parent)
    _sweep(folder.parent)
    temporary = folder.parent / f".{folder.name}.{mark()}-{secrets.token_hex(4)}"
    earlier = folder.parent / f".{folder.name}.{mark()}-{secrets.token_hex(4)}"
    try:
        temporary.mkdir()
        yield temporary
        if not (temporary / sign).exists():
            raise StoreError(f"{folder}: {sign} was not written")
        try:
            if folder.exists():
                folder.replace(earlier)
            temporary.replace(folder)
        except OSError as error:
            if earlier.exists() and not folder.exists():
                earlier.replace(folder)
            raise StoreError(f"{folder}: cannot be written ({error.strerror}); check space and rights") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(earlier, ignore_errors=True)


def check_folder(folder: Path, sign: str) -> None:
    """Raise StoreError if a folder holds anything but an earlier one of its kind."""
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / sign).exists())):
        raise StoreError(f"{folder}: holds something else (no {sign} in it); choose another folder with --out")


def _sweep(folder: Path) -> None:
    """Remove temporary folders whose process no longer lives."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and abandoned(entry):
                shutil.rmtree(entry.path, ignore_errors=True)
