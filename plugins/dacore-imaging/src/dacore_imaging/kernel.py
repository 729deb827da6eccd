"""Averages weighted by a Gaussian around points."""

from collections.abc import Iterator
from functools import cache
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.special import roots_jacobi

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient
from dacore.core.space import CellGeometry
from dacore.geometry.clip_split import volume_fractions

#: The kernel ends at this many standard deviations, where it has fallen to 4e-6. An end at 3 or 4
#: leaves a jump of up to 1e-2 that no quadrature integrates well.
TRUNCATION = 5.0

# Diameter of a piece in standard deviations, and points an axis that integrate the kernel on it to about 1e-7.
_RULES = ((0.15, 2), (0.6, 3), (1.2, 4))
_POINTS = 1 << 16


def kernel_means(
    geometry: CellGeometry, field: str, centres: Array, width: float, derivative: int | None = None
) -> Sparse:
    """Means of a scalar field, or of its derivative, weighted by a Gaussian normalised over the domain.

    Parameters
    ----------
    geometry : CellGeometry
    field : str
    centres : (p, d) array [cm]
        Points in the domain.
    width : float [cm]
        Standard deviation.
    derivative : int, optional
        Axis of the derivative.

    Returns
    -------
    (p, n_nodes) csr_array
        Rows of values sum to one: constants are reproduced exactly.
    """
    nodes, order = geometry.nodes[field], geometry.orders[field]
    corners = geometry.points[geometry.cells]
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    radius = TRUNCATION * width
    rows, columns, values = [], [], []
    for row, centre in enumerate(centres):
        near = np.flatnonzero(np.linalg.norm(middles - centre, axis=1) < radius + radii)
        gradients, volumes = barycentric_gradients(geometry.points, geometry.cells[near])
        local = np.zeros((len(near), nodes.shape[1]))
        mass = 0.0
        for cell, barycentric, weight in _quadrature((corners[near] - centre) / width):
            mean = weight * np.abs(volumes[cell])[:, None]
            mass += float(mean.sum())
            if derivative is None:
                basis = lagrange(order, barycentric)
            else:
                slope = gradients[cell, :, derivative]
                basis = np.einsum("kqni,ki->kqn", lagrange_gradient(order, barycentric), slope)
            parts = (mean[:, None] @ basis)[:, 0]
            for k in range(parts.shape[1]):
                local[:, k] += np.bincount(cell, parts[:, k], minlength=len(near))
        used = local.any(axis=1)
        values.append((local[used] / mass).ravel())
        columns.append(nodes[near[used]].ravel())
        rows.append(np.full(values[-1].size, row))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csr_array(coo_array(entries, shape=(len(centres), int(nodes.max()) + 1)))


def _pieces(corners: Array) -> tuple[IntArray, Array, Array]:
    """Bisect simplices at their longest edges until each is small against the kernel.

    Parameters
    ----------
    corners : (c, d + 1, d) array
        In standard deviations, the kernel's centre at zero.

    Returns
    -------
    owner : (k,) int array
        The simplex each piece lies in.
    pieces : (k, d + 1, d + 1) array
        Barycentric coordinates of its vertices. Pieces beyond the kernel's end are left out.
    diameter : (k,) array
    """
    size = corners.shape[1]
    edges = np.array(list(combinations(range(size), 2)))
    owner = np.arange(len(corners))
    pieces = np.broadcast_to(np.eye(size), (len(corners), size, size))
    owners, done, diameters = [], [], []
    while len(owner):
        vertices = pieces @ corners[owner]
        middles = vertices.mean(axis=1)
        radii = np.linalg.norm(vertices - middles[:, None], axis=2).max(axis=1)
        near = np.linalg.norm(middles, axis=1) < TRUNCATION + radii
        owner, pieces, vertices = owner[near], pieces[near], vertices[near]
        lengths = np.linalg.norm(vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]], axis=2)
        diameter = lengths.max(axis=1)
        small = diameter <= _RULES[-1][0]
        owners.append(owner[small])
        done.append(pieces[small])
        diameters.append(diameter[small])
        owner, pieces, longest = owner[~small], pieces[~small], edges[lengths[~small].argmax(axis=1)]
        here = np.arange(len(owner))
        middle = 0.5 * (pieces[here, longest[:, 0]] + pieces[here, longest[:, 1]])
        halves = [pieces.copy(), pieces.copy()]
        for half, end in zip(halves, longest.T, strict=True):
            half[here, end] = middle
        owner, pieces = np.tile(owner, 2), np.concatenate(halves)
    return np.concatenate(owners), np.concatenate(done), np.concatenate(diameters)


def _quadrature(corners: Array) -> Iterator[tuple[IntArray, Array, Array]]:
    """Quadrature points with the kernel's weight on pieces of simplices, in portions.

    Parameters
    ----------
    corners : (c, d + 1, d) array
        In standard deviations, the kernel's centre at zero.

    Yields
    ------
    owner : (k,) int array
        The simplex each piece lies in.
    barycentric : (k, q, d + 1) array
        Points in that simplex; larger pieces have more of them.
    weight : (k, q) array
        Quadrature weight relative to the volume of the simplex, times the kernel.
    """
    size = corners.shape[1]
    owner, pieces, diameter = _pieces(corners)
    kind = np.searchsorted([limit for limit, _ in _RULES[:-1]], diameter)
    for number, (_, per_axis) in enumerate(_RULES):
        places, weights = _rule(size - 1, per_axis)
        chosen = np.flatnonzero(kind == number)
        step = max(1, _POINTS // len(weights))
        for start in range(0, len(chosen), step):
            part = chosen[start : start + step]
            offsets = places @ (pieces[part] @ corners[owner[part]])
            square = (offsets * offsets).sum(axis=2)
            gauss = np.where(square < TRUNCATION**2, np.exp(-0.5 * square), 0.0)
            yield owner[part], places @ pieces[part], volume_fractions(pieces[part])[:, None] * weights * gauss


@cache
def _rule(dim: int, per_axis: int) -> tuple[Array, Array]:
    """Conical product rule: exact to degree 2 · per_axis − 1, all weights positive, of sum one.

    Returns barycentric points (q, d + 1) and weights (q,). Source: Stroud, Approximate Calculation
    of Multiple Integrals (1971), 2.4.
    """
    axes = [roots_jacobi(per_axis, dim - 1 - k, 0) for k in range(dim)]
    nodes = np.meshgrid(*[0.5 * (1.0 + x) for x, _ in axes], indexing="ij")
    weights = np.prod(np.meshgrid(*[w / w.sum() for _, w in axes], indexing="ij"), axis=0).ravel()
    rest = np.ones(weights.size)
    places = []
    for node in nodes:
        places.append(rest * node.ravel())
        rest = rest * (1.0 - node.ravel())
    return np.stack([rest, *places], axis=1), weights
