"""Measured data as somebody has them: values of sensors, or an image; and what reads them from files."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.errors import CapabilityError, ShapeError

Frame = Literal["world", "voxel"]
Values = NDArray[Any]


@dataclass(frozen=True)
class Asked:
    """What the user says of the data beside the files; it overrides what the files say.

    Parameters
    ----------
    unit : str, optional
        Of the values.
    times : tuple of float, optional [s]
        When each volume, or each column of values, was measured.
    frequency : float, optional [Hz]
        Of the drive, for complex values.
    field : str, optional
        Field that was measured.
    components : tuple of int
        Component of each file of an image, or along its last axis.
    frame : {"world", "voxel"}
        Whether the components of an image's vectors are along the axes of the world or of the image.
    mask : Path, optional
        Image that is zero where nothing was measured.
    phase : tuple of Path
        Phases [rad] of the amplitudes in the files of data, in the same order.
    """

    unit: str | None = None
    times: tuple[float, ...] | None = None
    frequency: float | None = None
    field: str | None = None
    components: tuple[int, ...] = ()
    frame: Frame = "world"
    mask: Path | None = None
    phase: tuple[Path, ...] = ()


def check_values(what: str, values: Values, unit: str | None) -> None:
    """Raise ShapeError for values that are no numbers, or none of them finite."""
    if values.dtype.kind not in "fc":
        raise ShapeError(f"{what}: got values of type {values.dtype}, expected real or complex numbers")
    if np.isinf(values).any():
        count = int(np.isinf(values).sum())
        raise ShapeError(f"{what}: {count} values are infinite; expected finite numbers, or NaN where one is missing")
    if values.size == 0 or np.isnan(values).all():
        raise ShapeError(f"{what}: holds no value; expected at least one finite number")
    if unit is not None and not unit.strip():
        raise ShapeError(f"{what}: got an empty unit; name it, or leave it out")


def check_sigma(what: str, sigma: Array | None) -> None:
    """Raise ShapeError for standard deviations that are not positive."""
    if sigma is None:
        return
    known = sigma[~np.isnan(sigma)]
    if (known <= 0).any() or np.isinf(known).any():
        worst = known[(known <= 0) | np.isinf(known)][0]
        raise ShapeError(f"{what}: got a standard deviation (sigma) of {worst:g}, expected positive numbers")


@dataclass(frozen=True, eq=False, repr=False)
class SensorData(Displayed):
    """Values of n sensors at t times.

    Parameters
    ----------
    name : str
        Where they come from, for messages.
    values : (n, t) array, real or complex
        NaN where one is missing.
    unit : str, optional
        None if nobody says.
    labels : tuple of str, length n
        Empty without.
    places : (n, d) array, optional [cm]
    directions : (n, d) array, optional
        Measured direction of a vector; zeros where nothing is said.
    fields : tuple of str, length n
        "" where nothing is said; empty without.
    times : (t,) array, optional [s]
    sigma : (n, t) array, optional
        Standard deviation of the noise, in `unit`.
    frequency : float, optional [Hz]
        Of the drive, for complex values.
    notes : tuple of str
        What the reader had to suppose, a line each.

    Raises
    ------
    ShapeError
        If shapes disagree or values are out of range.
    """

    name: str
    values: Values
    unit: str | None
    labels: tuple[str, ...] = ()
    places: Array | None = None
    directions: Array | None = None
    fields: tuple[str, ...] = ()
    times: Array | None = None
    sigma: Array | None = None
    frequency: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.values.ndim != 2:
            raise ShapeError(f"{self.name}: values have shape {self.values.shape}, expected (sensors, times)")
        n, t = self.values.shape
        check_values(self.name, self.values, self.unit)
        if not self.labels and self.places is None:
            raise ShapeError(f"{self.name}: got neither labels nor positions of the sensors; give one of them")
        for what, given in (("labels", self.labels), ("fields", self.fields)):
            if given and len(given) != n:
                raise ShapeError(f"{self.name}: {len(given)} {what}, expected {n} as there are sensors")
        for what, array in (("positions", self.places), ("directions", self.directions)):
            if array is None:
                continue
            if array.ndim != 2 or len(array) != n or not np.isfinite(array).all():
                raise ShapeError(
                    f"{self.name}: {what} of shape {array.shape}, expected {n} rows of finite numbers, one a sensor"
                )
        if self.sigma is not None and self.sigma.shape != (n, t):
            raise ShapeError(f"{self.name}: sigma of shape {self.sigma.shape}, expected {(n, t)} as the values")
        check_sigma(self.name, self.sigma)
        _check_times(self.name, self.times, t)


@dataclass(frozen=True, eq=False, repr=False)
class ImageData(Displayed):
    """An image of a field: values on a grid of voxels, of any affine.

    Parameters
    ----------
    name : str
        Where it comes from, for messages.
    values : (n_1, ..., n_d, t, c) array, real or complex
        NaN where there is no value: outside the mask, too.
    affine : (d + 1, d + 1) array [cm]
        From voxel numbers to voxel centres, in the world of the image.
    unit : str, optional
        None if nobody says.
    components : tuple of int, length c
        Which component of the field stands where on the last axis.
    field : str, optional
        Field that was measured; None if nobody says.
    frame : {"world", "voxel"}
        Whether components are along the world's axes or along those of the image.
    times : (t,) array, optional [s]
    sigma : float, optional
        Standard deviation of the noise, in `unit`.
    frequency : float, optional [Hz]
    mask : (n_1, ..., n_d) bool array, optional
        Where something was measured, if that was said.
    notes : tuple of str
        What the reader had to suppose, a line each.
    source : str
        Name of the format it was read by, which writes images like it.

    Raises
    ------
    ShapeError
        If shapes disagree, the affine is singular, or values are out of range.
    """

    name: str
    values: Values
    affine: Array
    unit: str | None
    components: tuple[int, ...]
    field: str | None = None
    frame: Frame = "world"
    times: Array | None = None
    sigma: float | None = None
    frequency: float | None = None
    mask: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        d = self.values.ndim - 2
        if d not in (2, 3):
            raise ShapeError(
                f"{self.name}: values have {self.values.ndim} axes, expected 2 or 3 of space, time, component"
            )
        check_affine(self.name, self.affine, d)
        check_values(self.name, self.values, self.unit)
        if len(self.components) != self.values.shape[-1] or len(set(self.components)) < len(self.components):
            raise ShapeError(
                f"{self.name}: got the components {list(self.components)} for {self.values.shape[-1]} volumes, "
                "expected one for each and none twice"
            )
        if self.frame not in ("world", "voxel"):
            raise ShapeError(f"{self.name}: got the frame {self.frame!r}, expected 'world' or 'voxel'")
        if self.sigma is not None:
            check_sigma(self.name, np.array([self.sigma]))
        _check_times(self.name, self.times, self.values.shape[-2])

    @property
    def dim(self) -> int:
        """Dimension d of space."""
        return self.values.ndim - 2

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of voxels along each axis."""
        return tuple(int(n) for n in self.values.shape[: self.dim])

    @property
    def size(self) -> Array:
        """Lengths (d,) of a voxel's edges [cm]."""
        return np.asarray(np.linalg.norm(self.affine[:-1, :-1], axis=0))

    @property
    def axes(self) -> Array:
        """Unit vectors along the image's axes, one a column (d, d)."""
        return np.asarray(self.affine[:-1, :-1] / self.size)


def check_affine(what: str, affine: Array, dim: int) -> None:
    """Raise ShapeError unless `affine` (dim + 1, dim + 1) is invertible and its last row is (0, ..., 0, 1)."""
    if affine.shape != (dim + 1, dim + 1) or not np.isfinite(affine).all():
        raise ShapeError(f"{what}: affine of shape {affine.shape}, expected finite numbers ({dim + 1}, {dim + 1})")
    if np.abs(affine[dim] - np.eye(dim + 1)[dim]).max() > 0:
        raise ShapeError(f"{what}: the affine's last row is {affine[dim].tolist()}, expected zeros and a 1")
    edges = affine[:dim, :dim]
    lengths = np.linalg.norm(edges, axis=0)
    if not (lengths > 0).all() or abs(np.linalg.det(edges / np.where(lengths > 0, lengths, 1.0))) < 1e-6:
        raise ShapeError(f"{what}: the affine is singular: voxels have no volume; expected an invertible matrix")


def _check_times(what: str, times: Array | None, count: int) -> None:
    if times is None:
        return
    if times.shape != (count,):
        raise ShapeError(f"{what}: {times.size} times for {count} volumes or columns of values; expected as many")
    if not np.isfinite(times).all() or len(np.unique(times)) < len(times):
        raise ShapeError(f"{what}: times must be finite and different from each other")


Data = SensorData | ImageData


@runtime_checkable
class Placed(Protocol):
    """An observation whose places are given in the world of an image, which lies somewhere in the scene."""

    @property
    def to_scene(self) -> Array:
        """Rigid map (d + 1, d + 1) from the image's world [cm] to the scene's coordinates [cm]."""
        ...


class DataFormat(ABC):
    """Reads measured data from files of one kind; a plugin class of the hook ``dacore_formats``.

    Attributes
    ----------
    suffixes : tuple of str
        Endings of the names of its files, lower case: ``(".nii", ".nii.gz")``.
    together : bool
        Whether several files are parts of one set of data (an image's components), or each is one of its own.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()
    together: ClassVar[bool] = False

    @abstractmethod
    def read(self, files: Sequence[Path], asked: Asked) -> Data:
        """Read files, one unless `together`.

        Raises
        ------
        StoreError
            If a file is missing, damaged, or not of this kind.
        ShapeError
            If what it holds cannot be data; says what and where.
        """

    def write_image(self, path: Path, values: Array, image: ImageData, name: str, unit: str, times: Array) -> Path:
        """Write an image on the grid of another one.

        Parameters
        ----------
        path : Path
            Without the suffix.
        values : (n_1, ..., n_d, t, c) array
            NaN outside.
        image : ImageData
            Whose grid and world it has.
        name, unit : str
            What it shows.
        times : (t,) array [s]

        Returns
        -------
        Path of the file.

        Raises
        ------
        CapabilityError
            If files of this kind hold no image.
        """
        raise CapabilityError(f"{type(self).__name__} writes no images")
