"""Functionals that repeat, contradict, miss the body, or sit where the mesh is not smooth."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from dacore.core.arrays import Array
from dacore.core.mesh import Mesh
from dacore.core.observation import Functionals
from dacore.workflow.stress.case import Case, Inapplicable, Outcome
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.inference import check_minimum_variance, check_pbdw, joined, pbdw, pick, spread
from dacore.workflow.stress.reference import EPS


def _repeated(context: Context) -> tuple[Functionals, Array]:
    """A few functionals, the first three of them twice, and their data."""
    functionals = spread(context.functionals, 40)
    rows = np.append(np.arange(functionals.count), [0, 1, 2])
    twice = pick(functionals, rows)
    return twice, twice(context.truth)


def _duplicated_pbdw(context: Context) -> Outcome:
    return check_pbdw(context, pbdw(6), *_repeated(context))


def _duplicated_minimum_variance(context: Context) -> Outcome:
    functionals, data = _repeated(context)
    return check_minimum_variance(context, functionals, data, 0.05 * float(np.abs(data).max()))


def _contradictory(estimator: str) -> Any:
    def run(context: Context) -> Outcome:
        functionals, data = _repeated(context)
        data = data.copy()
        data[-3:] *= -1.0
        if estimator == "pbdw":
            return check_pbdw(context, pbdw(6), functionals, data)
        return check_minimum_variance(context, functionals, data, 0.05 * float(np.abs(data).max()))

    return run


def _parallel(angle: float) -> Any:
    """One more functional, the first turned by a small angle towards one that is not among them."""

    def run(context: Context) -> Outcome:
        every = context.functionals
        functionals = pick(every, np.arange(0, every.count - 1, max(2, every.count // 30)))
        first, other = (csr_array(every.matrix[[k]]) for k in (0, 1))
        nearly = joined(functionals, csr_array(np.cos(angle) * first + np.sin(angle) * other))
        return check_pbdw(context, pbdw(6), nearly, nearly(context.truth))

    return run


def _zero(context: Context) -> Outcome:
    functionals = spread(context.functionals, 20)
    empty = csr_array(0.0 * functionals.matrix[[0]])
    silent = csr_array((np.zeros(3), np.arange(3), [0, 3]), shape=empty.shape)
    return check_pbdw(
        context,
        pbdw(4),
        context.ask(lambda: joined(functionals, silent)),
        np.zeros((21, len(context.background.times), 1)),
    )


def _not_finite(context: Context) -> Outcome:
    functionals = spread(context.functionals, 20)
    matrix = functionals.matrix.copy()
    matrix.data[0] = np.nan
    broken = context.ask(lambda: joined(functionals, matrix[[0]]))
    return check_minimum_variance(context, broken, np.ones((21, len(context.background.times), 1)))


def _barely(context: Context) -> Outcome:
    """Averages of coordinates over the least covered voxel, against Qhull's centroids of the clipped cells."""
    voxels, mesh = context.plugin("observation", "voxels"), context.mesh
    if mesh.dim != 3:
        raise Inapplicable("the reference clips tetrahedra")
    field = context.space.fields[0].name
    edge = 0.11 * float(np.ptp(mesh.points, axis=0).max())
    found = context.ask(
        lambda: voxels(field=field, size=edge, coverage=0.0, components=(0,)).functionals(context.space)
    )
    plain = voxels(field=field, size=edge, coverage=0.0, components=(0,), average=False).functionals(context.space)
    volumes = np.asarray(plain.matrix.sum(axis=1)).ravel()
    row = int(np.argmin(volumes))
    block = context.space.layout.component(field, 0)
    weights = found.matrix[[row]][:, block].toarray()[0]
    nodes = mesh.nodes(context.space.layout.field(field).order)
    volume, centroid = _clipped(mesh, found.centres[row] - edge / 2, found.centres[row] + edge / 2)
    error = float(np.abs(weights @ nodes - centroid).max() / edge)
    # Coordinates are known to round-off of the body's size; the centroid of a sliver divides by its volume.
    fraction = volume / edge**3
    return Outcome(
        error, 1e-9, note=f"covered to {fraction:.1e}, by Qhull {abs(volumes[row] / edge**3 - fraction):.0e} off"
    )


def _clipped(mesh: Mesh, low: Array, high: Array) -> tuple[float, Array]:
    """Volume and centroid of a box's part inside a mesh."""
    corners = mesh.points[mesh.cells]
    near = ((corners.max(axis=1) > low) & (corners.min(axis=1) < high)).all(axis=1)
    walls = np.concatenate([np.column_stack([np.eye(3), -high]), np.column_stack([-np.eye(3), low])])
    volume, moment = 0.0, np.zeros(3)
    for cell in corners[near]:
        inverse = np.linalg.inv(np.column_stack([cell, np.ones(4)]))  # columns: barycentric coordinates
        halves = np.concatenate([walls, -inverse.T / np.linalg.norm(inverse[:3], axis=0)[:, None]])
        inside = _interior(halves)
        if inside is None:
            continue
        try:
            hull = ConvexHull(HalfspaceIntersection(halves, inside).intersections)
        except QhullError:
            continue  # flat: without volume
        middle = hull.points[hull.vertices].mean(axis=0)
        for facet in hull.simplices:
            piece = abs(np.linalg.det(hull.points[facet] - middle)) / 6
            volume += piece
            moment += piece * (hull.points[facet].sum(axis=0) + middle) / 4
    return volume, moment / volume


def _interior(halves: Array) -> Array | None:
    """Centre of the largest ball inside half-spaces, None if there is none."""
    from scipy.optimize import linprog

    norms = np.linalg.norm(halves[:, :3], axis=1)
    best = linprog(
        [0, 0, 0, -1], np.column_stack([halves[:, :3], norms]), -halves[:, 3], bounds=[(None, None)] * 3 + [(0, None)]
    )
    return best.x[:3] if best.status == 0 and best.x[3] > 1e-12 else None


def _outside(context: Context) -> Outcome:
    voxels = context.plugin("observation", "voxels")
    far = 100.0 * float(np.abs(context.mesh.points).max())
    found = context.ask(lambda: voxels(size=1.0, slices=({"axis": 2, "position": far},)).functionals(context.space))
    return Outcome(np.inf, 0.0, note=f"{found.count} voxels where no body is")


def _sensor_outside(context: Context) -> Outcome:
    sensors = context.plugin("observation", "points")
    far = 2.0 * np.abs(context.mesh.points).max(axis=0) + 1.0
    found = context.ask(lambda: sensors(positions=(tuple(far),)).functionals(context.space))
    return Outcome(np.inf, 0.0, note=f"{found.count} sensors where no body is")


def _sensors_on(where: str) -> Any:
    """Sensors at vertices, or on the middles of inner facets: means of the nodal values there."""

    def run(context: Context) -> Outcome:
        sensors, mesh = context.plugin("observation", "points"), context.mesh
        field = context.space.fields[-1]
        if field.order != 1:
            raise Inapplicable("the reference reads values of linear elements at their nodes")
        if where == "vertex":
            chosen = np.arange(0, len(mesh.points), 7)[:, None]
        else:
            chosen = np.sort(mesh.cells[::11, : mesh.dim], axis=1)
        places = mesh.points[chosen].mean(axis=1)
        positions = tuple(map(tuple, np.unique(places, axis=0)))
        found = context.ask(lambda: sensors(positions=positions, field=field.name).functionals(context.space))
        values = context.rng(4).standard_normal(context.space.n_dofs)
        order = {position: k for k, position in enumerate(positions)}
        block = context.space.layout.component(field.name, 0)
        expected = np.empty(len(positions))
        for nodes, place in zip(chosen, places, strict=True):
            expected[order[tuple(place)]] = values[block][nodes].mean()
        gap = float(np.abs(found(values)[: len(positions)] - expected).max())
        size = float(np.abs(mesh.points).max() / np.sqrt(mesh.volumes.min() ** (2 / mesh.dim)))
        return Outcome(gap, 1e3 * EPS * size)

    return run


CASES = (
    Case(
        "duplicated voxels, PBDW", "observations", "three voxels twice", "the Gram matrix is singular", _duplicated_pbdw
    ),
    Case(
        "duplicated voxels, minimum variance",
        "observations",
        "three voxels twice, 5% noise",
        "what is measured twice counts twice",
        _duplicated_minimum_variance,
    ),
    Case(
        "contradictory voxels, PBDW",
        "observations",
        "one voxel, two values",
        "no state fits both",
        _contradictory("pbdw"),
    ),
    Case(
        "contradictory voxels, minimum variance",
        "observations",
        "one voxel, two values, 5% noise",
        "no state fits both",
        _contradictory("minimum variance"),
    ),
    Case(
        "nearly parallel, 1e-4",
        "observations",
        "two functionals 1e-4 rad apart",
        "the Gram matrix loses 8 digits",
        _parallel(1e-4),
    ),
    Case(
        "nearly parallel, 1e-6",
        "observations",
        "two functionals 1e-6 rad apart",
        "the Gram matrix loses 12 digits",
        _parallel(1e-6),
    ),
    Case(
        "nearly parallel, 1e-9",
        "observations",
        "two functionals 1e-9 rad apart",
        "below round-off of the Gram matrix",
        _parallel(1e-9),
    ),
    Case(
        "functional of zeros", "observations", "a row of stored zeros", "nothing is seen, but an entry is there", _zero
    ),
    Case("functional with NaN", "observations", "a row with NaN", "NaN spreads to everything", _not_finite),
    Case(
        "voxel barely covered",
        "observations",
        "the least covered voxel of the body, threshold 0",
        "an average over a sliver",
        _barely,
    ),
    Case("slice outside", "observations", "a slice far from the body", "there is nothing to average", _outside),
    Case("sensor outside", "observations", "a sensor far from the body", "extrapolation", _sensor_outside),
    Case(
        "sensors on vertices",
        "observations",
        "sensors exactly on vertices",
        "many cells claim the point",
        _sensors_on("vertex"),
    ),
    Case(
        "sensors on facets",
        "observations",
        "sensors exactly between cells",
        "no cell, or two, may claim the point",
        _sensors_on("facet"),
    ),
)
