"""Files that appear whole or not at all."""

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from dacore.errors import StoreError
from dacore.io.leftovers import mark, sweep


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, and remove what killed processes left half-written in it.

    Raises
    ------
    StoreError
        If the folder cannot be made or nothing can be written there.
    """
    _made(folder)
    sweep(folder)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path` and move it there when the block ends well.

    For libraries that open files themselves (HDF5, meshio). The temporary name keeps the suffix of
    `path`. If the block raises, `path` stays as it was and the temporary file is removed; if the
    process is killed, the next `make_folder` removes it.

    Parameters
    ----------
    path : str or Path
        Its folder is made if it is not there.

    Yields
    ------
    Path
        Where to write; nothing is there yet.

    Raises
    ------
    StoreError
        If the folder cannot be made, the block wrote nothing, or the file cannot be moved into place.
    """
    target = Path(path)
    if target.is_dir():
        raise StoreError(f"{target}: is a folder, expected the name of a file to write")
    _made(target.parent)
    # The same folder, so that the move stays on one file system and is a single step; a name of this
    # process and a random part, so that two runs that write the same file do not write into each other's.
    temporary = target.parent / f".{target.stem}.{mark()}-{secrets.token_hex(4)}{target.suffix}"
    try:
        yield temporary
        if not temporary.exists():
            raise StoreError(f"{target}: nothing was written to its temporary file {temporary.name}")
        try:
            _sync(temporary)
            temporary.replace(target)
        except OSError as error:
            raise StoreError(f"{target}: cannot be written ({error.strerror}); check space and rights") from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_write(path: str | Path) -> Iterator["AtomicFile"]:
    """Collect text or bytes and write them to `path` in one step when the block ends well.

    Parameters
    ----------
    path : str or Path

    Yields
    ------
    AtomicFile
        Its ``write`` takes str (stored as UTF-8 with plain line ends) or bytes.

    Raises
    ------
    StoreError
        If the file cannot be written; `path` then stays as it was.
    """
    with atomic_path(path) as temporary:
        try:
            with temporary.open("wb") as stream:
                yield AtomicFile(stream.write)
        except OSError as error:
            # An error of the caller's own files names them; do not blame `path` for it.
            if error.filename is not None and Path(str(error.filename)) != temporary:
                raise
            raise StoreError(f"{path}: cannot be written ({error.strerror}); check space and rights") from error


class AtomicFile:
    """The writing end of `atomic_write`."""

    def __init__(self, sink: Callable[[bytes], int]) -> None:
        self._sink = sink

    def write(self, content: str | bytes) -> int:
        """Append text (UTF-8) or bytes; returns how many bytes were taken."""
        return self._sink(content.encode("utf-8") if isinstance(content, str) else content)


def _made(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{folder}: cannot make this folder ({error.strerror}); choose another one") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise StoreError(f"{folder}: cannot write into this folder; choose another one or change its rights")


def _sync(path: Path) -> None:
    """Force a file to the disk, or a crash after the move could leave an empty file of the right name."""
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())
