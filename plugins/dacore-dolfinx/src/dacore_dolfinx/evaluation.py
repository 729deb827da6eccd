"""Values and derivatives of the basis functions at points, tabulated by Basix."""

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse
from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients
from dacore.geometry.locate import PointLocator
from dacore_dolfinx import compat
from dacore_dolfinx.numbering import local_order

# Points tabulated at once: bounds the work space at P2 derivatives on tetrahedra to some tens of MB.
_POINTS = 1 << 16


def basis_at(mesh: Mesh, locator: PointLocator, points: Array, order: int, derivative: int | None) -> Sparse:
    """Basis functions, or their partial derivative along an axis, at points.

    Parameters
    ----------
    mesh : Mesh
    locator : PointLocator
        Of the cells of `mesh`. On a facet it chooses the cell with the lowest number.
    points : (p, d) array [cm]
    order : int
    derivative : int, optional

    Returns
    -------
    (p, n) csr_array

    Raises
    ------
    ShapeError
        If a point lies outside the mesh.
    """
    cell, barycentric = locator.locate(points)
    nodes = mesh.cell_nodes(order)[:, local_order(mesh.dim, order)][cell]
    element = compat.element(mesh.dim, order)
    values = np.empty(nodes.shape)
    for start in range(0, len(cell), _POINTS):
        part = slice(start, start + _POINTS)
        # The reference simplex has its first vertex at the origin and the others on the axes.
        reference = np.ascontiguousarray(barycentric[part, 1:])
        table = np.asarray(element.tabulate(0 if derivative is None else 1, reference))[..., 0]
        if derivative is None:
            values[part] = table[0]
        else:
            gradients, _ = barycentric_gradients(mesh.points, mesh.cells[cell[part]])
            values[part] = np.einsum("kpn,pk->pn", table[1:], gradients[:, 1:, derivative])
    start_of_row = np.arange(len(cell) + 1) * nodes.shape[1]
    return csr_array((values.ravel(), nodes.ravel(), start_of_row), shape=(len(cell), len(mesh.nodes(order))))
