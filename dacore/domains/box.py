"""A rectangle of triangles or a box of tetrahedra."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.domain import Domain
from dacore.core.mesh import Mesh, exterior_facets
from dacore.errors import MeshError

_MAX_CELLS = 20_000_000


@dataclass(frozen=True)
class Box(Domain):
    """A rectangle or box cut into equal blocks, each of two triangles or six tetrahedra.

    The sides are called "x-" (the one at the lower x), "x+", "y-", "y+", and in three dimensions
    "z-", "z+".

    Parameters
    ----------
    lower, upper : tuple of 2 or 3 floats [cm]
        Opposite corners.
    divisions : tuple of int
        Number of blocks along each axis.
    roles : mapping of str to tuple of str, optional
        The sides of each role; every side has one. Without it the side at the lower end of the last
        axis is the "neck" and all others are "mre".

    Raises
    ------
    MeshError
        If a setting is out of range, or a side has no role or two.
    """

    lower: tuple[float, ...] = (0.0, 0.0, 0.0)
    upper: tuple[float, ...] = (1.0, 1.0, 1.0)
    divisions: tuple[int, ...] = (8, 8, 8)
    roles: Mapping[str, tuple[str, ...]] | None = None

    def __post_init__(self) -> None:
        dim = len(self.lower)
        if dim not in (2, 3) or len(self.upper) != dim or len(self.divisions) != dim:
            raise MeshError(
                f"box: got {dim} lower and {len(self.upper)} upper coordinates and {len(self.divisions)} divisions, "
                "expected 2 or 3 of each"
            )
        for axis, low, high, count in zip("xyz", self.lower, self.upper, self.divisions, strict=False):
            if not (np.isfinite(low) and np.isfinite(high) and high > low):
                raise MeshError(f"box {axis}: got {low} to {high} cm, expected lower < upper")
            if int(count) != count or count < 1:
                raise MeshError(f"box divisions along {axis}: got {count}, expected a whole number of at least 1")
        cells = {2: 2, 3: 6}[dim] * int(np.prod([float(n) for n in self.divisions]))
        if cells > _MAX_CELLS:
            raise MeshError(f"box divisions: {self.divisions} make {cells} cells, expected at most {_MAX_CELLS}")
        _check_roles(self.sides, self._roles())

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides, axis by axis, the lower one first."""
        return tuple(axis + end for axis in "xyz"[: len(self.lower)] for end in "-+")

    def mesh(self) -> Mesh:
        """Make the mesh [cm]."""
        points, cells = _blocks(self.lower, self.upper, self.divisions)
        facets = exterior_facets(cells)
        roles = self._roles()
        numbers = {role: number for number, role in enumerate(roles, start=1)}
        tag_of_side = {side: numbers[role] for role, names in roles.items() for side in names}
        tags = np.zeros(len(facets), dtype=np.int64)
        for axis in range(points.shape[1]):
            position = points[facets, axis]
            for end, at in (("-", self.lower[axis]), ("+", self.upper[axis])):
                tags[(position == at).all(axis=1)] = tag_of_side["xyz"[axis] + end]
        return Mesh(points, cells, facets, tags, numbers)

    def expected_nodes(self) -> int:
        """Number of nodes."""
        return int(np.prod(np.array(self.divisions) + 1))

    def _roles(self) -> dict[str, tuple[str, ...]]:
        if self.roles is not None:
            return {role: tuple(names) for role, names in self.roles.items()}
        held = self.sides[-2]
        return {"neck": (held,), "mre": tuple(side for side in self.sides if side != held)}


def _check_roles(sides: tuple[str, ...], roles: Mapping[str, tuple[str, ...]]) -> None:
    named = [side for names in roles.values() for side in names]
    unknown = sorted(set(named) - set(sides))
    if unknown:
        raise MeshError(f"box roles: got side {unknown[0]!r}, expected one of {', '.join(sides)}")
    twice = sorted({side for side in named if named.count(side) > 1})
    if twice:
        raise MeshError(f"box roles: side {twice[0]!r} is named {named.count(twice[0])} times, expected once")
    left = [side for side in sides if side not in named]
    if left:
        raise MeshError(f"box roles: no role has the side{'s' * (len(left) > 1)} {', '.join(left)}; name every side")
    empty = [role for role, names in roles.items() if not names]
    if empty:
        raise MeshError(f"box roles: {empty[0]!r} has no side; name one or leave the role out")


def _blocks(lower: tuple[float, ...], upper: tuple[float, ...], divisions: tuple[int, ...]) -> tuple[Array, IntArray]:
    """Points (n, d) and positively oriented cells (c, d + 1): Kuhn's simplices of each block."""
    dim = len(lower)
    axes = [np.linspace(a, b, int(n) + 1) for a, b, n in zip(lower, upper, divisions, strict=True)]
    points = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=1)
    strides = np.cumprod([1, *(int(n) + 1 for n in divisions[:0:-1])])[::-1].astype(np.int64)
    index = np.meshgrid(*(np.arange(int(n)) for n in divisions), indexing="ij")
    corner = sum(part.ravel() * stride for part, stride in zip(index, strides, strict=True))
    pieces = []
    for order in permutations(range(dim)):
        steps = np.concatenate([[0], np.cumsum(strides[list(order)])])
        if np.linalg.det(np.eye(dim)[list(order)]) < 0:
            steps[[-2, -1]] = steps[[-1, -2]]
        pieces.append(corner[:, None] + steps)
    return points, np.concatenate(pieces, axis=1).reshape(-1, dim + 1)
