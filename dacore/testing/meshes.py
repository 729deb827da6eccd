"""Small meshes in no order that a library could like: what anything that stands on a mesh is tested on."""

from itertools import permutations, product

import numpy as np

from dacore.core.arrays import Array
from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.simplex import barycentric_gradients


def shuffled_box(
    dim: int, n: int = 3, seed: int = 0, perturb: float = 0.1, bumpy: bool = False, hole: bool = False
) -> Mesh:
    """Unit square or cube of n cells an axis, in no order a backend could like.

    Points are moved by up to `perturb` grid lengths (inside; at the boundary too if `bumpy`) and
    renumbered, cells shuffled and their vertices permuted, facets listed in any order and
    orientation.

    Parameters
    ----------
    dim : int
        2 or 3.
    n : int
    seed : int
    perturb : float
        Below about 0.15, so that no cell turns over.
    bumpy : bool
        Move the boundary too.
    hole : bool
        Leave the middle block out (odd n of at least 3), so that the boundary has two parts.

    Returns
    -------
    Mesh
        Roles: "left" (x = 0), "right" (x = 1), "hole" if there is one, and "side" (the rest).
    """
    rng = np.random.default_rng(seed)
    ticks = np.arange(n + 1)
    grid = np.stack(np.meshgrid(*[ticks] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    stride = (n + 1) ** np.arange(dim)[::-1]
    corners = np.array(list(product(range(n), repeat=dim)))
    if hole:
        corners = corners[(corners != n // 2).any(axis=1)]
    # Kuhn's split: one simplex for each order in which a path walks from corner to opposite corner.
    paths = [
        np.cumsum([np.zeros(dim, int), *np.eye(dim, dtype=int)[list(p)]], axis=0) for p in permutations(range(dim))
    ]
    cells = np.concatenate([(corners[:, None, :] + path) @ stride for path in paths])
    moved = np.asarray(((grid > 0) & (grid < n)).all(axis=1) | bumpy)
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
    roles = {"left": 1, "right": 2, "side": 3}
    if hole:
        tags[((home[facets] > 0) & (home[facets] < n)).all(axis=(1, 2))] = 4
        roles["hole"] = 4
    return Mesh(points, cells, facets, tags, roles)


def graded_box(dim: int, n: int = 3, seed: int = 0) -> Mesh:
    """Bumpy box whose layers grow twentyfold from one to the next along every axis (for n = 3).

    Roles as in `shuffled_box`.
    """
    box = shuffled_box(dim, n, seed, perturb=0.02, bumpy=True)
    return with_points(box, np.expm1(9.0 * box.points) / np.expm1(9.0))


def islands(dim: int, seed: int = 0) -> Mesh:
    """Two cells that do not touch, one ten times the other's size, every facet with a role of its own.

    Every node is on the boundary and each cell touches many roles, so a form over the wrong facet shows.
    Roles: "f0", "f1" and so on.
    """
    rng = np.random.default_rng(seed)
    corners = np.concatenate([np.zeros((1, dim)), np.eye(dim)])
    points, cells = [], []
    for k, size in enumerate((1.0, 0.1)):
        while True:
            shape = size * (corners + rng.uniform(-0.3, 0.3, corners.shape)) + 2.0 * k
            if np.linalg.det(shape[1:] - shape[0]) > 0.2 * size**dim:
                break
        points.append(shape)
        cells.append(k * (dim + 1) + np.arange(dim + 1))
    number = rng.permutation(2 * (dim + 1))
    numbered = number[np.stack(cells)]
    # An even permutation keeps the orientation.
    numbered[:, :3] = numbered[:, [1, 2, 0]]
    facets = rng.permuted(rng.permutation(exterior_facets(numbered)), axis=1)
    tags = 1 + np.arange(len(facets))
    return Mesh(
        np.concatenate(points)[np.argsort(number)], numbered, facets, tags, {f"f{k}": k + 1 for k in range(len(facets))}
    )


def with_points(mesh: Mesh, points: Array) -> Mesh:
    """Return the same cells and facets on other points (n, d) [cm]."""
    return Mesh(points, mesh.cells, mesh.facets, mesh.facet_tags, mesh.roles)
