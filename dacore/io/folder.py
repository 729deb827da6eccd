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

# What such a folder was written with, a path a line: anything beside that is somebody's own.
_LIST = ".files"


@contextmanager
def atomic_folder(folder: Path, sign: str) -> Iterator[Path]:
    """Give a temporary folder beside `folder` and move it there when the block ends well.

    If the block raises, `folder` stays as it was and the temporary one is removed; if the process is killed, the
    next use removes it.

    Parameters
    ----------
    folder : Path
        An earlier one, known by `sign`, is replaced, if nobody put anything else into it.
    sign : str
        Name of a file that only such folders hold.

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
        (temporary / _LIST).write_text("\n".join(sorted(_files(temporary))), encoding="utf-8")
        check_folder(folder, sign)
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
    """Raise StoreError if a folder holds anything but an earlier one of its kind, as that was written."""
    if not folder.exists():
        return
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / sign).exists()):
        raise StoreError(f"{folder}: holds something else (no {sign} in it); choose another folder with --out")
    try:
        listed = (folder / _LIST).read_text(encoding="utf-8").splitlines()
    except OSError:
        listed = [sign]
    strange = sorted(_files(folder) - {*listed, _LIST})
    if strange:
        more = f" and {len(strange) - 1} more" if len(strange) > 1 else ""
        raise StoreError(
            f"{folder}: holds {strange[0]}{more}, which an earlier run did not write and replacing the folder would "
            "delete; move it, or choose another folder with --out"
        )


def _files(folder: Path) -> set[str]:
    """Paths of everything in a folder that is no folder, from there."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()}


def _sweep(folder: Path) -> None:
    """Remove temporary folders whose process no longer lives."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and abandoned(entry):
                shutil.rmtree(entry.path, ignore_errors=True)
