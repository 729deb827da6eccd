"""MFEM's elements at many points at once: their shape functions read off as polynomials.

MFEM evaluates one point a call. Its shape functions are polynomials on the reference cell, so their
values at as many points as there are monomials determine them, and the rest is matrix products.
"""

from itertools import product
from typing import Any

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients, local_edges
from dacore_mfem.library import mfem
from dacore_mfem.spaces import Space


class Shapes:
    """Shape functions of an MFEM element of order 1 or 2, as polynomials in the reference coordinates.

    Parameters
    ----------
    space : Space

    Attributes
    ----------
    local : (n_local,) int array
        For each of MFEM's local nodes, its local number in dacore's order.
    """

    def __init__(self, space: Space) -> None:
        self.dim, self.order = dim, order = space.dim, space.order
        element = space.scalar.GetFE(0)  # the same on all cells, and alive as long as the space
        self.local = _local_order(element, dim)
        # Points inside the cell, none of them a node: values there are no zeros and ones by construction.
        lattice = _powers(dim, order)
        points = (lattice + 1.0 / (dim + 1)) / (order + 1)
        values, slopes = np.empty((len(points), len(self.local))), np.empty((len(points), len(self.local), dim))
        shape, gradient = mfem.Vector(len(self.local)), mfem.DenseMatrix(len(self.local), dim)
        where = mfem.IntegrationPoint()
        for k, point in enumerate(points.tolist()):
            where.Set3(*point, *[0.0] * (3 - dim))
            element.CalcShape(where, shape)
            element.CalcDShape(where, gradient)
            values[k], slopes[k] = shape.GetDataArray(), gradient.GetDataArray()
        monomials = _monomials(points, dim, order)
        self._values = np.linalg.solve(monomials, values)
        # One degree less would do; the highest coefficients come out as zeros.
        self._slopes = np.linalg.solve(monomials, slopes.reshape(len(points), -1)).reshape(slopes.shape)

    def values(self, reference: Array) -> Array:
        """Values (p, n_local) at reference points (p, d)."""
        return np.asarray(_monomials(reference, self.dim, self.order) @ self._values)

    def derivative(self, mesh: Mesh, cells: IntArray, reference: Array, axis: int) -> Array:
        """Derivative (p, n_local) along an axis in space, each point (p, d) in its own cell (p,)."""
        # Reference coordinates are the barycentric coordinates of all vertices but the first.
        gradients, _ = barycentric_gradients(mesh.points, mesh.cells[cells])
        monomials = _monomials(reference, self.dim, self.order)
        return np.asarray(
            sum((monomials @ self._slopes[:, :, j]) * gradients[:, j + 1, axis, None] for j in range(self.dim))
        )


def _powers(dim: int, order: int) -> IntArray:
    """Exponents (m, dim) of the monomials up to degree `order`."""
    return np.array([powers for powers in product(range(order + 1), repeat=dim) if sum(powers) <= order])


def _monomials(points: Array, dim: int, order: int) -> Array:
    """Values (p, m) of the monomials at points (p, dim)."""
    columns = [np.prod([points[:, i] ** k for i, k in enumerate(row)], axis=0) for row in _powers(dim, order).tolist()]
    return np.stack(columns, axis=1)


def _local_order(element: Any, dim: int) -> IntArray:
    """For each local node of MFEM, its local number in dacore's order: its barycentric coordinates name it."""
    rule = element.GetNodes()
    points = [rule.IntPoint(k) for k in range(element.GetDof())]
    where = np.array([[point.x, point.y, point.z] for point in points])[:, :dim]
    barycentric = np.column_stack([1.0 - where.sum(axis=1), where])
    names: list[tuple[int, ...]] = [(k,) for k in range(dim + 1)] + [*local_edges(dim)]
    return np.array([names.index(tuple(np.flatnonzero(row > 0.25).tolist())) for row in barycentric], dtype=np.int64)
