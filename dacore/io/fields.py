"""Fields for ParaView: states of a finite element space as VTU snapshots and XDMF time series."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.space import StateSpace
from dacore.errors import StoreError
from dacore.io.atomic import atomic_path, atomic_write

SHAPES = {3: ("triangle", "Triangle"), 4: ("tetra", "Tetrahedron")}


def point_data(space: StateSpace, states: Array, prefix: str = "") -> dict[str, Array]:
    """Split states (n_dofs, ...) into vertex values by field, ``prefix + name``.

    Vector fields become (n_vertices, 3, ...) arrays, padded with zeros in two dimensions; elements
    of order 2 are given by their values at the vertices.
    """
    vertices = len(space.cells().points)
    out = {}
    for field in space.fields:
        block = states[space.layout.block(field.name)]
        values = block.reshape(field.components, -1, *states.shape[1:])[:, :vertices]
        if field.components == 1:
            out[f"{prefix}{field.name}"] = values[0]
        else:
            padded = np.zeros((vertices, 3, *states.shape[1:]))
            padded[:, : field.components] = values.swapaxes(0, 1)
            out[f"{prefix}{field.name}"] = padded
    return out


def write_vtu(space: StateSpace, states: Mapping[str, Array], path: Path) -> None:
    """Write several states (n_dofs,) of one space to a VTU file, named by their prefix."""
    import meshio

    points, cells = _mesh(space)
    data: dict[str, Array] = {}
    for prefix, state in states.items():
        data |= point_data(space, state, prefix)
    with atomic_path(path) as temporary:
        mesh = meshio.Mesh(points, [(SHAPES[cells.shape[1]][0], cells)], point_data=data)
        mesh.write(temporary, file_format="vtu", compression="zlib")


def write_series(space: StateSpace, series: Mapping[str, Array], times: Array, path: Path) -> None:
    """Write trajectories (n_dofs, t) as an XDMF time series with its HDF5 file beside it.

    Both files appear whole, the HDF5 file first, so a reader never finds a description of missing values.

    Parameters
    ----------
    space : StateSpace
    series : mapping of str to (n_dofs, t) array
        By the prefix of their fields' names: "truth_", "estimate_".
    times : (t,) array [s]
    path : Path
        ``.xdmf``; the values go to the file of the same name with ``.h5``.
    """
    points, cells = _mesh(space)
    data: dict[str, Array] = {}
    for prefix, states in series.items():
        data |= point_data(space, states, prefix)
    heavy = path.with_suffix(".h5")
    try:
        with atomic_path(heavy) as temporary, h5py.File(temporary, "w") as file:
            file["points"], file["cells"] = points, cells
            for name, values in data.items():
                group = file.create_group(name)
                for k in range(len(times)):
                    group.create_dataset(
                        str(k), data=values[..., k].astype(np.float32), compression="gzip", shuffle=True
                    )
    except OSError as error:
        raise StoreError(f"{heavy}: cannot be written ({error}); is the disk full or read-only?") from error
    text = _description(points, cells, data, times, heavy.name)
    with atomic_write(path) as stream:
        stream.write('<?xml version="1.0"?>\n' + text + "\n")


def _description(points: Array, cells: IntArray, data: Mapping[str, Array], times: Array, heavy: str) -> str:
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    series = ElementTree.SubElement(domain, "Grid", Name="trajectory", GridType="Collection", CollectionType="Temporal")
    for k, moment in enumerate(times):
        grid = ElementTree.SubElement(series, "Grid", Name=f"step {k + 1}", GridType="Uniform")
        ElementTree.SubElement(grid, "Time", Value=repr(float(moment)))
        kind = SHAPES[cells.shape[1]][1]
        topology = ElementTree.SubElement(grid, "Topology", TopologyType=kind, NumberOfElements=str(len(cells)))
        _item(topology, cells.shape, "Int", 8, f"{heavy}:/cells")
        geometry = ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ")
        _item(geometry, points.shape, "Float", 8, f"{heavy}:/points")
        for name, values in data.items():
            shape = values.shape[:-1]
            attribute = ElementTree.SubElement(
                grid, "Attribute", Name=name, AttributeType="Scalar" if len(shape) == 1 else "Vector", Center="Node"
            )
            _item(attribute, shape, "Float", 4, f"{heavy}:/{name}/{k}")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _item(parent: ElementTree.Element, shape: tuple[int, ...], kind: str, precision: int, place: str) -> None:
    item = ElementTree.SubElement(
        parent, "DataItem", Dimensions=" ".join(map(str, shape)), NumberType=kind, Precision=str(precision),
        Format="HDF",
    )  # fmt: skip
    item.text = place


def _mesh(space: StateSpace) -> tuple[Array, IntArray]:
    geometry = space.cells()
    return np.pad(geometry.points, ((0, 0), (0, 3 - geometry.points.shape[1]))), geometry.cells
