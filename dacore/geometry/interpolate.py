"""Values and derivatives of finite element functions at points, as a matrix."""

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse, as_array
from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient
from dacore.errors import ShapeError
from dacore.geometry.locate import PointLocator


def interpolation_matrix(
    mesh: Mesh, locator: PointLocator, points: Array, order: int, derivative: int | None = None
) -> Sparse:
    """Value or one partial derivative at points of the continuous Lagrange functions of a mesh.

    Parameters
    ----------
    mesh : Mesh
    locator : PointLocator
        Of the cells of `mesh`.
    points : (p, d) array [cm]
    order : int
        1 or 2.
    derivative : int, optional
        Axis of the derivative. On a facet between cells, where a derivative jumps, it is that of
        the cell with the lowest number.

    Returns
    -------
    (p, n_nodes) csr_array
        Columns in the order of ``mesh.nodes(order)``.

    Raises
    ------
    ShapeError
        If a point lies outside the mesh or there is no such axis.
    """
    if derivative is not None and not 0 <= derivative < mesh.dim:
        raise ShapeError(f"axis of the derivative: got {derivative}, expected 0 to {mesh.dim - 1}")
    where = as_array("evaluation points", points, (None, mesh.dim))
    cell, barycentric = locator.locate(where)
    nodes = mesh.cell_nodes(order)[cell]
    if derivative is None:
        values = lagrange(order, barycentric)
    else:
        gradients, _ = barycentric_gradients(mesh.points, mesh.cells[cell])
        values = np.einsum("pni,pi->pn", lagrange_gradient(order, barycentric), gradients[:, :, derivative])
    start = np.arange(len(where) + 1) * nodes.shape[1]
    matrix = csr_array((values.ravel(), nodes.ravel(), start), shape=(len(where), len(mesh.nodes(order))))
    matrix.sort_indices()
    return matrix
