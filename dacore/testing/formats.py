"""Contracts of a data format: what was written is read, and what cannot be read is told in one line."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dacore.core.data import Asked, Data, DataFormat, ImageData, SensorData
from dacore.errors import DacoreError, PluginError, ShapeError, StoreError
from dacore.testing import settings
from dacore.testing.suite import Suite, bind, expect_kind, expect_maker, fail, require

Write = Callable[[Path], Path | Sequence[Path]]

# Text of no encoding and no file of any kind, the same each time.
_NOISE = bytes(np.random.default_rng(7).integers(128, 256, 4096, dtype=np.uint8))
# What is not part of the measurement: whence, and what the reader had to suppose.
_ASIDE = ("name", "notes", "source")


@dataclass(frozen=True, eq=False)
class Files:
    """A format, what writes a good set of its files, and what they hold.

    Parameters
    ----------
    reader : DataFormat
    write : callable
        Writes into a folder and returns the path, or the paths of files that belong together.
    expected : SensorData or ImageData
    asked : Asked
    """

    reader: DataFormat
    write: Write
    expected: Data
    asked: Asked

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.reader).__name__

    def made(self, folder: Path) -> list[Path]:
        """Write the files."""
        written = self.write(folder)
        paths = [written] if isinstance(written, Path) else list(written)
        for path in paths:
            require(path.is_file(), f"{self.name}: write says that it wrote {path}, but there is no such file")
        return paths

    def read(self, paths: Sequence[Path], **asked: Any) -> Data:
        """Read files, perhaps with more said beside them."""
        return self.reader.read(paths, replace(self.asked, **asked))

    def refused(self, paths: Sequence[Path], bad: Path, what: str, *kinds: type[DacoreError]) -> DacoreError | None:
        """Return the error that a bad file is answered with, None if it is read; nothing else may be raised."""
        try:
            self.read(paths)
        except kinds as error:
            text = str(error)
            require("\n" not in text, f"{self.name}: {what} is told in several lines: {text!r}")
            require(bad.name in text, f"{self.name}: {what} is told without the name of the file: {text!r}")
            return error
        except Exception as error:  # noqa: BLE001  a reader may raise anything; that is what is looked for
            expected = " or ".join(kind.__name__ for kind in kinds)
            fail(f"{self.name}: {what} raises {type(error).__name__} ({error}), expected {expected}")
        return None


def suffixes_are_declared(files: Files) -> None:
    """`suffixes` are endings such as ".csv", lower case, and the files have one of them."""
    suffixes: Any = files.reader.suffixes
    good = isinstance(suffixes, tuple) and suffixes and all(isinstance(each, str) for each in suffixes)
    require(bool(good), f'{files.name}: suffixes is {suffixes!r}, expected a tuple of texts, (".csv",)')
    for suffix in suffixes:
        good = suffix.startswith(".") and len(suffix) > 1 and suffix == suffix.lower()
        require(good, f"{files.name}: the suffix {suffix!r} should begin with a point and be of lower case")
    with TemporaryDirectory() as folder:
        for path in files.made(Path(folder)):
            require(path.name.endswith(suffixes), f"{files.name}: wrote {path.name}, expected a name in {suffixes}")


def what_was_written_is_read(files: Files) -> None:
    """Values, units, places, times and all else that files say is read: bit for bit, lengths and times to 1e-12."""
    with TemporaryDirectory() as folder:
        _same(files, files.read(files.made(Path(folder))), files.expected, "")


def the_same_again(files: Files) -> None:
    """Read again, also under another name and from a read-only file, the data are the same; no file is changed."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        before = [path.read_bytes() for path in paths]
        first = files.read(paths)
        require([path.read_bytes() for path in paths] == before, f"{files.name}: reading changes a file")
        _same(files, files.read(paths), first, "read again, ")
        moved = [path.rename(path.with_name(f"Other {path.name}")) for path in paths]
        for path in moved:
            path.chmod(0o400)
        _same(files, files.read(moved), first, "under another name and read-only, ")
        left = sorted(each.name for each in Path(folder).iterdir())
        require(left == sorted(path.name for path in moved), f"{files.name}: reading leaves files beside: {left}")


def data_are_named_after_their_file(files: Files) -> None:
    """`name` of the data has the name of the first file in it, which messages about the data begin with."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        name = files.read(paths).name
        require(paths[0].name in name, f"{files.name}: data of {paths[0].name} are named {name!r}")


def what_the_user_says_counts(files: Files) -> None:
    """A unit and times that are asked for are those of the data, or refused where the file says something else."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        with suppress(DacoreError):
            unit = files.read(paths, unit="K").unit
            require(unit == "K", f"{files.name}: asked for the unit 'K' the data have {unit!r}")
        steps = files.expected.values.shape[1 if isinstance(files.expected, SensorData) else -2]
        times = tuple(100.0 + k for k in range(steps))
        with suppress(DacoreError):
            data = files.read(paths, times=times)
            good = data.times is not None and np.array_equal(data.times, times)
            require(good, f"{files.name}: asked for the times {list(times)} the data have {data.times}")


def what_is_missing_is_refused(files: Files) -> None:
    """Each file that is not there, or a folder in its place, raises StoreError in one line that names it."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        for path in paths:
            kept = path.read_bytes()
            path.unlink()
            what = "a file that is not there"
            require(files.refused(paths, path, what, StoreError) is not None, f"{files.name}: {what} is read")
            path.mkdir()
            what = "a folder in place of a file"
            require(files.refused(paths, path, what, StoreError) is not None, f"{files.name}: {what} is read")
            path.rmdir()
            path.write_bytes(kept)


def what_is_damaged_is_refused(files: Files) -> None:
    """Each file that is empty or noise raises StoreError or ShapeError in one line that names it."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        for path in paths:
            kept = path.read_bytes()
            for what, content in (("an empty file", b""), ("a file of noise", _NOISE)):
                path.write_bytes(content)
                told = files.refused(paths, path, what, StoreError, ShapeError)
                require(told is not None, f"{files.name}: {what} is read as data")
            path.write_bytes(kept)


def what_is_cut_short_is_no_surprise(files: Files) -> None:
    """A file that ends early raises StoreError or ShapeError, or is one that could have been written so."""
    with TemporaryDirectory() as folder:
        paths = files.made(Path(folder))
        for path in paths:
            kept = path.read_bytes()
            for tenth in range(1, 10):
                path.write_bytes(kept[: len(kept) * tenth // 10])
                files.refused(paths, path, f"a file that ends after {tenth} of 10 parts", StoreError, ShapeError)
            path.write_bytes(kept)


CHECKS = (
    suffixes_are_declared, what_was_written_is_read, the_same_again, data_are_named_after_their_file,
    what_the_user_says_counts, what_is_missing_is_refused, what_is_damaged_is_refused, what_is_cut_short_is_no_surprise,
)  # fmt: skip


def format_suite(reader: DataFormat, write: Write, expected: Data, asked: Asked | None = None) -> Suite:
    """Make every check of a data format, with one set of its files.

    Parameters
    ----------
    reader : DataFormat
    write : callable
        Takes a folder, writes a good file there, and returns its path; or the paths of files that belong together.
        Best not by the code that reads.
    expected : SensorData or ImageData
        What these files hold. Its `name`, `notes` and `source` are not looked at.
    asked : Asked, optional
        What the user has to say beside such files.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no format, `expected` is no data, or `write` cannot be called.
    """
    expect_kind("format_suite", reader, DataFormat)
    expect_maker("format_suite", "write", write)
    if not isinstance(expected, SensorData | ImageData):
        raise PluginError(
            f"format_suite: expected is a {type(expected).__name__}, should be the SensorData or ImageData that the "
            "files hold"
        )
    return Suite((*bind(settings.CHECKS, reader), *bind(CHECKS, Files(reader, write, expected, asked or Asked()))))


def _same(files: Files, found: object, expected: Data, how: str) -> None:
    """Raise ContractError unless two sets of data are the same measurement."""
    kind = type(expected).__name__
    require(type(found) is type(expected), f"{files.name}: {how}read gives a {type(found).__name__}, expected {kind}")
    for field in fields(expected):
        if field.name in _ASIDE:
            continue
        one, two = _said(found, field.name), _said(expected, field.name)
        where = f"{files.name}: {how}{field.name}"
        if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
            require(one.shape == two.shape, f"{where} has shape {one.shape}, expected {two.shape}")
            if one.dtype.kind == "b" or field.name == "values":
                same = np.array_equal(one, two, equal_nan=one.dtype.kind != "b")
            else:
                same = np.allclose(
                    one, two, rtol=1e-12, atol=1e-12 * np.nanmax(np.abs(two), initial=0.0), equal_nan=True
                )
            if not same:
                apart = ~np.isclose(one, two, rtol=0.0, atol=0.0, equal_nan=True)
                at = tuple(int(k) for k in np.argwhere(apart)[0])
                fail(f"{where} is {one[at]} at {at}, expected {two[at]} ({int(apart.sum())} differ)")
        else:
            good = one is two or (not isinstance(one, np.ndarray) and not isinstance(two, np.ndarray) and one == two)
            require(good, f"{where} is {one!r}, expected {two!r}")


def _said(data: object, name: str) -> Any:
    """A field of data; None where it says nothing: no direction, no name of a field."""
    value = getattr(data, name)
    nothing = (name == "fields" and not any(value)) or (name == "directions" and value is not None and not value.any())
    return None if nothing else value
