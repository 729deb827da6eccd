"""Cuts of a mesh by an axis-aligned plane, with the weights that bring a field onto the cut."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.display import Displayed
from dacore.core.simplex import barycentric_gradients, lagrange
from dacore.errors import ShapeError

# Nodes closer to the plane than this fraction of the mesh's extent lie on it: the cut has no slivers there.
_SNAP = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class PlaneCut(Displayed):
    """A triangulated slice of a mesh. Every triangle lies in one cell, so P1 fields are linear on it.

    Parameters
    ----------
    axis : int
        Axis normal to the plane (2 for a planar domain).
    value : float [cm]
        Coordinate of the plane.
    points : (q, 2) array [cm]
        In-plane coordinates: the axes other than `axis`, in order.
    triangles : (t, 3) int array
        Counter-clockwise; conforming where the mesh is.
    triangle_cells : (t,) int array
        The cell each triangle lies in.
    point_cells : (q,) int array
        A cell that holds each point.
    barycentric : (q, d + 1) array
        Barycentric coordinates of each point in that cell.
    """

    axis: int
    value: float
    points: Array
    triangles: IntArray
    triangle_cells: IntArray
    point_cells: IntArray
    barycentric: Array

    @property
    def axes(self) -> tuple[int, int]:
        """The horizontal and the vertical axis of the slice."""
        first, second = (a for a in range(3) if a != self.axis)
        return first, second

    @cached_property
    def areas(self) -> Array:
        """Areas (t,) [cm²] of the triangles."""
        return _signed_areas(self.points, self.triangles)

    @property
    def area(self) -> float:
        """Area [cm²] of the slice."""
        return float(self.areas.sum())

    @cached_property
    def outline(self) -> IntArray:
        """Edges (e, 2) of the slice's boundary, holes included: those of one triangle only."""
        edges = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        return np.asarray(edges[first[counts == 1]])

    def interpolation(self, nodes: IntArray, order: int, n_nodes: int) -> Sparse:
        """Matrix (q, n_nodes) from the nodal values of a scalar field to its values at the points.

        Parameters
        ----------
        nodes : (c, n_local) int array
            Node numbers of every cell of the mesh (`CellGeometry.nodes` of the field).
        order : int
            Order of the field, 1 or 2.
        n_nodes : int
            Number of nodes of the field.
        """
        weights = lagrange(order, self.barycentric)
        columns = nodes[self.point_cells]
        if columns.shape != weights.shape:
            raise ShapeError(f"nodes of a cell: got {columns.shape[1]}, expected {weights.shape[1]} for order {order}")
        rows = np.repeat(np.arange(len(columns)), columns.shape[1])
        matrix = csr_array((weights.ravel(), (rows, columns.ravel())), shape=(len(columns), n_nodes))
        matrix.eliminate_zeros()
        return matrix

    def refined(self, points: Array, cells: IntArray) -> "PlaneCut":
        """Split every triangle in four: drawn linearly, fields of order 2 come four times closer.

        Parameters
        ----------
        points, cells : arrays
            Of the mesh that was cut.
        """
        edges = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        _, first, inverse = np.unique(edges, axis=0, return_index=True, return_inverse=True)
        owner = np.repeat(self.triangle_cells, 3)[first]
        middles = self.points[edges[first]].mean(axis=1)
        a, b, c = self.triangles.T
        ab, bc, ca = inverse.reshape(-1, 3).T + len(self.points)
        children = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]).transpose(2, 0, 1).reshape(-1, 3)
        where = middles if points.shape[1] == 2 else np.insert(middles, self.axis, self.value, axis=1)
        gradients, _ = barycentric_gradients(points, cells[owner])
        weights = np.einsum("qkd,qd->qk", gradients, where - points[cells[owner, 0]])
        weights[:, 0] += 1.0
        return PlaneCut(
            self.axis,
            self.value,
            np.concatenate([self.points, middles]),
            children,
            np.repeat(self.triangle_cells, 4),
            np.concatenate([self.point_cells, owner]),
            np.concatenate([self.barycentric, weights]),
        )


def cut_plane(points: Array, cells: IntArray, axis: int, value: float) -> PlaneCut:
    """Cut tetrahedra by the plane where coordinate `axis` is `value` (marching tetrahedra).

    A face that lies in the plane between two cells is counted once. Where the plane is the lower end of
    the mesh, the cut is the boundary there.

    Parameters
    ----------
    points : (n, 3) array [cm]
    cells : (c, 4) int array
    axis : {0, 1, 2}
    value : float [cm]

    Raises
    ------
    ShapeError
        If the mesh is not of tetrahedra, or the plane misses it.
    """
    if points.shape[1] != 3 or cells.shape[1] != 4 or axis not in (0, 1, 2):
        raise ShapeError(
            f"plane cut: got points {points.shape}, cells {cells.shape} and axis {axis}, expected tetrahedra "
            "and axis 0, 1 or 2; for a planar mesh use planar_domain"
        )
    height = points[:, axis] - value
    extent = float(np.ptp(points, axis=0).max())
    height[np.abs(height) <= _SNAP * extent] = 0.0
    if height.min() == 0.0:
        height = -height
    above = height[cells] >= 0.0
    crossed = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    if len(crossed) == 0:
        raise ShapeError(
            f"plane {'xyz'[axis]} = {value:g}: misses the domain, which runs from "
            f"{points[:, axis].min():g} to {points[:, axis].max():g}; choose a value between"
        )
    ends, owners = _corners(cells[crossed], above[crossed], crossed)
    ends = _snap(ends, height)
    # A cell that the plane only touches gives a triangle with two corners in one place.
    proper = (ends[:, [0, 1, 2]] != ends[:, [1, 2, 0]]).any(axis=2).all(axis=1)
    if not proper.any():
        raise ShapeError(f"plane {'xyz'[axis]} = {value:g}: only touches the domain; choose a value inside")
    ends, owners = ends[proper], owners[proper]
    return _assemble(points, cells, axis, float(value), height, ends, owners)


def planar_domain(points: Array, cells: IntArray) -> PlaneCut:
    """Show a planar mesh (points (n, 2), triangles (c, 3)) as its own slice; points are those of the mesh in use."""
    if points.shape[1] != 2 or cells.shape[1] != 3:
        raise ShapeError(f"planar domain: got points {points.shape} and cells {cells.shape}, expected triangles")
    used, first, inverse = np.unique(cells, return_index=True, return_inverse=True)
    owner, local = np.divmod(first, 3)
    return PlaneCut(
        2, 0.0, points[used], inverse.reshape(cells.shape), np.arange(len(cells)), owner, np.eye(3)[local]
    )  # fmt: skip


def _corners(cells: IntArray, above: BoolArray, names: IntArray) -> tuple[IntArray, IntArray]:
    """Corners of the cut's triangles as mesh edges (t, 3, 2), and the cell of each triangle (t,)."""
    ordered = np.take_along_axis(cells, np.argsort(~above, axis=1, kind="stable"), axis=1)
    count = above.sum(axis=1)
    # Which two vertices (those above come first) make each corner, by how many vertices are above.
    patterns: dict[int, list[list[tuple[int, int]]]] = {
        1: [[(0, 1), (0, 2), (0, 3)]],
        2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
        3: [[(0, 3), (1, 3), (2, 3)]],
    }
    ends, owners = [], []
    for number, triangles in patterns.items():
        group = count == number
        for triangle in triangles:
            ends.append(ordered[group][:, np.array(triangle)])
            owners.append(names[group])
    return np.concatenate(ends), np.concatenate(owners)


def _snap(ends: IntArray, height: Array) -> IntArray:
    """Sort the two ends of each corner, and let a corner on a node of the plane be that node twice."""
    ordered = np.sort(ends, axis=2)
    on_plane = height[ordered] == 0.0
    node = np.where(on_plane[..., 0], ordered[..., 0], ordered[..., 1])
    return np.where(on_plane.any(axis=2)[..., None], node[..., None], ordered)


def _assemble(
    points: Array, cells: IntArray, axis: int, value: float, height: Array, ends: IntArray, owners: IntArray
) -> PlaneCut:
    pairs, first, inverse = np.unique(ends.reshape(-1, 2), axis=0, return_index=True, return_inverse=True)
    triangles = inverse.reshape(-1, 3)
    low, high = pairs.T
    gap = height[low] - height[high]
    share = np.where(low == high, 0.0, height[low] / np.where(low == high, 1.0, gap))[:, None]
    plane_axes = [a for a in range(3) if a != axis]
    flat = ((1.0 - share) * points[low] + share * points[high])[:, plane_axes]

    cell = np.repeat(owners, 3)[first]
    barycentric = (1.0 - share) * (cells[cell] == low[:, None]) + share * (cells[cell] == high[:, None])

    clockwise = _signed_areas(flat, triangles) < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return PlaneCut(axis, value, flat, triangles, owners, cell, barycentric)


def _signed_areas(points: Array, triangles: IntArray) -> Array:
    (ax, ay), (bx, by) = (points[triangles[:, k]].T - points[triangles[:, 0]].T for k in (1, 2))
    return np.asarray(0.5 * (ax * by - ay * bx))
