"""Averages over the voxels of an image that somebody took: its grid, its orientation, its mask."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array, diags_array

from dacore.core.arrays import Array
from dacore.core.data import check_affine
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.space import StateSpace
from dacore.errors import ShapeError
from dacore_imaging.grid import Axis, Grid
from dacore_imaging.layers import Layer, cover
from dacore_imaging.measured import measured, place, stack_sites
from dacore_imaging.nifti import read_grid, read_mask

_RIGID = 1e-6


class SkewGrid(Grid):
    """Parallelepipeds of any affine: an average over one is that over a unit box in the image's own coordinates."""

    def __init__(self, affine: Array) -> None:
        dim = len(affine) - 1
        check_affine("image", affine, dim)
        edges = affine[:dim, :dim]
        size = np.linalg.norm(edges, axis=0)
        values = {
            "origin": affine[:dim, dim] - 0.5 * edges.sum(axis=1), "axes": (edges / size).T, "size": size,
            "inverse": np.linalg.inv(edges),
        }  # fmt: skip
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def volume(self) -> float:
        """Volume of a voxel [cm^d]."""
        return float(abs(np.linalg.det(self.axes * self.size[:, None])))

    def to_grid(self, points: Array) -> Array:
        """Grid coordinates (n, d) of points (n, d) [cm]."""
        inverse: Array = self.__dict__["inverse"]
        return np.asarray((points - self.origin) @ inverse.T)


@dataclass(frozen=True)
class Image(ObservationOperator):
    """Averages of a field over the voxels of a NIfTI image's own grid, ℓ(v) = (1/|Ω_i ∩ Ω|) ∫_{Ω_i ∩ Ω} v·e dx.

    Exact for the finite element function and any affine, oblique or sheared: an average does not change under
    an affine map, so cells are clipped in the image's own coordinates.

    Parameters
    ----------
    file : Path
        NIfTI image, whose grid is taken; its values are not.
    field : str
    mask : Path, optional
        NIfTI image on the same grid; voxels where it is zero are not measured.
    components : sequence of int or letter
        Components of the field along the scene's axes; empty: all of them.
    placement : 4 rows of 4 floats, optional
        Rigid map from the image's world [cm] to the scene's coordinates [cm]; by default they are the same.
    coverage : float
        Least fraction of a voxel's volume inside the domain, 0 to 1.

    Raises
    ------
    ShapeError
        If the placement is not rigid, or the coverage out of range.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"cells"})

    file: Path
    field: str = "u"
    mask: Path | None = None
    components: tuple[Axis, ...] = ()
    placement: tuple[tuple[float, ...], ...] | None = None
    coverage: float = 0.6

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", tuple(self.components))
        if not 0 <= self.coverage <= 1:
            raise ShapeError(f"image coverage: got {self.coverage}, expected a fraction from 0 to 1")
        if self.placement is not None:
            rows = tuple(tuple(map(float, row)) for row in self.placement)
            if [len(row) for row in rows] != [4, 4, 4, 4]:
                raise ShapeError(f"image placement: got rows of {[len(row) for row in rows]} numbers, expected 4 of 4")
            matrix = np.array(rows)
            check_affine("image placement", matrix, 3)
            turn = matrix[:3, :3]
            if np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0:
                raise ShapeError("image placement: is not rigid; expected a rotation, six digits, and a shift [cm]")
            object.__setattr__(self, "placement", rows)

    @property
    def to_scene(self) -> Array:
        """Rigid map (4, 4) from the image's world to the scene's coordinates [cm]."""
        return np.eye(4) if self.placement is None else np.array(self.placement)

    def fingerprint(self) -> str:
        """Hash of the content of its files."""
        content = hashlib.sha256()
        for path in (self.file, self.mask):
            if path is not None:
                try:
                    content.update(path.read_bytes())
                except OSError as error:
                    raise ShapeError(f"{path}: cannot be read ({error.strerror}); expected a NIfTI image") from error
        return content.hexdigest()[:16]

    def functionals(self, space: StateSpace) -> Functionals:
        """Return one functional for each component (outer) and each voxel kept (inner).

        Raises
        ------
        ShapeError
            If no voxel is covered enough, or the domain has not three dimensions.
        StoreError
            If a file cannot be read.
        """
        self.check(space)
        geometry = space.cells()
        if geometry.points.shape[1] != 3:
            raise ShapeError("image: this domain has two dimensions, expected three; use voxels with an affine")
        affine, shape, _ = read_grid(self.file)
        what = measured(space, self.field, self.components, (), 3)
        grid = SkewGrid(self.to_scene @ affine)
        layer = Layer.over(geometry, grid, shape, None)
        if layer is None:
            low, high = geometry.points.min(axis=0), geometry.points.max(axis=0)
            at = grid.to_space(np.array([np.zeros(3), shape], dtype=np.float64))
            raise ShapeError(
                f"{self.file.name}: the image, from {_place(at[0])} to {_place(at[1])} cm, lies outside the domain, "
                f"from {_place(low)} to {_place(high)} cm; give a placement"
            )
        part = cover(geometry, self.field, layer, self.coverage, "exact")
        centres, integrals = part.centres, part.integrals
        dropped = len(part.dropped) + part.unseen
        if self.mask is not None:
            inside = read_mask(self.mask, self.file.name, affine, shape)
            kept = inside[tuple(np.floor(grid.to_grid(centres)).astype(np.int64).T)]
            centres, integrals = centres[kept], csr_array(integrals[np.flatnonzero(kept)])
            dropped = int(inside.sum()) - len(centres)
        if not len(centres):
            raise ShapeError(
                f"{self.file.name}: no voxel{' of the mask' if self.mask else ''} is {self.coverage:.0%} inside the "
                "domain; check the placement, or lower the coverage"
            )
        fill = np.asarray(integrals.sum(axis=1)).ravel()
        matrix = place(space, csr_array(diags_array(1.0 / fill) @ integrals), self.field, what)
        labels, where, directions = stack_sites(what, centres)
        return Functionals(
            matrix=matrix, labels=labels, unit=space.layout.field(self.field).unit, centres=where,
            directions=directions, sites=np.tile(np.arange(len(centres)), len(what)), spacing=_spacing(grid),
            dropped=dropped,
        )  # fmt: skip


def _spacing(grid: Grid) -> tuple[float, ...]:
    """Edge lengths along x, y, z [cm]; none for an oblique grid, whose voxels are no boxes of the scene's axes."""
    along = np.abs(grid.axes)
    order = along.argmax(axis=1)
    if np.abs(along[np.arange(3), order] - 1.0).max() > 1e-6:
        return ()
    return tuple(grid.size[np.argsort(order)].tolist())


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"
