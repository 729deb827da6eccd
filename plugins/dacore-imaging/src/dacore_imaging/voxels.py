"""Averages over the voxels of an image."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from dacore.core.arrays import Array
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.space import CellGeometry, StateSpace
from dacore.errors import ShapeError
from dacore_imaging.grid import Axis, Grid, axis_number
from dacore_imaging.layers import Covered, Layer, cover
from dacore_imaging.measured import measured, place, stack_sites, unit_directions


@dataclass(frozen=True)
class Slice:
    """A layer of voxels.

    Parameters
    ----------
    axis : {"x", "y", "z"} or int
        Axis of the grid across the layer.
    position : float [cm]
        Coordinate of the layer's centre along that axis, measured from the zero of the mesh.
    """

    axis: Axis
    position: float

    def __post_init__(self) -> None:
        axis_number("slice axis", self.axis)
        if not np.isfinite(self.position):
            raise ShapeError(f"slice position: got {self.position}, expected a finite number [cm]")


@dataclass(frozen=True)
class Voxels(ObservationOperator):
    """Averages of a field over the voxels of a grid, ℓ(v) = (1/|Ω_i ∩ Ω|) ∫_{Ω_i ∩ Ω} v·e dx.

    Exact for the finite element function: every cell is clipped by the voxels it meets.

    Parameters
    ----------
    field : str
    size : float or d floats, optional [cm]
        Voxel edge lengths. Required unless `affine` is given.
    origin : d floats, optional [cm]
        A corner of the grid, in the mesh's coordinates. By default the mesh's zero, so that voxel
        faces lie at whole multiples of `size`.
    axes : d rows of d floats, optional
        Unit vectors along the grid's axes; by default the mesh's own.
    affine : (d + 1, d + 1) floats, optional
        An image's matrix from voxel numbers to voxel *centres*, in cm; instead of `size`, `origin`
        and `axes`.
    shape : d ints, optional
        Number of voxels along each axis, from `origin` on (an image's field of view). By default
        as many as the domain needs.
    slices : sequence of Slice
        Layers of voxels to measure, each centred at its own position. Empty: the whole volume.
        A voxel in two slices is measured once.
    components : sequence of int or letter
        Components of the field; empty: all of them.
    directions : sequence of d floats
        Unit vectors in the mesh's coordinates, instead of `components`.
    coverage : float
        Least fraction of a voxel's volume inside the domain, 0 to 1.
    average : bool
        Divide by the volume |Ω_i ∩ Ω|; otherwise the plain integral.
    outside : {"drop", "error"}
        What to do with asked voxels that are covered less: leave them out and count them in
        `Functionals.dropped`, or refuse. Asked are all voxels of `shape`, or else those that meet
        the domain.
    quadrature : "exact" or int
        Clip cells, or take the midpoints of this many parts a voxel axis. For comparison: its
        accuracy depends on how the points happen to fall on the mesh.

    Raises
    ------
    ShapeError
        If settings contradict each other or are out of range.

    Notes
    -----
    Galarce et al. 2023 print the integral without its volume (errata); ``average = false`` gives that.
    Values stand component by component, voxel by voxel, so that Gram matrices have equal blocks.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"cells"})

    field: str = "u"
    size: float | tuple[float, ...] | None = None
    origin: tuple[float, ...] | None = None
    axes: tuple[tuple[float, ...], ...] | None = None
    affine: tuple[tuple[float, ...], ...] | None = None
    shape: tuple[int, ...] | None = None
    slices: tuple[Slice, ...] = ()
    components: tuple[Axis, ...] = ()
    directions: tuple[tuple[float, ...], ...] = ()
    coverage: float = 0.6
    average: bool = True
    outside: Literal["drop", "error"] = "drop"
    quadrature: Literal["exact"] | int = "exact"

    def __post_init__(self) -> None:
        # A scene gives lists and tables; settings are compared and hashed, so they are kept as tuples.
        values: dict[str, Any] = {
            "size": _floats(self.size),
            "origin": _floats(self.origin),
            "axes": None if self.axes is None else tuple(map(_floats, self.axes)),
            "affine": None if self.affine is None else tuple(map(_floats, self.affine)),
            "shape": None if self.shape is None else tuple(self.shape),
            "slices": tuple(Slice(**one) if isinstance(one, Mapping) else one for one in self.slices),
            "components": tuple(self.components),
            "directions": unit_directions(self.directions),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        if self.affine is not None and any(one is not None for one in (self.size, self.origin, self.axes)):
            raise ShapeError("voxels: got both affine and size, origin or axes; an affine holds them all, give one")
        if self.affine is None and self.size is None:
            raise ShapeError("voxels: got neither size nor affine; give size, the voxel's edge lengths [cm]")
        if self.components and self.directions:
            raise ShapeError("voxels: got both components and directions; give one")
        if self.shape is not None and not all(isinstance(n, int) and n > 0 for n in self.shape):
            raise ShapeError(f"voxels: got shape {self.shape}, expected positive numbers of voxels")
        if not 0 <= self.coverage <= 1:
            raise ShapeError(f"voxel coverage: got {self.coverage}, expected a fraction from 0 to 1")
        if self.outside not in ("drop", "error"):
            raise ShapeError(f"voxels outside: got {self.outside!r}, expected 'drop' or 'error'")
        number = isinstance(self.quadrature, int) and not isinstance(self.quadrature, bool) and self.quadrature > 0
        if not number and self.quadrature != "exact":
            raise ShapeError(
                f"voxel quadrature: got {self.quadrature!r}, expected 'exact' or a number of points an axis"
            )
        self.grid(self._dim() or 3)

    def grid(self, dim: int) -> Grid:
        """The voxel grid in `dim` dimensions; ShapeError if the settings have another number of them."""
        own = self._dim()
        if own not in (None, dim):
            raise ShapeError(f"voxels: the settings have {own} dimensions, the domain has {dim}")
        for one in self.slices:
            axis_number("slice axis", one.axis, dim)
        if self.affine is not None:
            return Grid.from_affine(self.affine)
        size = np.broadcast_to(np.asarray(self.size, dtype=np.float64), (dim,))
        return Grid(
            np.zeros(dim) if self.origin is None else self.origin,
            np.eye(dim) if self.axes is None else self.axes,
            size,
        )

    def functionals(self, space: StateSpace) -> Functionals:
        """Return one functional for each component (outer) and each voxel kept (inner).

        Raises
        ------
        ShapeError
            If a slice, or everything, holds no voxel that is covered enough, or `outside` is
            "error" and a voxel is covered too little.
        CapabilityError
            If the space has no cells or no such field.
        """
        self.check(space)
        geometry = space.cells()
        dim = geometry.points.shape[1]
        what = measured(space, self.field, self.components, self.directions, dim)
        grid = self.grid(dim)
        wanted: tuple[Slice | None, ...] = self.slices or (None,)
        parts = [self._cover(geometry, grid, one) for one in wanted]
        centres = np.concatenate([part.centres for part in parts])
        integrals = csr_array(vstack([part.integrals for part in parts], format="csr"))
        dropped = np.concatenate([part.dropped for part in parts])
        unseen = sum(part.unseen for part in parts)
        if len(parts) > 1:
            kept = _once(grid, centres)
            centres, integrals = centres[kept], integrals[kept]
            dropped = dropped[_once(grid, dropped)]
        fill = np.asarray(integrals.sum(axis=1)).ravel()
        factor = 1.0 / fill if self.average else np.full(len(fill), grid.volume)
        matrix = place(space, csr_array(diags_array(factor) @ integrals), self.field, what)
        labels, where, directions = stack_sites(what, centres)
        unit = space.layout.field(self.field).unit
        return Functionals(
            matrix=matrix,
            labels=labels,
            unit=unit if self.average else f"{unit} cm^{dim}",
            centres=where,
            directions=directions,
            sites=np.tile(np.arange(len(centres)), len(what)),
            spacing=tuple(grid.size.tolist()),
            dropped=len(dropped) + unseen,
        )

    def _cover(self, geometry: CellGeometry, grid: Grid, one: Slice | None) -> Covered:
        """Voxels of a slice, or of the whole volume, that are covered enough."""
        axis = None if one is None else axis_number("slice axis", one.axis, grid.dim)
        name = "the grid" if one is None or axis is None else f"the slice {'xyz'[axis]} = {one.position:g} cm"
        shape = None if self.shape is None else list(self.shape)
        if one is not None and axis is not None:
            grid = grid.centred(axis, one.position)
        layer = Layer.over(geometry, grid, shape, axis)
        if layer is None:
            along = geometry.points @ grid.axes.T
            spans = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(along.min(axis=0), along.max(axis=0), strict=True))
            raise ShapeError(
                f"voxels: {name} lies outside the domain, which spans {spans} cm along the grid's axes; move it"
            )
        part = cover(geometry, self.field, layer, self.coverage, self.quadrature)
        missing = len(part.dropped) + part.unseen
        if self.outside == "error" and missing:
            first = part.dropped if len(part.dropped) else layer.unseen_centres()
            places = "; ".join(", ".join(f"{value:.4g}" for value in centre) for centre in first[:3])
            raise ShapeError(
                f"voxels: {missing} of {name} are less than {self.coverage:.0%} inside the domain "
                f"(first: {places} cm); move the grid, lower the coverage, or set outside = 'drop'"
            )
        if not len(part.centres):
            raise ShapeError(
                f"voxels: {name} has no voxel that is {self.coverage:.0%} inside the domain; "
                "use smaller voxels, a lower coverage or another place"
            )
        return part

    def _dim(self) -> int | None:
        """Dimension that the settings speak of, None if any; ShapeError if they disagree."""
        lengths = [
            (name, len(value))
            for name in ("size", "origin", "axes", "shape")
            if isinstance(value := getattr(self, name), tuple)
        ]
        lengths += [("direction", len(direction)) for direction in self.directions]
        if self.affine is not None:
            lengths.append(("affine", len(self.affine) - 1))
        if len({n for _, n in lengths}) > 1:
            listed = ", ".join(f"{name}: {n}" for name, n in lengths)
            raise ShapeError(f"voxels: the settings have different dimensions ({listed}); expected one")
        dim = lengths[0][1] if lengths else None
        if dim not in (None, 2, 3):
            raise ShapeError(f"voxels: the settings have {dim} dimensions, expected 2 or 3")
        return dim


def _floats(values: float | Sequence[float] | None) -> Any:
    """A number as a float, numbers as a tuple of floats, None as it is."""
    if values is None:
        return None
    return tuple(map(float, values)) if isinstance(values, Sequence | np.ndarray) else float(values)


def _once(grid: Grid, centres: Array) -> Any:
    """First occurrence (n,) of each voxel centre, in their order."""
    # Slices that cross share voxels; a voxel measured twice would make the Gram matrix singular.
    key = np.rint(grid.to_grid(centres) * 1e6)
    return np.sort(np.unique(key, axis=0, return_index=True)[1])
