"""What errors of trajectories are measured against: the finest that a benchmark computes, and where it is looked at."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dacore.core.mesh import Mesh
from dacore.errors import SceneError, ShapeError
from dacore.geometry.locate import PointLocator
from dacore.workflow.bench.sweeps import damped_time
from dacore.workflow.comparison.variants import Axis, Variant, combinations

PROBES = 400
# The reference divides the finest steps further, damps what they do not resolve, and solves to rounding.
SUBSTEPS = 32
GRADED = 8
TOLERANCE = 1e-12


def references(
    table: Mapping[str, Any], sizes: Axis | None, changes: Sequence[Axis] = ()
) -> tuple[Variant, Variant | None, dict[str, Any]]:
    """The reference, the same with half as many steps, and how the reference differs from the scene.

    Parameters
    ----------
    table : mapping
        The scene.
    sizes : Axis, optional
        The finest mesh is the last.
    changes : sequence of Axis
        Keys of one value each that the reference has in place of its own.

    Returns
    -------
    finest : Variant
    coarser : Variant or None
        None if the reference's steps cannot be halved.
    differs : dict
        Settings by key.

    Raises
    ------
    SceneError
        If a change has several values.
    """
    keys: dict[str, Any] = {
        "time": damped_time(dict(table.get("time", {})), SUBSTEPS, GRADED),
        "solver.tolerance": TOLERANCE,
    }
    if sizes is not None:
        keys[sizes.key] = sizes.values[-1]
    for axis in changes:
        if len(axis.values) != 1:
            raise SceneError(f"--reference {axis.key}: got {len(axis.values)} values, expected one")
        # Last, so that a key of [time] changes the reference's own table.
        keys.pop(axis.key, None)
        keys[axis.key] = axis.values[0]
    made = _changed(table, keys)
    own = table.get("time", {})
    differs = {f"time.{key}": value for key, value in made["time"].items() if own.get(key) != value}
    differs |= {key: value for key, value in keys.items() if key.partition(".")[0] != "time"}
    substeps = made["time"].get("substeps", 1)
    halved = _changed(made, {"time.substeps": substeps // 2}) if substeps > 1 else None
    coarser = None if halved is None else Variant(f"reference, {substeps // 2} substeps", halved)
    return Variant(f"reference, {substeps} substeps", made), coarser, differs


def _changed(table: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    (made,) = combinations(table, [Axis(key, (value,)) for key, value in keys.items()])
    return dict(made.table)


def probes(meshes: Sequence[Mesh]) -> list[list[float]]:
    """Points (k, d) [cm] inside every mesh, spread over the coarsest one's cells.

    Raises
    ------
    ShapeError
        If no point is in all of them.
    """
    coarse = min(meshes, key=lambda mesh: len(mesh.points))
    centres = coarse.points[coarse.cells].mean(axis=1)
    rng = np.random.default_rng(0)
    chosen = centres[rng.permutation(len(centres))[: 2 * PROBES]]
    inside = np.ones(len(chosen), dtype=bool)
    for mesh in meshes:
        inside &= PointLocator(mesh.points, mesh.cells).locate(chosen, "mark")[0] >= 0
    found: list[list[float]] = chosen[inside][:PROBES].tolist()
    if not found:
        raise ShapeError("bench: no point lies inside all meshes; the sizes must be of one domain")
    return found
