"""Boxes cut into simplices, with one role a side."""

from itertools import permutations

import numpy as np
import pytest

from dacore.core.mesh import Mesh, exterior_facets


def make_box(counts: tuple[int, ...]) -> Mesh:
    """The unit box with counts[k] cells along axis k; sides x0, x1, y0, …: Kuhn's simplices."""
    dim = len(counts)
    shape = tuple(n + 1 for n in counts)
    points = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in shape], indexing="ij"), axis=-1).reshape(-1, dim)
    corners = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, dim)
    cells = []
    for order in permutations(range(dim)):
        path = np.concatenate([np.zeros((1, dim), dtype=int), np.cumsum(np.eye(dim, dtype=int)[list(order)], axis=0)])
        simplex = np.stack([np.ravel_multi_index(tuple((corners + p).T), shape) for p in path], axis=1)
        if np.linalg.det(np.diff(path, axis=0)) < 0:
            simplex[:, [0, 1]] = simplex[:, [1, 0]]
        cells.append(simplex)
    every = np.concatenate(cells)
    facets = exterior_facets(every)
    centres = points[facets].mean(axis=1)
    roles = {f"{'xyz'[axis]}{side}": 2 * axis + side + 1 for axis in range(dim) for side in (0, 1)}
    tags = np.zeros(len(facets), dtype=int)
    for axis in range(dim):
        for side in (0, 1):
            tags[np.isclose(centres[:, axis], side)] = 2 * axis + side + 1
    return Mesh(points, every, facets, tags, roles)


@pytest.fixture(scope="session")
def box():
    return make_box
