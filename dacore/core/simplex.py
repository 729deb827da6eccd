"""Lagrange polynomials on simplices in barycentric coordinates, in dacore's local node order.

The local nodes of order 2 are the vertices followed by the edges ``(0,1), (0,2), …`` in
lexicographic order of the local vertex numbers.
"""

from itertools import combinations
from math import factorial

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError


def local_edges(dim: int) -> list[tuple[int, int]]:
    """Pairs of local vertices of the edges of a `dim`-simplex, in local order.

    Parameters
    ----------
    dim : int

    Returns
    -------
    list of (int, int)
    """
    return list(combinations(range(dim + 1), 2))


def n_local(dim: int, order: int) -> int:
    """Number of local nodes of order 1 or 2 on a `dim`-simplex.

    Parameters
    ----------
    dim : int
    order : {1, 2}

    Returns
    -------
    int
    """
    return dim + 1 if order == 1 else (dim + 1) * (dim + 2) // 2


def lagrange(order: int, barycentric: Array) -> Array:
    """Values of the Lagrange basis.

    Parameters
    ----------
    order : int
        1 or 2.
    barycentric : (..., d + 1) array
        Barycentric coordinates.

    Returns
    -------
    (..., n_local) array
    """
    b = barycentric
    if order == 1:
        return b
    if order != 2:
        raise ShapeError(f"element order: got {order}, expected 1 or 2")
    vertex = b * (2.0 * b - 1.0)
    edge = [4.0 * b[..., i] * b[..., j] for i, j in local_edges(b.shape[-1] - 1)]
    return np.concatenate([vertex, np.stack(edge, axis=-1)], axis=-1)


def lagrange_gradient(order: int, barycentric: Array) -> Array:
    """Derivatives of the Lagrange basis in the barycentric coordinates.

    Parameters
    ----------
    order : {1, 2}
    barycentric : (..., d + 1) array
        Barycentric coordinates.

    Returns
    -------
    (..., n_local, d + 1) array
        Chain it with the gradients of the barycentric coordinates for derivatives in space.
    """
    b = barycentric
    n = b.shape[-1]
    if order == 1:
        return np.broadcast_to(np.eye(n), (*b.shape[:-1], n, n)).copy()
    if order != 2:
        raise ShapeError(f"element order: got {order}, expected 1 or 2")
    out = np.zeros((*b.shape[:-1], n_local(n - 1, 2), n))
    for i in range(n):
        out[..., i, i] = 4.0 * b[..., i] - 1.0
    for k, (i, j) in enumerate(local_edges(n - 1)):
        out[..., n + k, i] = 4.0 * b[..., j]
        out[..., n + k, j] = 4.0 * b[..., i]
    return out


def barycentric_gradients(points: Array, cells: IntArray) -> tuple[Array, Array]:
    """Gradients of the barycentric coordinates and signed volumes of simplices.

    Parameters
    ----------
    points : (n, d) array
    cells : (c, d + 1) int array

    Returns
    -------
    gradients : (c, d + 1, d) array
    volumes : (c,) array
        Negative where a cell is inverted, zero where it is flat (its gradients are then zero).
    """
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    normals = _cofactors(edges)
    determinant = np.einsum("cd,cd->c", edges[:, 0], normals[:, 0])
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=determinant != 0)
    gradients = np.empty((len(cells), cells.shape[1], points.shape[1]))
    np.multiply(normals, inverse[:, None, None], out=gradients[:, 1:])
    np.negative(gradients[:, 1:].sum(axis=1), out=gradients[:, 0])
    return gradients, determinant / factorial(points.shape[1])


def _cofactors(edges: Array) -> Array:
    """Cofactors of matrices (c, d, d), d up to 3; by hand, since LAPACK is several times slower on small ones."""
    e = np.moveaxis(edges, 0, -1)
    out = np.empty_like(e)
    if len(e) == 1:
        out[0, 0] = 1.0
    elif len(e) == 2:
        (out[0, 0], out[0, 1]), (out[1, 0], out[1, 1]) = (e[1, 1], -e[1, 0]), (-e[0, 1], e[0, 0])
    else:
        for i in range(3):
            a, b = e[(i + 1) % 3], e[(i + 2) % 3]
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                out[i, k] = a[m] * b[n] - a[n] * b[m]
    return np.ascontiguousarray(np.moveaxis(out, -1, 0))
