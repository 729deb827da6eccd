"""Move the vertices of a mesh's few worst tetrahedra until their dihedral angles are better."""

from itertools import product

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.mesh import exterior_facets
from dacore.geometry.lattice import LevelSet
from dacore.geometry.quality import dihedral_angles, signed_angles

_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
_STEPS = (0.25, 0.12, 0.05)
_SWEEPS = 4


def polish(level_set: LevelSet, points: Array, cells: IntArray, fixed: BoolArray, goal: float = 18.0) -> Array:
    """Better the tetrahedra whose dihedral angles leave ``[goal, 180 - 2 goal]`` degrees.

    One vertex after another is moved to whichever of some trial positions makes the worst angle
    round it best; vertices of the surface are put back on it. No angle becomes worse than the
    worst of its neighbourhood was.

    Parameters
    ----------
    level_set : callable
        Points (n, 3) [cm] -> (n,) [cm], zero on the surface.
    points : (n, 3) array [cm]
    cells : (c, 4) int array
        Positively oriented.
    fixed : (n,) bool array
        Vertices that stay.
    goal : float [degrees]

    Returns
    -------
    (n, 3) array [cm]
    """
    points = points.copy()
    on_surface = np.zeros(len(points), dtype=bool)
    on_surface[exterior_facets(cells)] = True
    around = np.argsort(cells.ravel(), kind="stable") // 4
    start = np.searchsorted(np.sort(cells.ravel()), np.arange(len(points) + 1))
    worst = _worst(dihedral_angles(points, cells))
    for _ in range(_SWEEPS):
        vertices = np.unique(cells[worst < goal])
        touched = np.zeros(len(cells), dtype=bool)
        for vertex in vertices[~fixed[vertices]]:
            star = around[start[vertex] : start[vertex + 1]]
            if _improve(level_set, points, int(vertex), cells[star], bool(on_surface[vertex])):
                touched[star] = True
        if not touched.any():
            break
        worst[touched] = _worst(dihedral_angles(points, cells[touched]))
    return points


def _improve(level_set: LevelSet, points: Array, vertex: int, star: IntArray, on_surface: bool) -> bool:
    """Move one vertex in place if that betters the worst angle of its cells `star` (k, 4)."""
    here = points[vertex]
    corners = points[star]
    size = np.linalg.norm(corners - here, axis=2).max()
    trials = np.concatenate([here[None], *(here + size * step * _DIRECTIONS for step in _STEPS)])
    if on_surface:
        trials[1:] = _project(level_set, trials[1:], 0.02 * size)
    everyone = np.where((star == vertex)[None, :, :, None], trials[:, None, None, :], corners)
    angles = signed_angles(everyone.reshape(-1, 4, 3)).reshape(len(trials), -1)
    score = _worst(angles)
    best = int(score.argmax())
    if score[best] < score[0] + 0.05:
        return False
    points[vertex] = trials[best]
    return True


def _worst(angles: Array) -> Array:
    """Smallest angle (n,) of each row, or half of what the largest one leaves to 180 degrees."""
    return np.asarray(np.minimum(angles.min(axis=1), 0.5 * (180.0 - angles.max(axis=1))))


def _project(level_set: LevelSet, points: Array, step: float) -> Array:
    """Points (n, 3) moved onto the surface by Newton's method along the gradient."""
    for _ in range(4):
        offsets = step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        values = level_set((points[:, None, :] + offsets).reshape(-1, 3)).reshape(len(points), 7)
        gradient = (values[:, 1:4] - values[:, 4:]) / (2.0 * step)
        square = np.maximum(np.einsum("ni,ni->n", gradient, gradient), 0.05)
        points = points - (values[:, 0] / square)[:, None] * gradient
    return points
