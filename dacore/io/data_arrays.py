"""Measured values as named arrays in an NPZ or HDF5 file: of sensors, or an image where there is an affine."""

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np

from dacore.core.arrays import Array
from dacore.core.data import Asked, Data, DataFormat, ImageData, SensorData
from dacore.errors import ShapeError, StoreError
from dacore.io.atomic import atomic_path
from dacore.io.units import chosen_unit, factor

_NAMES = (
    "values", "labels", "positions", "directions", "components", "fields", "field", "times", "unit", "length_unit",
    "time_unit", "sigma", "mask", "affine", "frequency", "name",
)  # fmt: skip
_DAMAGED = (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError)


@dataclass(frozen=True)
class NpzData(DataFormat):
    """Arrays written by ``numpy.savez``."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def read(self, files: Sequence[Path], asked: Asked) -> Data:
        """Read one file; pickled objects are refused."""
        (path,) = files
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except FileNotFoundError as error:
            raise StoreError(f"{path}: no such file; expected arrays of numpy.savez") from error
        except _DAMAGED as error:
            raise StoreError(f"{path}: cannot be read ({error}); expected arrays of numpy.savez, no objects") from error
        return interpret(arrays, path.name, asked, "npz")

    def write_image(self, path: Path, values: Array, image: ImageData, name: str, unit: str, times: Array) -> Path:
        """Write it with the same names."""
        target = path.with_name(f"{path.name}.npz")
        with atomic_path(target) as temporary:
            arrays: dict[str, Any] = dict(_arrays(values, image, name, unit, times))
            np.savez_compressed(temporary, **arrays)
        return target


@dataclass(frozen=True)
class Hdf5Data(DataFormat):
    """Datasets at the root of an HDF5 file; texts and single numbers may be attributes of the file or of ``values``."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def read(self, files: Sequence[Path], asked: Asked) -> Data:
        """Read one file."""
        (path,) = files
        if not path.exists():
            raise StoreError(f"{path}: no such file; expected an HDF5 file of arrays")
        try:
            with h5py.File(path, "r") as file:
                arrays: dict[str, Any] = {
                    name: each[()] for name, each in file.items() if isinstance(each, h5py.Dataset)
                }
                attributes = dict(file.attrs)
                if "values" in arrays:
                    attributes |= dict(file["values"].attrs)
        except _DAMAGED as error:
            reason = " ".join(str(error).split())  # the library's own message has several lines
            raise StoreError(f"{path}: cannot be read ({reason}); expected a whole HDF5 file") from error
        for name, value in attributes.items():
            if name in _NAMES:
                arrays.setdefault(name, value)
        return interpret(arrays, path.name, asked, "hdf5")

    def write_image(self, path: Path, values: Array, image: ImageData, name: str, unit: str, times: Array) -> Path:
        """Write it with the same names."""
        target = path.with_name(f"{path.name}.h5")
        with atomic_path(target) as temporary, h5py.File(temporary, "w") as file:
            for key, array in _arrays(values, image, name, unit, times).items():
                file[key] = array.item() if array.dtype.kind == "U" and array.ndim == 0 else array
        return target


def _arrays(values: Array, image: ImageData, name: str, unit: str, times: Array) -> dict[str, np.ndarray]:
    return {
        "values": values, "affine": image.affine, "length_unit": np.array("cm"), "unit": np.array(unit),
        "times": times, "name": np.array(name),
    }  # fmt: skip


def interpret(arrays: Mapping[str, Any], name: str, asked: Asked, source: str) -> Data:
    """Make data of arrays by their names.

    Raises
    ------
    ShapeError
        Names the array that is missing, unknown or of a wrong shape.
    """
    for key in arrays:
        if key not in _NAMES:
            close = get_close_matches(key, _NAMES, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"allowed are {', '.join(_NAMES)}"
            raise ShapeError(f"{name}: unknown array {key!r}; {hint}")
    if "values" not in arrays:
        raise ShapeError(f"{name}: no array 'values'; it holds {', '.join(sorted(arrays)) or 'nothing'}")
    values = np.asarray(arrays["values"])
    if values.dtype.kind in "iu":
        values = values.astype(np.float64)
    length = factor(_text(arrays, "length_unit", name) or "cm", "cm", f"{name}: length_unit")
    times = _times(arrays, name, asked)
    unit, notes = chosen_unit(asked.unit, _text(arrays, "unit", name), name)
    shared = {
        "unit": unit,
        "notes": notes,
        "times": times,
        "frequency": asked.frequency if asked.frequency is not None else _number(arrays, "frequency", name),
    }
    if "affine" in arrays:
        return _image(arrays, values, name, asked, source, length, shared)
    return _sensors(arrays, values, name, asked, length, shared)


def _image(
    arrays: Mapping[str, Any], values: np.ndarray, name: str, asked: Asked, source: str, length: float,
    shared: dict[str, Any],
) -> ImageData:  # fmt: skip
    affine = np.array(arrays["affine"], dtype=np.float64)
    dim = len(affine) - 1
    if not dim <= values.ndim <= dim + 2:
        raise ShapeError(
            f"{name}: values of {values.ndim} axes with an affine of {affine.shape}; expected {dim} of space, then "
            "time, then component"
        )
    values = values.reshape(*values.shape, *[1] * (dim + 2 - values.ndim))
    affine[:dim] *= length
    mask = None
    if "mask" in arrays:
        mask = np.asarray(arrays["mask"]) != 0
        if mask.shape != values.shape[:dim]:
            raise ShapeError(f"{name}: mask of shape {mask.shape}, expected {values.shape[:dim]} as the values")
        values = np.where(mask[..., None, None], values, np.nan)
    components = asked.components or tuple(int(c) for c in np.atleast_1d(arrays.get("components", [])))
    count = values.shape[-1]
    if not components and 1 < count < dim:
        raise ShapeError(f"{name}: {count} components of {dim}; say which in an array 'components', as [0, 2]")
    # Which component a single one is, the scene may leave no doubt about.
    components = components or ((-1,) if count == 1 else tuple(range(count)))
    sigma = _number(arrays, "sigma", name)
    return ImageData(
        name, values, affine, components=components, sigma=sigma,
        field=asked.field or _text(arrays, "field", name), frame=asked.frame, mask=mask, source=source, **shared,
    )  # fmt: skip


def _sensors(
    arrays: Mapping[str, Any], values: np.ndarray, name: str, asked: Asked, length: float, shared: dict[str, Any]
) -> SensorData:
    if values.ndim not in (1, 2):
        raise ShapeError(
            f"{name}: values of shape {values.shape}, expected (sensors,) or (sensors, times); an image needs an affine"
        )
    values = values.reshape(len(values), -1)
    n = len(values)
    places = directions = None
    if "positions" in arrays:
        places = length * np.asarray(arrays["positions"], dtype=np.float64)
    if "directions" in arrays:
        directions = np.asarray(arrays["directions"], dtype=np.float64)
    elif "components" in arrays:
        numbers = np.asarray(arrays["components"])
        dim = 3 if places is None or places.ndim != 2 else places.shape[1]
        if numbers.shape != (n,) or numbers.dtype.kind not in "iu" or numbers.min() < 0 or numbers.max() >= dim:
            raise ShapeError(f"{name}: components must be {n} whole numbers from 0 to {dim - 1}, one a sensor")
        directions = np.eye(dim)[numbers]
    labels = _texts(arrays, "labels", name)
    if "mask" in arrays:
        mask = np.asarray(arrays["mask"]) != 0
        if mask.shape not in ((n,), values.shape):
            raise ShapeError(f"{name}: mask of shape {mask.shape}, expected {(n,)} or {values.shape} as the values")
        values = np.where(mask.reshape(n, -1), values, np.nan)
    sigma = None
    if "sigma" in arrays:
        given = np.asarray(arrays["sigma"], dtype=np.float64)
        if given.shape not in ((), (n,), values.shape):
            raise ShapeError(f"{name}: sigma of shape {given.shape}, expected one number, {(n,)} or {values.shape}")
        sigma = np.array(np.broadcast_to(given.reshape(-1, 1) if given.ndim == 1 else given, values.shape))
    field = asked.field or _text(arrays, "field", name)
    fields = _texts(arrays, "fields", name) or ((field,) * n if field else ())
    return SensorData(
        name, values, labels=labels, places=places, directions=directions, fields=fields, sigma=sigma, **shared
    )  # fmt: skip


def _times(arrays: Mapping[str, Any], name: str, asked: Asked) -> Array | None:
    if asked.times is not None:
        return np.array(asked.times)
    if "times" not in arrays:
        return None
    scale = factor(_text(arrays, "time_unit", name) or "s", "s", f"{name}: time_unit")
    return scale * np.atleast_1d(np.asarray(arrays["times"], dtype=np.float64))


def _number(arrays: Mapping[str, Any], key: str, name: str) -> float | None:
    if key not in arrays:
        return None
    value = np.asarray(arrays[key])
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise ShapeError(f"{name}: {key} of shape {value.shape}, expected one number")
    return float(value.reshape(()))


def _text(arrays: Mapping[str, Any], key: str, name: str) -> str | None:
    found = _texts(arrays, key, name)
    if len(found) > 1:
        raise ShapeError(f"{name}: {key} holds {len(found)} texts, expected one")
    return found[0] if found else None


def _texts(arrays: Mapping[str, Any], key: str, name: str) -> tuple[str, ...]:
    if key not in arrays:
        return ()
    flat = np.atleast_1d(np.asarray(arrays[key])).ravel().tolist()
    if not all(isinstance(each, str | bytes) for each in flat):
        raise ShapeError(f"{name}: {key} must be text")
    return tuple(each.decode("utf-8") if isinstance(each, bytes) else each for each in flat)
