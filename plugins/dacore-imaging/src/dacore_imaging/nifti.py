"""Displacement images in NIfTI files: read as they are meant, refused where nobody can know what is meant."""

import gzip
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.data import Asked, DataFormat, ImageData
from dacore.errors import ShapeError, StoreError
from dacore.io.atomic import atomic_write
from dacore.io.units import chosen_unit

_CENTIMETRES = {"meter": 100.0, "mm": 0.1, "micron": 1e-4}
_SECONDS = {"sec": 1.0, "msec": 1e-3, "usec": 1e-6}
_UNIT = re.compile(r"\[([^\[\]]+)\]")
# Two affines are one if they put every voxel at the same place to this part of a voxel.
_SAME = 1e-3
_DAMAGED = (OSError, EOFError, ValueError, zlib.error, TypeError, KeyError)


@dataclass(frozen=True)
class Nifti(DataFormat):
    """One file, or one a component: (x, y, z), (x, y, z, t) or (x, y, z, t, component); real or complex."""

    suffixes: ClassVar[tuple[str, ...]] = (".nii", ".nii.gz")
    together: ClassVar[bool] = True

    def read(self, files: Sequence[Path], asked: Asked) -> ImageData:
        """Read one image.

        Raises
        ------
        StoreError
            If a file is missing, damaged or no NIfTI.
        ShapeError
            If files do not fit together, or their header does not say where they lie.
        """
        volumes = [_Volume.read(path) for path in files]
        first = volumes[0]
        for other in volumes[1:]:
            first.same_grid(other)
            first.same_times(other)
        if len(volumes) > 1 and any(each.values.shape[4] > 1 for each in volumes):
            raise ShapeError(f"{first.name}: holds several components, and more files are given; give one of both")
        values = np.concatenate([each.values for each in volumes], axis=4)
        if asked.phase:
            values = _with_phase(values, volumes, asked.phase)
        mask = None
        if asked.mask is not None:
            mask = _mask(asked.mask, first)
            values = np.where(mask[..., None, None], values, np.nan)
        name = first.name if len(files) == 1 else f"{first.name} and {len(files) - 1} more"
        count = values.shape[4]
        if not asked.components and count == 2:
            raise ShapeError(f"{name}: two components of three; is a file missing? Say which with --components, as x,y")
        unit, replaced = chosen_unit(asked.unit, first.unit, name)
        notes = (*replaced, *dict.fromkeys(n for v in volumes for n in v.notes))
        return ImageData(
            name, values, first.affine, unit,
            asked.components or ((-1,) if count == 1 else tuple(range(count))),
            asked.field, asked.frame, np.array(asked.times) if asked.times is not None else first.times,
            frequency=asked.frequency, mask=mask, notes=notes,
            source="nifti",
        )  # fmt: skip

    def write_image(self, path: Path, values: Array, image: ImageData, name: str, unit: str, times: Array) -> Path:
        """Write ``.nii.gz``; vectors as (x, y, z, t, component) with the intent of a vector."""
        nibabel: Any = import_module("nibabel")
        array = values.astype(np.float32)
        if array.shape[4] == 1:
            array = array[..., 0]
            if array.shape[3] == 1:
                array = array[..., 0]
        affine = image.affine.copy()
        affine[:3] /= _CENTIMETRES["mm"]
        made = nibabel.Nifti1Image(array, affine)
        header = made.header
        made.set_sform(affine, code="scanner")
        header.set_xyzt_units("mm", "sec")
        if array.ndim > 3:
            steps = np.diff(times)
            header["pixdim"][4] = float(steps.mean()) if steps.size else 0.0
            header["toffset"] = float(times[0])
        title = f"{name} [{unit}]"
        header.set_intent("vector" if array.ndim == 5 else "none", (), title if len(title) < 16 else "")
        header["descrip"] = title.encode("utf-8")[:79]
        target = path.with_name(f"{path.name}.nii.gz")
        with atomic_write(target) as stream:
            # No time of writing: the same fields give the same bytes.
            stream.write(gzip.compress(made.to_bytes(), mtime=0))
        return target


@dataclass(frozen=True, eq=False)
class _Volume:
    """What one file holds: values (x, y, z, t, c), affine [cm], and what its header says."""

    name: str
    values: Any
    affine: Array
    unit: str | None
    times: Array | None
    notes: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> "_Volume":
        image = _open(path)
        header = image.header
        notes: list[str] = []
        affine, scale = _affine(path.name, header, notes)
        try:
            values = np.asanyarray(image.dataobj)
        except _DAMAGED as error:
            raise StoreError(
                f"{path}: its values cannot be read ({_reason(error)}); the file is cut short or damaged, copy it again"
            ) from error
        if values.dtype.kind in "iu":
            values = values.astype(np.float64)
        if values.dtype.kind not in "fc":
            raise ShapeError(f"{path.name}: voxels of type {values.dtype}, expected real or complex numbers")
        values, times = _arranged(path.name, values, header, notes)
        affine[:3] *= scale
        text = f"{_string(header['intent_name'])} {_string(header['descrip'])}"
        unit = _UNIT.search(text)
        return cls(path.name, values, affine, unit[1] if unit else None, times, tuple(notes))

    def same_grid(self, other: "_Volume") -> None:
        """Raise ShapeError unless another file has the same grid."""
        _same_grid(self, other.name, other.values.shape[:3], other.affine)
        if other.unit != self.unit:
            one, two = self.unit or "no unit", other.unit or "no unit"
            raise ShapeError(f"{other.name}: its values are in {two}, those of {self.name} in {one}; expected one unit")

    def same_times(self, other: "_Volume") -> None:
        """Raise ShapeError unless another file has volumes of the same times."""
        mine, theirs = self.values.shape[3], other.values.shape[3]
        if mine != theirs:
            raise ShapeError(f"{other.name}: {theirs} volumes, expected {mine} as in {self.name}")
        if (self.times is None) != (other.times is None) or (
            self.times is not None and other.times is not None and not np.allclose(self.times, other.times)
        ):
            raise ShapeError(f"{other.name}: its volumes have other times than those of {self.name}")


def read_grid(path: Path) -> tuple[Array, tuple[int, ...], tuple[str, ...]]:
    """Affine (4, 4) [cm], shape and notes of an image; its values are not read."""
    header = _open(path).header
    notes: list[str] = []
    affine, scale = _affine(path.name, header, notes)
    affine[:3] *= scale
    return affine, tuple(int(n) for n in header.get_data_shape()[:3]), tuple(notes)


def read_mask(path: Path, name: str, affine: Array, shape: tuple[int, ...]) -> BoolArray:
    """Where an image is not zero, on a grid that it must have."""
    found = _Volume.read(path)
    if found.values.shape[3:] != (1, 1):
        raise ShapeError(f"{found.name}: a mask of shape {found.values.shape}, expected one volume of three dimensions")
    _same_grid(
        _Volume(name, np.empty((*shape, 1, 1)), affine, None, None, ()),
        found.name,
        found.values.shape[:3],
        found.affine,
    )
    values = np.nan_to_num(found.values[..., 0, 0])
    if not values.any():
        raise ShapeError(f"{found.name}: the mask is zero everywhere; expected some voxels that are not")
    return np.asarray(values != 0)


def _mask(path: Path, volume: _Volume) -> BoolArray:
    return read_mask(path, volume.name, volume.affine, volume.values.shape[:3])


def _open(path: Path) -> Any:
    nibabel: Any = import_module("nibabel")

    if not path.exists():
        raise StoreError(f"{path}: no such file; expected a NIfTI image")
    try:
        image = nibabel.load(path)
    except (nibabel.filebasedimages.ImageFileError, nibabel.spatialimages.HeaderDataError, *_DAMAGED) as error:
        raise StoreError(f"{path}: is no NIfTI image, or cut short ({_reason(error)}); copy it again") from error
    if not isinstance(image, nibabel.Nifti1Image):
        raise StoreError(f"{path}: is a {type(image).__name__}, expected a NIfTI image")
    return image


def _affine(name: str, header: Any, notes: list[str]) -> tuple[Array, float]:
    """The header's affine in its own unit, and that unit in cm."""
    if len(header.get_data_shape()) < 3:
        raise ShapeError(f"{name}: {len(header.get_data_shape())} dimensions, expected an image of three")
    sform, qform = int(header["sform_code"]), int(header["qform_code"])
    if sform == 0 and qform == 0:
        raise ShapeError(
            f"{name}: neither sform nor qform says where the image lies; set one of them, with a code above 0"
        )
    unit = header.get_xyzt_units()[0]
    if unit not in _CENTIMETRES:
        notes.append(f"{name}: the header does not say the unit of its affine; taken as mm")
    to_cm = _CENTIMETRES.get(unit, _CENTIMETRES["mm"])
    affine = np.array(header.get_best_affine(), dtype=np.float64)
    if sform > 0 and qform > 0:
        other = np.array(header.get_qform(), dtype=np.float64)
        shape = header.get_data_shape()[:3]
        gap, how = _gap(to_cm * affine, to_cm * other, shape)
        if gap > 1e-2:
            notes.append(f"{name}: sform and qform put voxels up to {how} apart; the sform is taken, as is usual")
    return affine, to_cm


def _arranged(name: str, values: Any, header: Any, notes: list[str]) -> tuple[Any, Array | None]:
    """Values (x, y, z, t, c) and the times of the volumes, if the header says them."""
    if values.ndim > 5 and values.shape[5:] == (1,) * (values.ndim - 5):
        values = values.reshape(values.shape[:5])
    if values.ndim > 5:
        raise ShapeError(
            f"{name}: {values.ndim} dimensions, expected (x, y, z), (x, y, z, t) or (x, y, z, t, component)"
        )
    if values.ndim == 4 and header.get_intent()[0] in ("vector", "displacement vector"):
        notes.append(f"{name}: a vector image of four dimensions; the fourth is taken for the components")
        values = values[:, :, :, None]
    values = values.reshape(*values.shape, *[1] * (5 - values.ndim))
    if values.shape[4] > 3:
        raise ShapeError(f"{name}: {values.shape[4]} components, expected at most 3; times come before components")
    count, unit = values.shape[3], header.get_xyzt_units()[1]
    step = float(header["pixdim"][4])
    if count == 1 or step <= 0 or unit not in _SECONDS:
        return values, None
    return values, _SECONDS[unit] * (float(header["toffset"]) + step * np.arange(count))


def _with_phase(values: Any, volumes: Sequence[_Volume], files: Sequence[Path]) -> Any:
    if len(files) != len(volumes):
        raise ShapeError(f"--phase: {len(files)} files, expected {len(volumes)}, one for each of --data")
    if np.iscomplexobj(values):
        raise ShapeError(f"{volumes[0].name}: is complex already; leave --phase out")
    phases = [_Volume.read(path) for path in files]
    for amplitude, phase in zip(volumes, phases, strict=True):
        _same_grid(amplitude, phase.name, phase.values.shape[:3], phase.affine)
        if phase.values.shape != amplitude.values.shape:
            raise ShapeError(
                f"{phase.name}: shape {phase.values.shape}, expected {amplitude.values.shape} as its amplitude"
            )
        largest = float(np.nanmax(np.abs(phase.values)))
        if largest > 2.02 * np.pi:
            raise ShapeError(f"{phase.name}: phases reach {largest:.4g}, expected radians, at most 2π; scale them")
    if (values < 0).any():
        raise ShapeError(f"{volumes[0].name}: amplitudes are negative; expected 0 or more")
    return values * np.exp(1j * np.concatenate([each.values for each in phases], axis=4))


def _gap(one: Array, other: Array, shape: Sequence[int]) -> tuple[float, str]:
    """How far two affines put a corner of the image apart: in voxels, and as text with the axis and the length."""
    corners = np.stack(np.meshgrid(*[[0, n - 1] for n in shape], indexing="ij"), axis=-1).reshape(-1, 3)
    away = corners @ (other - one)[:3, :3].T + (other - one)[:3, 3]
    voxels = np.abs(np.linalg.solve(one[:3, :3], away.T).T)
    worst = int(voxels.max(axis=0).argmax())
    length = float(np.linalg.norm(away, axis=1).max())
    return float(voxels.max()), f"{voxels.max():.3g} voxels along {'ijk'[worst]} ({10 * length:.3g} mm)"


def _same_grid(volume: _Volume, name: str, shape: tuple[int, ...], affine: Array) -> None:
    mine = volume.values.shape[:3]
    if tuple(shape) != mine:
        raise ShapeError(
            f"{name}: {' × '.join(map(str, shape))} voxels, expected {' × '.join(map(str, mine))} as {volume.name}"
        )
    gap, how = _gap(volume.affine, affine, mine)
    if gap > _SAME:
        raise ShapeError(
            f"{name}: its affine puts voxels up to {how} away from where {volume.name} has them; expected one affine"
        )


def _string(field: Any) -> str:
    return bytes(field.tobytes()).split(b"\0")[0].decode("utf-8", "replace")


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
