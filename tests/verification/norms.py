"""Errors of a finite element state against functions, integrated by Gauss's rule in every cell."""

from itertools import product

import numpy as np
from scipy.special import roots_jacobi

from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient


def rule(dim, points=3):
    """Barycentric points (q, d + 1) and weights (q,), summing to 1, exact to degree 2 · points − 1 (Stroud 1971)."""
    sides = [roots_jacobi(points, dim - 1 - k, 0) for k in range(dim)]
    nodes = np.array(list(product(*[(x + 1) / 2 for x, _ in sides])))
    weights = np.array([np.prod(w) for w in product(*[w for _, w in sides])])
    rest, barycentric = np.ones(len(nodes)), []
    for k in range(dim):
        barycentric.append(rest * nodes[:, k])
        rest = rest - barycentric[-1]
    return np.stack([*barycentric, rest], axis=1), weights / weights.sum()


def slopes(function, points, step=1e-5):
    """Gradients (n, k, d) of a function (n, d) -> (n, k), by central differences."""
    moves = step * np.eye(points.shape[1])
    return np.stack([(function(points + move) - function(points - move)) / (2 * step) for move in moves], axis=-1)


def sizes_and_errors(space, state, u, p, step=1e-5):
    """Pairs (error, size) of u, grad u, p and grad p in L².

    `u` maps points (n, d) to (n, d), `p` points to (n,); functions must also make sense a step outside.
    """
    cells, layout = space.cells(), space.layout
    dim = cells.points.shape[1]
    inside, weights = rule(dim)
    points = np.einsum("qk,ckd->cqd", inside, cells.points[cells.cells]).reshape(-1, dim)
    gradients, volumes = barycentric_gradients(cells.points, cells.cells)
    measure = np.outer(volumes, weights).ravel()
    out = {}
    for field, function in (("u", u), ("p", lambda x: p(x)[:, None])):
        order = cells.orders[field]
        values, jacobian = function(points), slopes(function, points, step)
        found, steep = np.empty_like(values), np.empty_like(jacobian)
        for k in range(layout.field(field).components):
            local = state[layout.component(field, k)][cells.nodes[field]]
            found[:, k] = np.einsum("ql,cl->cq", lagrange(order, inside), local).ravel()
            steep[:, k] = np.einsum(
                "qlk,ckd,cl->cqd", lagrange_gradient(order, inside), gradients, local, optimize=True
            ).reshape(-1, dim)
        out[field] = tuple(np.sqrt((part**2).sum(axis=1) @ measure) for part in (found - values, values))
        out["grad " + field] = tuple(
            np.sqrt((part**2).sum(axis=(1, 2)) @ measure) for part in (steep - jacobian, jacobian)
        )
    return out


def relative_errors(space, state, u, p, step=1e-5):
    """Relative errors of u, grad u, p and grad p."""
    return {name: error / size for name, (error, size) in sizes_and_errors(space, state, u, p, step).items()}


def rates(sizes, errors):
    """Observed orders between meshes of `sizes` cells along a side."""
    return np.diff(np.log(errors)) / -np.diff(np.log(np.asarray(sizes, dtype=float)))
