"""Meshes in files: Gmsh (.msh 2.2, 4.0, 4.1), VTU and XDMF, through meshio."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dacore.core.arrays import Array, IntArray
from dacore.core.mesh import Mesh
from dacore.errors import MeshError
from dacore.io.atomic import atomic_path

SUFFIXES = (".msh", ".vtu", ".xdmf")
TAGS = "tag"
"""Name of the cell data that `write_mesh` writes to VTU and XDMF files."""

_SIMPLICES = {2: ("triangle", "line"), 3: ("tetra", "triangle")}


@dataclass(frozen=True, eq=False)
class RawMesh:
    """What a mesh file holds, by kind of cell; nothing is checked yet.

    Parameters
    ----------
    points : (n, 2 or 3) array
    cells : mapping of str to (c, k) int array
        By meshio's name of the kind of cell: "tetra", "triangle", "line", …
    data : mapping of str to mapping of str to (c,) array
        Scalar cell data by name and kind of cell.
    names : mapping of str to tuple of int
        Tag and dimension of Gmsh's physical names.
    """

    points: Array
    cells: dict[str, IntArray]
    data: dict[str, dict[str, NDArray[Any]]]
    names: dict[str, tuple[int, int]]


def read_raw(path: Path) -> RawMesh:
    """Read a mesh file.

    Raises
    ------
    MeshError
        If the file is missing, of an unknown format, or cannot be read.
    """
    import meshio

    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MeshError(f"{path}: got a file of type {suffix or 'none'!r}, expected one of {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path, relative paths start at the scene's folder")
    # The readers themselves: meshio.read prints and ends the process when a file is damaged.
    reader = {".msh": meshio.gmsh.read, ".vtu": meshio.vtu.read, ".xdmf": meshio.xdmf.read}[suffix]
    try:
        found = reader(str(path))
    except (meshio.ReadError, ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError,
            OSError, RuntimeError, SyntaxError, TypeError, ValueError, struct.error) as error:  # fmt: skip
        reason = " ".join(str(error).split()) or type(error).__name__
        advice = "export it again"
        if "gmsh:physical" in reason:
            advice = "give every saved entity a physical group, or save only those that have one (Mesh.SaveAll = 0)"
        raise MeshError(f"{path}: cannot be read as {suffix[1:]} ({reason[:200]}); {advice}") from error
    return _gathered(found)


def _gathered(found: Any) -> RawMesh:
    """Blocks of the same kind of cell joined, and their scalar data with them."""
    kinds = [block.type for block in found.cells]
    cells = {
        kind: np.concatenate([np.asarray(block.data) for block in found.cells if block.type == kind]).astype(np.int64)
        for kind in dict.fromkeys(kinds)
    }
    data: dict[str, dict[str, NDArray[Any]]] = {}
    for name, values in found.cell_data.items():
        flat = [np.asarray(block).reshape(len(block), -1) for block in values]
        if any(block.shape[1] != 1 for block in flat if len(block)):
            continue
        data[name] = {
            kind: np.concatenate([block.ravel() for block, has in zip(flat, kinds, strict=True) if has == kind])
            for kind in cells
        }
    names = {name: (int(value[0]), int(value[1])) for name, value in found.field_data.items() if np.size(value) == 2}
    return RawMesh(np.asarray(found.points, dtype=np.float64), cells, data, names)


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh with its tags; the file appears whole or not at all.

    Points are written in cm, in full precision. A ``.msh`` file (Gmsh 2.2) has the tags and the
    roles' names as physical groups, ``.vtu`` and ``.xdmf`` have the tags as cell data "tag", with a
    tag of their own for the cells.

    Raises
    ------
    MeshError
        If the suffix is none of these.
    StoreError
        If the file cannot be written.
    """
    import meshio

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MeshError(f"{path}: cannot write a {suffix or 'nameless'} file, expected one of {', '.join(SUFFIXES)}")
    cell_kind, facet_kind = _SIMPLICES[mesh.dim]
    inside = int(max(mesh.roles.values())) + 1
    tags = [np.full(len(mesh.cells), inside, dtype=np.int32), mesh.facet_tags.astype(np.int32)]
    content = meshio.Mesh(
        np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim))), [(cell_kind, mesh.cells), (facet_kind, mesh.facets)]
    )
    options: dict[str, Any] = {}
    if suffix == ".msh":
        content.cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        content.field_data = {role: np.array([tag, mesh.dim - 1]) for role, tag in mesh.roles.items()}
        content.field_data["domain"] = np.array([inside, mesh.dim])
        options = {"file_format": "gmsh22"}
    else:
        content.cell_data = {TAGS: tags}
        # One file: the values of an HDF5 file beside it could not appear in the same step.
        options = {"file_format": "xdmf", "data_format": "XML"} if suffix == ".xdmf" else {"file_format": "vtu"}
    with atomic_path(path) as temporary:
        meshio.write(temporary, content, **options)
