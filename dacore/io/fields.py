"""Fields for ParaView: states of a finite element space as VTU snapshots and XDMF time series."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.space import StateSpace
from dacore.errors import StoreError
from dacore.io.atomic import atomic_path


def point_data(space: StateSpace, state: Array, prefix: str = "") -> dict[str, Array]:
    """Split a state (n_dofs,) into vertex values by field, ``prefix + name``.

    Vector fields become (n_vertices, 3) arrays, padded with zeros in two dimensions; elements of
    order 2 are given by their values at the vertices.
    """
    vertices = len(space.cells().points)
    out = {}
    for field in space.fields:
        values = state[space.layout.block(field.name)].reshape(field.components, -1)[:, :vertices].T
        if field.components > 1:
            values = np.pad(values, ((0, 0), (0, 3 - field.components)))
        out[f"{prefix}{field.name}"] = values if field.components > 1 else values[:, 0]
    return out


def write_vtu(space: StateSpace, states: Mapping[str, Array], path: Path) -> None:
    """Write several states (n_dofs,) of one space to a VTU file, named by their prefix."""
    import meshio

    points, cells = _mesh(space)
    data: dict[str, Array] = {}
    for prefix, state in states.items():
        data |= point_data(space, state, prefix)
    with atomic_path(path) as temporary:
        meshio.Mesh(points, cells, point_data=data).write(temporary, file_format="vtu", compression="zlib")


def write_series(space: StateSpace, series: Mapping[str, Array], times: Array, path: Path) -> None:
    """Write trajectories (n_dofs, t) as an XDMF time series with its HDF5 file beside it.

    Parameters
    ----------
    space : StateSpace
    series : mapping of str to (n_dofs, t) array
        By the prefix of their fields' names: "truth_", "estimate_".
    times : (t,) array [s]
    path : Path
        ``.xdmf``; the values go to the file of the same name with ``.h5``.
    """
    import meshio

    points, cells = _mesh(space)
    folder = path.parent
    folder.mkdir(parents=True, exist_ok=True)
    heavy = path.with_suffix(".h5")
    try:
        with meshio.xdmf.TimeSeriesWriter(path) as writer:
            writer.write_points_cells(points, cells)
            for k, moment in enumerate(times):
                data: dict[str, Array] = {}
                for prefix, states in series.items():
                    data |= point_data(space, states[:, k], prefix)
                writer.write_data(float(moment), point_data=data)
    except OSError as error:
        for part in (path, heavy):
            part.unlink(missing_ok=True)
        raise StoreError(f"{path}: cannot be written ({error}); is the disk full or read-only?") from error


def _mesh(space: StateSpace) -> tuple[Array, list[tuple[str, IntArray]]]:
    geometry = space.cells()
    points = np.pad(geometry.points, ((0, 0), (0, 3 - geometry.points.shape[1])))
    return points, [("tetra" if geometry.cells.shape[1] == 4 else "triangle", geometry.cells)]
