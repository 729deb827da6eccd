"""Measured values of sensors in a CSV file: a row a sensor, or a row a sensor and time."""

import csv
import difflib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dacore.core.arrays import Array
from dacore.core.data import Asked, DataFormat, SensorData
from dacore.errors import ShapeError, StoreError
from dacore.io.units import chosen_unit, factor, split_header

_TEXT = ("label", "field", "component")
_NUMBERS = {
    "x": "cm", "y": "cm", "z": "cm", "nx": "", "ny": "", "nz": "", "time": "s", "value": "", "sigma": "",
    "real": "", "imag": "", "amplitude": "", "phase": "rad",
}  # fmt: skip
_COLUMNS = (*_TEXT, *_NUMBERS)
_VALUES: tuple[tuple[str, ...], ...] = (("value",), ("real", "imag"), ("amplitude", "phase"))
# The first line that spreadsheets write to say how the cells are separated.
_SEPARATOR = re.compile(r'\s*"?sep=.?"?\s*', re.IGNORECASE)
_PARENTHESES = re.compile(r"(\w+)\s*\((.+)\)")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-"}


@dataclass(frozen=True)
class CsvSensors(DataFormat):
    """Comma-, semicolon- or tab-separated values with a header; lines that begin with # are left out."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".tsv", ".txt")

    def read(self, files: Sequence[Path], asked: Asked) -> SensorData:
        """Read one file.

        Raises
        ------
        StoreError
            If it cannot be read as text.
        ShapeError
            Names the column or the line that is wrong.
        """
        (path,) = files
        table = _Table.of(path)
        return _data(table, path.name, asked)


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns of a file, and the line that each row stands on."""

    name: str
    units: Mapping[str, str | None]
    columns: Mapping[str, list[str]]
    lines: list[int]

    @classmethod
    def of(cls, path: Path) -> "_Table":
        name = path.name
        try:
            text = path.read_text(encoding="utf-8-sig")
        except FileNotFoundError as error:
            raise StoreError(f"{path}: no such file; expected a CSV file of sensors") from error
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"{path}: cannot be read ({error}); expected a CSV file of sensors in UTF-8") from error
        numbered = [
            (number, line)
            for number, line in enumerate(text.splitlines(), 1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        if not numbered:
            raise ShapeError(f"{name}: is empty; expected a header such as 'x,y,z,component,value [mm]' and rows")
        if _SEPARATOR.fullmatch(numbered[0][1]):
            del numbered[0]  # what spreadsheets write for one another
        separator = max(",;\t", key=numbered[0][1].count) if numbered else ","
        cells = list(csv.reader([line for _, line in numbered], delimiter=separator))
        if len(cells) != len(numbered):
            raise ShapeError(f"{name}: a quotation mark is opened and not closed on its line")
        filled = [(number, row) for (number, _), row in zip(numbered, cells) if any(cell.strip() for cell in row)]
        if len(filled) < 2:
            raise ShapeError(f"{name}: has a header and no rows; expected a row for each sensor")
        lines, rows = [number for number, _ in filled[1:]], [row for _, row in filled]
        if all(len(row) == len(rows[0]) and not row[-1].strip() for row in rows):
            rows = [row[:-1] for row in rows]  # every line ends in a separator
        header = [split_header(cell) for cell in rows[0]]
        for number, row in zip(lines, rows[1:], strict=True):
            if len(row) != len(header):
                commas = (
                    ": are there decimal commas? Write points" if separator == "," and len(row) > len(header) else ""
                )
                raise ShapeError(
                    f"{name}, line {number}: {len(row)} cells, expected {len(header)} as the header has columns{commas}"
                )
        names = [_known(column.lower(), name) for column, _ in header]
        if len(set(names)) < len(names):
            twice = next(each for each in names if names.count(each) > 1)
            raise ShapeError(f"{name}: the column {twice!r} is there twice; expected each once")
        units = {each: unit for each, (_, unit) in zip(names, header, strict=True)}
        columns = {each: [row[k].strip() for row in rows[1:]] for k, each in enumerate(names)}
        return cls(name, units, columns, lines)

    def numbers(self, column: str, missing: bool = False) -> Array:
        """Numbers of a column; NaN where a cell is empty, which only values may be."""
        out = np.empty(len(self.lines))
        for k, cell in enumerate(self.columns[column]):
            if cell.lower() in _MISSING:
                out[k] = np.nan
                continue
            try:
                out[k] = float(cell)
            except ValueError as error:
                point = " with a decimal point" if "," in cell else ""
                raise ShapeError(
                    f"{self.name}, line {self.lines[k]}: {column} is {cell!r}, expected a number{point}"
                ) from error
        bad = np.isinf(out) if missing else ~np.isfinite(out)
        if bad.any():
            line = self.lines[int(np.flatnonzero(bad)[0])]
            raise ShapeError(f"{self.name}, line {line}: {column} is missing or infinite, expected a number")
        return out

    def scaled(self, column: str, unit: str) -> Array:
        """Numbers of a column in a unit, from that of its header if there is one."""
        given = self.units[column]
        scale = 1.0 if given is None else factor(given, unit, f"{self.name}: column {column}")
        return scale * self.numbers(column)


def _known(column: str, name: str) -> str:
    if column in _COLUMNS:
        return column
    if bare := _PARENTHESES.fullmatch(column):
        raise ShapeError(
            f"{name}: unknown column {column!r}; units stand in square brackets, as '{bare[1]} [{bare[2]}]'"
        )
    close = difflib.get_close_matches(column, _COLUMNS, n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"allowed are {', '.join(_COLUMNS)}"
    raise ShapeError(f"{name}: unknown column {column!r}; {hint}")


def _data(table: _Table, name: str, asked: Asked) -> SensorData:
    here = set(table.columns)
    values, found = _values(table)
    unit, notes = chosen_unit(asked.unit, found, name)
    places = None
    if axes := [axis for axis in "xyz" if axis in here]:
        if axes != list("xyz"[: len(axes)]) or len(axes) < 2:
            raise ShapeError(f"{name}: got the columns {', '.join(axes)}, expected x, y, z (x, y in two dimensions)")
        places = np.stack([table.scaled(axis, "cm") for axis in axes], axis=1)
    labels = table.columns.get("label")
    if places is None and labels is None:
        raise ShapeError(f"{name}: neither a column label nor columns x, y, z; expected where each value was measured")
    if labels is not None and "" in labels:
        raise ShapeError(f"{name}, line {table.lines[labels.index('')]}: label is empty; expected one of the scene's")
    fields = table.columns.get("field", [asked.field or ""] * len(table.lines))
    directions = _directions(table, 3 if places is None else places.shape[1])
    sigma = table.numbers("sigma") if "sigma" in here else None
    if sigma is not None:
        check = sigma <= 0
        if check.any():
            line = table.lines[int(np.flatnonzero(check)[0])]
            raise ShapeError(f"{name}, line {line}: sigma is {sigma[check][0]:g}, expected a positive number")
        if (given := table.units["sigma"]) is not None and unit is not None:
            sigma = sigma * factor(given, unit, f"{name}: column sigma")
    times = table.scaled("time", "s") if "time" in here else None

    def key(row: int) -> tuple[object, ...]:
        place = () if places is None else tuple(np.round(places[row], 9).tolist())
        return (labels[row] if labels is not None else "", place, fields[row], tuple(directions[row].tolist()))

    sensor, first = _numbered(len(values), key)
    known = np.zeros(len(values)) if times is None else np.round(times, 15)
    when, column = np.unique(known, return_inverse=True)
    column = column.reshape(-1)
    _once(table, sensor, column, times)
    grid = np.full((len(first), len(when)), np.nan, dtype=values.dtype)
    grid[sensor, column] = values
    spread = None
    if sigma is not None:
        spread = np.full(grid.shape, np.nan)
        spread[sensor, column] = sigma
    if asked.times is not None:
        if times is not None:
            raise ShapeError(f"{name}: has a column time, and --times is given; leave one of them out")
        when, times = np.array(asked.times), np.array(asked.times)
    return SensorData(
        name, grid, unit, tuple(labels[k] for k in first) if labels is not None else (),
        None if places is None else places[first], directions[first], tuple(fields[k] for k in first),
        None if times is None else when, spread, asked.frequency, notes,
    )  # fmt: skip


def _values(table: _Table) -> tuple[np.ndarray, str | None]:
    here = set(table.columns)
    given = [names for names in _VALUES if here & set(names)]
    if len(given) != 1 or not set(given[0]) <= here:
        raise ShapeError(
            f"{table.name}: columns {', '.join(sorted(here))}; expected value, or real and imag, or amplitude and phase"
        )
    names = given[0]
    first = table.numbers(names[0], missing=True)
    unit = table.units[names[0]]
    if names == ("value",):
        return first, unit
    second = table.numbers(names[1], missing=True)
    if names == ("amplitude", "phase"):
        largest = float(np.nanmax(np.abs(second), initial=0.0))
        if table.units["phase"] is None and largest > 2.02 * np.pi:
            raise ShapeError(
                f"{table.name}: column phase: without a unit it is in radians, but goes up to {largest:.4g}; write the "
                "unit into the header, as 'phase [deg]' or 'phase [rad]'"
            )
        scale = factor(table.units["phase"] or "rad", "rad", f"{table.name}: column phase")
        if (first < 0).any():
            line = table.lines[int(np.flatnonzero(first < 0)[0])]
            raise ShapeError(f"{table.name}, line {line}: amplitude is negative, expected 0 or more")
        return first * np.exp(1j * scale * second), unit
    if table.units["imag"] is not None and unit is not None:
        second = second * factor(table.units["imag"] or unit, unit, f"{table.name}: column imag")
    return first + 1j * second, unit


def _directions(table: _Table, dim: int) -> Array:
    """Unit vectors (n, dim) of what is measured; zeros where nothing is said."""
    out = np.zeros((len(table.lines), dim))
    normals = [axis for axis in ("nx", "ny", "nz")[:dim] if axis in table.columns]
    if normals and "component" in table.columns:
        raise ShapeError(f"{table.name}: both component and {', '.join(normals)}; expected one way to give a direction")
    if normals:
        if len(normals) < dim:
            raise ShapeError(
                f"{table.name}: columns {', '.join(normals)}; expected all of {', '.join(('nx', 'ny', 'nz')[:dim])}"
            )
        vectors = np.stack([table.numbers(axis) for axis in normals], axis=1)
        length = np.linalg.norm(vectors, axis=1)
        if (np.abs(length - 1.0) > 1e-3).any():
            k = int(np.flatnonzero(np.abs(length - 1.0) > 1e-3)[0])
            raise ShapeError(f"{table.name}, line {table.lines[k]}: nx, ny, nz have length {length[k]:.3g}, expected 1")
        return np.asarray(vectors / length[:, None])
    for k, cell in enumerate(table.columns.get("component", [])):
        if cell == "":
            continue
        if cell.lower() in "xyz"[:dim]:
            out[k, "xyz".index(cell.lower())] = 1.0
        elif cell.isdigit() and int(cell) < dim:
            out[k, int(cell)] = 1.0
        else:
            allowed = ", ".join("xyz"[:dim])
            raise ShapeError(f"{table.name}, line {table.lines[k]}: component is {cell!r}, expected {allowed}")
    return out


def _numbered(count: int, key: Callable[[int], tuple[object, ...]]) -> tuple[np.ndarray, list[int]]:
    """Number of the sensor of each row, in the order of the file, and the first row of each sensor."""
    known: dict[tuple[object, ...], int] = {}
    first: list[int] = []
    out = np.empty(count, dtype=np.int64)
    for row in range(count):
        name = key(row)
        if name not in known:
            known[name] = len(first)
            first.append(row)
        out[row] = known[name]
    return out, first


def _once(table: _Table, sensor: np.ndarray, column: np.ndarray, times: Array | None) -> None:
    """Raise ShapeError if a sensor has two values at one time."""
    order = np.lexsort((np.arange(len(sensor)), column, sensor))
    same = (np.diff(sensor[order]) == 0) & (np.diff(column[order]) == 0)
    if same.any():
        k = int(np.flatnonzero(same)[0])
        one, other = table.lines[order[k]], table.lines[order[k + 1]]
        what = "sensor" if times is None else "sensor and time"
        advice = "; a column time tells values of one sensor apart" if times is None else ""
        raise ShapeError(f"{table.name}: lines {one} and {other} are of the same {what}; remove one{advice}")
