"""Background tetrahedra: a body-centred cubic lattice graded by an octree.

Labelle & Shewchuk, "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles",
ACM Trans. Graph. 26(3), 2007, section 4. Every leaf of the octree has a vertex at its centre and
at its corners. Leaves that share a whole face give four tetrahedra round it (cut in two where an
edge carries a finer leaf's corner); a leaf facing finer ones gives a fan round the face's centre,
and each of the finer ones a pyramid cut along the diagonal through that centre. At the lowest plane
of the tree the tetrahedra that would cross it are halved, so that it is made of their faces.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.errors import MeshError

LevelSet = Callable[[Array], Array]

_RING = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_NEIGHBOURS = np.array(list(product((-1, 0, 1), repeat=3)), dtype=np.int64)
_CHILDREN = np.array(list(product((0, 1), repeat=3)), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Octree:
    """Balanced octree: leaves that touch, even at a corner, differ by one level at most.

    Parameters
    ----------
    origin : (3,) array [cm]
    edge : float [cm]
        Edge of the cells of level 0.
    shape : tuple of int
        Number of cells of level 0 along each axis.
    split : tuple of int arrays
        For each level, sorted keys of the cells that are split.
    """

    origin: Array
    edge: float
    shape: tuple[int, int, int]
    split: tuple[IntArray, ...]

    @property
    def depth(self) -> int:
        """Number of the finest level."""
        return len(self.split)

    def keys(self, level: int, cells: IntArray) -> IntArray:
        """One number for each cell (n, 3) of a level, -1 outside the tree."""
        shape = np.array(self.shape, dtype=np.int64) << level
        inside = ((cells >= 0) & (cells < shape)).all(axis=1)
        key = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
        return np.where(inside, key, -1)

    def cells(self, level: int, keys: IntArray) -> IntArray:
        """Cells (n, 3) of a level from their keys."""
        return np.stack(np.unravel_index(keys, tuple(n << level for n in self.shape)), axis=1).astype(np.int64)

    def is_split(self, level: int, cells: IntArray) -> BoolArray:
        """Whether cells (n, 3) of a level are in the tree and split."""
        if not 0 <= level < self.depth:
            return np.zeros(len(cells), dtype=bool)
        return np.asarray(np.isin(self.keys(level, cells), self.split[level]))

    def is_leaf(self, level: int, cells: IntArray) -> BoolArray:
        """Whether cells (n, 3) of a level are leaves of the tree."""
        if level < 0:
            return np.zeros(len(cells), dtype=bool)
        exists = self.keys(level, cells) >= 0
        if level > 0:
            exists &= self.is_split(level - 1, cells >> 1)
        return np.asarray(exists & ~self.is_split(level, cells))

    def leaves(self, level: int) -> IntArray:
        """Leaves (n, 3) of a level."""
        every = self._existing(level)
        return every[~self.is_split(level, every)]

    def centres(self, level: int, cells: IntArray) -> Array:
        """Centres (n, 3) [cm] of cells of a level."""
        return np.asarray(self.origin + (cells + 0.5) * (self.edge / 2**level))

    def _existing(self, level: int) -> IntArray:
        if level == 0:
            return self.cells(0, np.arange(int(np.prod(self.shape)), dtype=np.int64))
        parents = self.cells(level - 1, self.split[level - 1])
        return (2 * parents[:, None, :] + _CHILDREN).reshape(-1, 3)


def octree(origin: Array, edge: float, shape: tuple[int, int, int], sizing: LevelSet | None) -> Octree:
    """Split cells until none is larger than `sizing` (points (n, 3) -> (n,) [cm]) at its centre."""
    tree = Octree(origin, edge, shape, ())
    if sizing is None:
        return tree
    while True:
        level = tree.depth
        cells = tree._existing(level)
        if len(cells) == 0:
            break
        coarse = sizing(tree.centres(level, cells)) < edge / 2**level * (1.0 - 1e-9)
        if not coarse.any():
            break
        tree = Octree(origin, edge, shape, (*tree.split, np.sort(tree.keys(level, cells[coarse]))))
    return _balanced(tree)


def _balanced(tree: Octree) -> Octree:
    split = list(tree.split)
    for level in range(len(split) - 1, 0, -1):
        cells = tree.cells(level, split[level])
        around = np.unique((cells[:, None, :] + _NEIGHBOURS).reshape(-1, 3) >> 1, axis=0)
        needed = tree.keys(level - 1, around)
        split[level - 1] = np.union1d(split[level - 1], needed[needed >= 0])
    return Octree(tree.origin, tree.edge, tree.shape, tuple(split))


def lattice_tetrahedra(tree: Octree, reach: LevelSet) -> tuple[Array, IntArray]:
    """Tetrahedra of the graded lattice.

    Parameters
    ----------
    tree : Octree
    reach : callable
        Level set, points (n, 3) -> (n,); leaves whose centre lies further outside than 1.5 edges
        are left out.

    Returns
    -------
    points : (n, 3) array [cm]
    cells : (c, 4) int array
        Positively oriented.

    Raises
    ------
    MeshError
        If every leaf is left out.
    """
    corners, pieces = [], []
    extent = (np.array(tree.shape, dtype=np.int64) << (tree.depth + 1)) + 1

    def code(nodes: IntArray) -> IntArray:
        """One number for each node (n, 3) in units of half the finest edge."""
        return np.asarray((nodes[:, 0] * extent[1] + nodes[:, 1]) * extent[2] + nodes[:, 2])

    levels = range(tree.depth + 1)
    leaves = {level: tree.leaves(level) for level in levels}
    for level, cells in leaves.items():
        size = np.int64(2) << (tree.depth - level)
        corners.append(np.unique(code(((cells[:, None, :] + _CHILDREN) * size).reshape(-1, 3))))
    corner_codes = np.unique(np.concatenate(corners))
    for level, cells in leaves.items():
        near = reach(tree.centres(level, cells)) < 1.5 * tree.edge / 2**level
        for axis in range(3):
            pieces += _around_faces(tree, level, cells[near], axis, code, corner_codes)
    if not pieces:
        raise MeshError("no lattice point lies inside the level set")
    tets = np.concatenate(pieces)
    codes, cells = np.unique(tets, return_inverse=True)
    cells = cells.reshape(tets.shape).astype(np.int64)
    unit = tree.edge / 2 ** (tree.depth + 1)
    points = tree.origin + unit * np.stack(np.unravel_index(codes, tuple(extent)), axis=1)
    return points, oriented(points, cells)


def _around_faces(
    tree: Octree, level: int, cells: IntArray, axis: int, code: Callable[[IntArray], IntArray], corner_codes: IntArray
) -> list[IntArray]:
    """Tetrahedra (n, 4) of node codes between the leaves of a level and their neighbours on `axis`."""
    half = np.int64(1) << (tree.depth - level)
    side_u, side_v = (np.eye(3, dtype=np.int64)[k] for k in range(3) if k != axis)
    out: list[IntArray] = []

    def emit(*nodes: IntArray) -> None:
        out.append(np.stack([code(node) for node in nodes], axis=1))

    for sign in (1, -1):
        step = sign * np.eye(3, dtype=np.int64)[axis]
        same = tree.is_leaf(level, cells + step) & (sign > 0)
        finer = tree.is_split(level, cells + step)
        coarser = tree.is_leaf(level - 1, (cells + step) >> 1) if level else np.zeros(len(cells), dtype=bool)
        floor = (cells[:, axis] == 0) & (axis == 2) & (sign < 0)
        for chosen, kind in ((same, "same"), (finer, "finer"), (coarser, "coarser"), (floor, "floor")):
            if not chosen.any():
                continue
            centre = (2 * cells[chosen] + 1) * half
            face = centre + half * step
            ring = [face + half * (u * side_u + v * side_v) for u, v in _RING]
            if kind == "coarser":
                # The diagonal must meet the centre of the coarse leaf's face.
                hub = (2 * ((cells[chosen] + step) >> 1) + 1) * 2 * half - 2 * half * step
                for k in range(4):
                    here = (ring[k] == hub).all(axis=1)
                    a, b, c, d = (ring[(k + n) % 4][here] for n in range(4))
                    emit(centre[here], a, b, c)
                    emit(centre[here], a, c, d)
                continue
            apex = centre + 2 * half * step if kind == "same" else face
            for k in range(4):
                a, b = ring[k], ring[(k + 1) % 4]
                middle = (a + b) // 2
                parted = np.ones(len(a), dtype=bool) if kind == "finer" else np.isin(code(middle), corner_codes)
                emit(centre[~parted], apex[~parted], a[~parted], b[~parted])
                emit(centre[parted], apex[parted], a[parted], middle[parted])
                emit(centre[parted], apex[parted], middle[parted], b[parted])
    return out


def oriented(points: Array, cells: IntArray) -> IntArray:
    """Return cells (c, 4) with the last two vertices swapped where the volume is negative."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    negative = np.einsum("ci,ci->c", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])) < 0
    out = cells.copy()
    out[negative, 2], out[negative, 3] = cells[negative, 3], cells[negative, 2]
    return out
