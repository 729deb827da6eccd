"""Meshes for tests of whatever stands on a mesh."""

from itertools import permutations, product

import numpy as np

from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.simplex import barycentric_gradients


def shuffled_box(dim: int, n: int = 3, seed: int = 0, perturb: float = 0.1, bumpy: bool = False) -> Mesh:
    """Unit square or cube of n cells an axis, in no order a backend could like.

    Points are moved by up to `perturb` grid lengths (inside; at the boundary too if `bumpy`) and
    renumbered, cells shuffled and their vertices permuted, facets listed in any order and
    orientation. Roles: "left" (x = 0), "right" (x = 1) and "side" (the rest).
    """
    rng = np.random.default_rng(seed)
    ticks = np.arange(n + 1)
    grid = np.stack(np.meshgrid(*[ticks] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    stride = (n + 1) ** np.arange(dim)[::-1]
    corners = np.array(list(product(range(n), repeat=dim)))
    # Kuhn's split: one simplex for each order in which a path walks from corner to opposite corner.
    paths = [
        np.cumsum([np.zeros(dim, int), *np.eye(dim, dtype=int)[list(p)]], axis=0) for p in permutations(range(dim))
    ]
    cells = np.concatenate([(corners[:, None, :] + path) @ stride for path in paths])
    inside = ((grid > 0) & (grid < n)).all(axis=1)
    moved = np.ones(len(grid), dtype=bool) if bumpy else inside
    points = grid / n + moved[:, None] * rng.uniform(-perturb, perturb, grid.shape) / n
    number = rng.permutation(len(points))
    back = np.argsort(number)
    points, cells, home = points[back], number[cells], grid[back]
    cells = rng.permuted(cells[rng.permutation(len(cells))], axis=1)
    inverted = barycentric_gradients(points, cells)[1] < 0
    cells[inverted, :2] = cells[inverted, 1::-1]
    facets = rng.permuted(rng.permutation(exterior_facets(cells)), axis=1)
    tags = np.full(len(facets), 3)
    tags[(home[facets, 0] == 0).all(axis=1)] = 1
    tags[(home[facets, 0] == n).all(axis=1)] = 2
    return Mesh(points, cells, facets, tags, {"left": 1, "right": 2, "side": 3})
