"""A mesh from a file."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.domain import Domain
from dacore.core.mesh import Mesh, check_distinct, exterior_facets
from dacore.core.simplex import barycentric_gradients
from dacore.domains.tags import Tag, facet_tags, role_tags
from dacore.errors import MeshError
from dacore.io.mesh import RawMesh, read_raw

_CM = {"m": 100.0, "cm": 1.0, "mm": 0.1}


@dataclass(frozen=True)
class MeshFile(Domain):
    """A mesh of triangles or tetrahedra with tagged boundary facets, read by meshio.

    Parameters
    ----------
    path : Path
        A .msh (Gmsh 2.2 or 4.1), .vtu or .xdmf file. Triangles of a flat file (z the same
        everywhere) with lines as facets make a plane domain, tetrahedra with triangles a solid one.
    unit : {"m", "cm", "mm"}
        Unit of the file's coordinates; no file format records it.
    roles : mapping of str to int, str, or a tuple of these
        The tags, or Gmsh's physical names, of each role's facets. Empty: the file's own physical
        names of its facets are the roles. Every boundary facet has a role; facets with other tags
        are left out.
    tag_data : str
        Name of the cell data with the tags. Empty: "gmsh:physical" if there, else the only
        whole-numbered cell data.
    expected_extent : tuple of float [cm]
        Between which lengths the largest side of the bounding box lies; catches a wrong `unit`.
    drop_orphans : bool
        Leave out points that belong to no cell. Gmsh writes such points as a matter of course
        (centres of arcs, points of construction), so this is the default.
    reorient : bool
        Turn inverted cells instead of refusing them.

    Raises
    ------
    MeshError
        If a setting is out of range or the file is missing.
    """

    path: Path
    unit: Literal["m", "cm", "mm"]
    roles: Mapping[str, Tag | tuple[Tag, ...]] = field(default_factory=dict)
    tag_data: str = ""
    expected_extent: tuple[float, float] = (1.0, 100.0)
    drop_orphans: bool = True
    reorient: bool = False

    def __post_init__(self) -> None:
        if self.unit not in _CM:
            raise MeshError(f"mesh file unit: got {self.unit!r}, expected one of {', '.join(_CM)}")
        if len(self.expected_extent) != 2 or not 0.0 < self.expected_extent[0] < self.expected_extent[1]:
            raise MeshError(f"mesh file expected_extent: got {self.expected_extent}, expected 0 < low < high in cm")
        if not Path(self.path).is_file():
            raise MeshError(f"{self.path}: no such file; check the path, relative paths start at the scene's folder")

    def mesh(self) -> Mesh:
        """Read the file and make the mesh [cm]; MeshError if it cannot serve."""
        try:
            return self._read()
        except MeshError as error:
            if str(self.path) in str(error):
                raise
            raise MeshError(f"{self.path}: {error}") from error

    def _read(self) -> Mesh:
        raw = read_raw(Path(self.path))
        dim = self._dimension(raw)
        cell_kind, facet_kind = {2: ("triangle", "line"), 3: ("tetra", "triangle")}[dim]
        points = np.array(raw.points[:, :dim]) * _CM[self.unit]
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points)).sum())
            raise MeshError(f"{self.path}: {bad} coordinates are NaN or infinite, expected numbers; export it again")
        cells = raw.cells[cell_kind]
        if cells.size and (cells.min() < 0 or cells.max() >= len(points)):
            raise MeshError(f"{self.path}: cells name points that are not in the file; export it again")
        check_distinct(cells)
        self._check_extent(points[np.unique(cells)])
        cells = self._oriented(points, cells)
        if facet_kind not in raw.cells or not len(raw.cells[facet_kind]):
            raise MeshError(f"{self.path}: has no {facet_kind}s; save the boundary's {facet_kind}s with their tags")
        facets = raw.cells[facet_kind]
        tags = facet_tags(str(self.path), raw, facet_kind, self.tag_data)
        wanted = role_tags(str(self.path), raw.names, self.roles, dim, tags)
        self._check_boundary(cells, facets, tags, wanted)
        number = {role: k for k, role in enumerate(wanted, start=1)}
        numbered = np.zeros(len(tags), dtype=np.int64)
        for role, values in wanted.items():
            numbered[np.isin(tags, values)] = number[role]
        named = numbered > 0
        points, cells, facets = self._used(points, cells, facets[named])
        return Mesh(points, cells, facets, numbered[named], number)

    def fingerprint(self) -> str:
        """SHA-256 of the file, and of the HDF5 or binary files that an XDMF file names."""
        path = Path(self.path)
        digest = hashlib.sha256(path.read_bytes())
        if path.suffix.lower() == ".xdmf":
            heavy = re.findall(rb"([^\s<>:/\\]+\.(?:h5|hdf5|hdf|bin))\b", path.read_bytes())
            for name in sorted(set(heavy)):
                beside = path.with_name(name.decode(errors="replace"))
                if beside.is_file():
                    digest.update(beside.read_bytes())
        return digest.hexdigest()

    def _dimension(self, raw: RawMesh) -> int:
        """Return 2 or 3, or say why the cells cannot serve."""
        known = {"vertex", "line", "triangle", "tetra"}
        other = sorted(kind for kind, cells in raw.cells.items() if kind not in known and len(cells))
        if other:
            curved = [kind for kind in other if kind.startswith(("line", "triangle", "tetra"))]
            if curved:
                raise MeshError(f"{self.path}: has cells of higher order ({curved[0]}); export first-order cells")
            raise MeshError(
                f"{self.path}: has {', '.join(other)} cells, expected triangles or tetrahedra only; "
                "cut them into simplices or remesh"
            )
        if len(raw.cells.get("tetra", ())):
            if raw.points.shape[1] != 3:
                raise MeshError(f"{self.path}: tetrahedra need points in 3-D, got {raw.points.shape[1]} coordinates")
            return 3
        if not len(raw.cells.get("triangle", ())):
            raise MeshError(
                f"{self.path}: has no triangles or tetrahedra; save the domain's cells, not only its boundary"
            )
        if raw.points.shape[1] == 3:
            heights = np.ptp(raw.points[np.unique(raw.cells["triangle"])], axis=0)
            if heights[2] > 1e-9 * heights.max():
                flat = [axis for axis, height in zip("xy", heights, strict=False) if height <= 1e-9 * heights.max()]
                advice = (
                    f"they lie in a plane {flat[0]} = const, turn it so that z is constant"
                    if flat
                    else "it is a surface, fill it with tetrahedra"
                )
                raise MeshError(
                    f"{self.path}: has triangles that do not lie in a plane z = const and no tetrahedra; {advice}"
                )
        return 2

    def _check_extent(self, points: Array) -> None:
        extent = float(np.ptp(points, axis=0).max())
        low, high = self.expected_extent
        if low <= extent <= high:
            return
        fitting = [unit for unit, cm in _CM.items() if low <= extent / _CM[self.unit] * cm <= high]
        hint = f"is the unit {fitting[0]}, not {self.unit}?" if fitting else "check unit, or set expected_extent"
        raise MeshError(f"{self.path}: extent {extent:.5g} cm, expected {low:g} to {high:g} cm; {hint}")

    def _oriented(self, points: Array, cells: IntArray) -> IntArray:
        volumes = barycentric_gradients(points, cells)[1]
        inverted = volumes < 0.0
        if not inverted.any():
            return cells
        if not self.reorient:
            raise MeshError(
                f"{self.path}: {int(inverted.sum())} of {len(cells)} cells are inverted "
                f"(first: {np.flatnonzero(inverted)[0]}); set reorient = true to turn them"
            )
        cells = cells.copy()
        cells[inverted, -2], cells[inverted, -1] = cells[inverted, -1], cells[inverted, -2]
        return cells

    def _check_boundary(
        self, cells: IntArray, facets: IntArray, tags: IntArray, wanted: Mapping[str, tuple[int, ...]]
    ) -> None:
        """Say which tags are missing from the roles, or how many boundary facets have none."""
        boundary = exterior_facets(cells)
        rows = np.sort(np.concatenate([boundary, facets]), axis=1)
        code = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
        boundary_code, facet_code = code[: len(boundary)], code[len(boundary) :]
        on_boundary = np.isin(facet_code, boundary_code)
        every = {value for values in wanted.values() for value in values}
        unnamed = sorted(set(np.unique(tags[on_boundary]).tolist()) - every)
        if unnamed:
            raise MeshError(
                f"{self.path}: boundary facets with tag {', '.join(map(str, unnamed))} have no role; "
                "add the tag to a role"
            )
        bare = int((~np.isin(boundary_code, facet_code)).sum())
        if bare:
            raise MeshError(
                f"{self.path}: {bare} of {len(boundary)} boundary facets are not tagged; tag the whole boundary"
            )

    def _used(self, points: Array, cells: IntArray, facets: IntArray) -> tuple[Array, IntArray, IntArray]:
        """Points that belong to a cell, and the cells and facets renumbered."""
        used = np.zeros(len(points), dtype=bool)
        used[cells] = True
        if used.all():
            return points, cells, facets
        if not self.drop_orphans:
            raise MeshError(
                f"{self.path}: {int((~used).sum())} points belong to no cell; set drop_orphans = true to leave them out"
            )
        if not used[facets].all():
            raise MeshError(f"{self.path}: tagged facets use points that belong to no cell; remove those facets")
        number = np.cumsum(used) - 1
        return points[used], number[cells], number[facets]
