"""Read files of data: each by the format that knows its name."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dacore.core.data import Asked, Data, DataFormat
from dacore.errors import DacoreError, MissingDependencyError, PluginError, StoreError
from dacore.plugins.registry import Registry


@dataclass(frozen=True)
class Source:
    """A file that was read.

    Parameters
    ----------
    path : Path
    format : str
    sha256 : str
        Of its content, as it was when the work began.
    """

    path: Path
    format: str
    sha256: str


def read_data(files: Sequence[Path], asked: Asked, registry: Registry) -> tuple[list[Data], list[Source]]:
    """Read all files.

    Parameters
    ----------
    files : sequence of Path
        Of one or several formats; those of a format whose files belong together are one image.
    asked : Asked
    registry : Registry

    Raises
    ------
    StoreError
        If a file is missing or damaged, or no format reads files of its name.
    ShapeError
        If what a file holds cannot be data.
    """
    if not files:
        raise StoreError("--data: no file; expected at least one")
    if len(set(files)) < len(files):
        raise StoreError("--data: a file is given twice; expected each once")
    formats = Formats(registry)
    names = [formats.of(path) for path in files]
    sources = [Source(path, name, digest(path)) for path, name in zip(files, names, strict=True)]
    sources += [Source(path, "", digest(path)) for path in (*asked.phase, *((asked.mask,) if asked.mask else ()))]
    groups: list[tuple[str, list[Path]]] = []
    for path, name in zip(files, names, strict=True):
        together = formats.made(name).together
        group = next((members for other, members in groups if other == name), None) if together else None
        if group is None:
            groups.append((name, [path]))
        else:
            group.append(path)
    images = any(formats.made(name).together for name, _ in groups)
    if not images and (asked.mask is not None or asked.phase):
        raise StoreError("--mask and --phase: are for images in NIfTI files; put a mask into the file of arrays itself")
    out = []
    for name, members in groups:
        mine = asked if formats.made(name).together else replace(asked, mask=None, phase=())
        out.append(formats.made(name).read(members, mine))
    return out, sources


class Formats:
    """The formats that are installed.

    Parameters
    ----------
    registry : Registry
    """

    def __init__(self, registry: Registry) -> None:
        self._made: dict[str, DataFormat] = {}
        self._missing: list[str] = []
        for spec in registry.specs("format"):
            try:
                cls: type[Any] = registry.get("format", spec.name)
                self._made[spec.name] = cls()
            except MissingDependencyError as error:
                self._missing.append(str(error))
            except (PluginError, DacoreError, TypeError) as error:
                self._missing.append(f"format {spec.name}: {error}")

    def made(self, name: str) -> DataFormat:
        """The format of a name."""
        return self._made[name]

    def of(self, path: Path) -> str:
        """Name of the format that reads a file; StoreError if there is none."""
        text = path.name.lower()
        found = [
            (len(suffix), name)
            for name, each in self._made.items()
            for suffix in each.suffixes
            if text.endswith(suffix)
        ]
        if not found:
            known = ", ".join(f"{name} ({', '.join(each.suffixes)})" for name, each in self._made.items())
            missing = "".join(f"; {each}" for each in self._missing)
            raise StoreError(f"{path}: no format reads a file of this name; there are {known}{missing}")
        return max(found)[1]


def digest(path: Path) -> str:
    """SHA-256 of a file's content; StoreError if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except FileNotFoundError as error:
        raise StoreError(f"{path}: no such file; expected measured data") from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror}); expected measured data") from error
