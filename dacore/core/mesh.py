"""A simplicial mesh with a role on every boundary facet. Constructed means valid."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dacore.core.arrays import Array, IntArray, as_array, as_indices, check_shape
from dacore.core.display import Card, Displayed, count
from dacore.core.simplex import barycentric_gradients, local_edges
from dacore.errors import MeshError, ShapeError


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Displayed):
    """Triangles or tetrahedra, and the role of each boundary facet.

    Parameters
    ----------
    points : (n, d) array [cm]
        d is 2 or 3.
    cells : (c, d + 1) int array
        Positively oriented simplices.
    facets : (f, d) int array
        Every boundary facet, once.
    facet_tags : (f,) int array
        One tag for each facet.
    roles : mapping of str to int
        The tag that stands for each role, a word the physics knows ("neck", "ventricles").

    Raises
    ------
    MeshError
        If nodes are orphans or coincide, cells are inverted, flat or doubled, a facet is not on
        the boundary, or the boundary is not covered once by tagged facets whose tags have a role.
    """

    points: Array
    cells: IntArray
    facets: IntArray
    facet_tags: IntArray
    roles: Mapping[str, int]

    def __init__(
        self,
        points: ArrayLike,
        cells: ArrayLike,
        facets: ArrayLike,
        facet_tags: ArrayLike,
        roles: Mapping[str, int],
    ) -> None:
        try:
            nodes = as_array("mesh points", points, (None, None))
            if nodes.shape[1] not in (2, 3):
                raise MeshError(f"mesh points: got {nodes.shape[1]} coordinates a point, expected 2 or 3")
            dim = nodes.shape[1]
            _check_corners(np.shape(cells), dim)
            simplices = as_indices("mesh cells", cells, (None, dim + 1), len(nodes))
            faces = as_indices("mesh facets", facets, (None, dim), len(nodes))
            given = np.asarray(facet_tags)
            if given.size and not np.issubdtype(given.dtype, np.integer):
                raise MeshError(f"mesh facet tags: got numbers of type {given.dtype}, expected integers")
            tags = np.array(given, dtype=np.int64)
            check_shape("mesh facet tags", tags, (len(faces),))
        except ShapeError as error:
            raise MeshError(str(error)) from error
        tags.flags.writeable = False
        for name, value in (
            ("points", nodes), ("cells", simplices), ("facets", faces), ("facet_tags", tags), ("roles", dict(roles)),
        ):  # fmt: skip
            object.__setattr__(self, name, value)
        if len(simplices) == 0:
            raise MeshError("mesh cells: got none, expected at least one")
        self._check_points()
        self._check_cells()
        self._check_boundary()

    def _check_points(self) -> None:
        used = np.zeros(len(self.points), dtype=bool)
        used[self.cells] = True
        if not used.all():
            orphans = np.flatnonzero(~used)
            raise MeshError(
                f"mesh points: {len(orphans)} belong to no cell (first: {orphans[0]}); remove the orphan points"
            )
        order = np.lexsort(self.points.T)
        same = (self.points[order[1:]] == self.points[order[:-1]]).all(axis=1)
        if same.any():
            pair = np.sort(order[np.flatnonzero(same)[0] + np.arange(2)])
            raise MeshError(
                f"mesh points: {int(same.sum())} coincide with another (first pair: {pair[0]} and {pair[1]}); "
                "merge the points, or the domain falls apart there"
            )

    def _check_cells(self) -> None:
        check_distinct(self.cells)
        # Measured against each cell's own size, so that a strongly graded mesh passes.
        flat = self.volumes <= 1e-13 * np.ptp(self.points[self.cells], axis=1).max(axis=1) ** self.dim
        if flat.any():
            raise MeshError(
                f"mesh cells: {int(flat.sum())} of {len(flat)} are inverted or flat (first: {np.flatnonzero(flat)[0]}, "
                f"volume {self.volumes[flat][0]:.3g}); swap two vertices of inverted cells, remove flat ones"
            )

    def _check_boundary(self) -> None:
        exterior = self.exterior_facets
        want, have = self._codes(exterior), self._codes(self.facets)
        if len(np.unique(have)) != len(have):
            raise MeshError("mesh facets: a facet is listed twice; expected one tag a facet")
        stray = ~np.isin(have, want)
        if stray.any():
            raise MeshError(f"mesh facets: {int(stray.sum())} tagged facets are not on the boundary; remove their tags")
        if len(have) < len(want):
            raise MeshError(
                f"mesh facets: {len(want) - len(have)} of {len(want)} boundary facets have no tag; give each one a role"
            )
        unknown = sorted(set(np.unique(self.facet_tags).tolist()) - set(self.roles.values()))
        if unknown:
            raise MeshError(f"mesh facet tags: {unknown} have no role; roles are {dict(self.roles)}")
        for role, tag in self.roles.items():
            if not (self.facet_tags == tag).any():
                raise MeshError(f"mesh role {role!r}: no boundary facet has its tag {tag}")

    def _card(self) -> Card:
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        extent = ", ".join(f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=False))
        cell, cells, side = ("triangle", "", "edge") if self.dim == 2 else ("tetrahedron", "tetrahedra", "facet")
        boundary = ", ".join(
            f"{role} ({count(int((self.facet_tags == tag).sum()), side)})" for role, tag in self.roles.items()
        )
        size = f"{count(len(self.points), 'node')}, {count(len(self.cells), cell, cells)}"
        return Card("Mesh", (("size", size), ("extent [cm]", extent), ("boundary", boundary)))

    @property
    def dim(self) -> int:
        """Dimension d of space."""
        return int(self.points.shape[1])

    @cached_property
    def volumes(self) -> Array:
        """Volumes (c,) [cm^d] of the cells."""
        return _frozen(barycentric_gradients(self.points, self.cells)[1])

    @cached_property
    def exterior_facets(self) -> IntArray:
        """Boundary facets (f, d) as the cells have them, oriented outwards."""
        return _frozen(exterior_facets(self.cells))

    @cached_property
    def edges(self) -> IntArray:
        """Edges (e, 2) sorted by (smaller, larger) vertex: the order of P2's edge nodes."""
        return self._edges[0]

    @cached_property
    def cell_edges(self) -> IntArray:
        """Edge numbers (c, n_local_edges) of each cell in local edge order."""
        return self._edges[1]

    @cached_property
    def _edges(self) -> tuple[IntArray, IntArray]:
        pairs = np.array(local_edges(self.dim))
        codes, inverse = np.unique(self._codes(self.cells[:, pairs].reshape(-1, 2)), return_inverse=True)
        edges = np.stack(np.divmod(codes, len(self.points)), axis=1)
        return _frozen(edges), _frozen(inverse.reshape(len(self.cells), len(pairs)).astype(np.int64))

    @cached_property
    def _quadratic(self) -> tuple[Array, IntArray]:
        nodes = np.concatenate([self.points, self.points[self.edges].mean(axis=1)])
        return _frozen(nodes), _frozen(np.concatenate([self.cells, len(self.points) + self.cell_edges], axis=1))

    def nodes(self, order: int) -> Array:
        """Coordinates (n_nodes, d) [cm] of the nodes of elements of order 1 or 2.

        Parameters
        ----------
        order : {1, 2}

        Returns
        -------
        (n_nodes, d) array [cm]
        """
        return self.points if order == 1 else self._quadratic[0]

    def cell_nodes(self, order: int) -> IntArray:
        """Node numbers (c, n_local) of each cell for elements of order 1 or 2.

        Parameters
        ----------
        order : {1, 2}

        Returns
        -------
        (c, n_local) int array
        """
        return self.cells if order == 1 else self._quadratic[1]

    def boundary_facets(self, role: str) -> IntArray:
        """Facets (f, d) that carry `role`; MeshError if the mesh has no such role.

        Parameters
        ----------
        role : str

        Returns
        -------
        (f, d) int array

        Raises
        ------
        MeshError
            If the mesh has no such role.
        """
        return np.asarray(self.facets[self.facet_tags == self._tag(role)])

    def boundary_nodes(self, role: str, order: int = 1) -> IntArray:
        """Nodes on the closed facets that carry `role`, sorted.

        Parameters
        ----------
        role : str
        order : {1, 2}

        Returns
        -------
        (n,) int array

        Raises
        ------
        MeshError
            If the mesh has no such role.
        """
        facets = self.boundary_facets(role)
        vertices = np.unique(facets)
        if order == 1:
            return vertices
        pairs = np.concatenate([facets[:, list(pair)] for pair in local_edges(self.dim - 1)])
        wanted = np.isin(self._codes(self.edges), self._codes(pairs))
        return np.concatenate([vertices, len(self.points) + np.flatnonzero(wanted)])

    def _codes(self, table: IntArray) -> IntArray:
        return _row_codes(table, len(self.points))

    def _tag(self, role: str) -> int:
        if role not in self.roles:
            raise MeshError(f"mesh role {role!r}: not on this mesh, which has {', '.join(sorted(self.roles))}")
        return int(self.roles[role])


def check_distinct(cells: IntArray) -> None:
    """MeshError if a cell names a point twice, or two cells have the same points.

    Parameters
    ----------
    cells : (c, d + 1) int array

    Raises
    ------
    MeshError
        If one is degenerate, or two are the same.
    """
    ordered = np.sort(cells, axis=1)
    twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if twice.any():
        raise MeshError(
            f"mesh cells: {int(twice.sum())} of {len(cells)} name the same point twice "
            f"(first: {np.flatnonzero(twice)[0]}); remove these degenerate cells"
        )
    order = np.lexsort(ordered.T)
    doubled = order[1:][(ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)]
    if len(doubled):
        raise MeshError(
            f"mesh cells: {len(doubled)} repeat an earlier one (first: {doubled.min()}); remove the duplicates"
        )


def exterior_facets(cells: IntArray) -> IntArray:
    """Facets (f, d) that belong to one cell only, oriented outwards for positive cells.

    Parameters
    ----------
    cells : (c, d + 1) int array

    Returns
    -------
    (f, d) int array

    Raises
    ------
    MeshError
        If a facet belongs to more than two cells.
    """
    n = cells.shape[1]
    facets = []
    for k in range(n):
        rest = [i for i in range(n) if i != k]
        if k % 2 == 1:
            rest[0], rest[1] = rest[1], rest[0]
        facets.append(cells[:, rest])
    every = np.concatenate(facets)
    _, first, counts = np.unique(_row_codes(every, int(cells.max()) + 1), return_index=True, return_counts=True)
    if (counts > 2).any():
        raise MeshError(
            f"mesh cells: {int((counts > 2).sum())} facets belong to more than two cells; "
            "expected a manifold, remove cells that overlap"
        )
    return np.asarray(every[first[counts == 1]])


def _check_corners(shape: tuple[int, ...], dim: int) -> None:
    """Say what is wrong where the cells have as many corners as those of another dimension, or of no simplex."""
    if len(shape) != 2 or shape[1] == dim + 1:
        return
    got = f"mesh cells: got {shape[1]} corners a cell and points of {dim} coordinates"
    if (shape[1], dim) == (3, 3):
        raise MeshError(
            f"{got}, expected tetrahedra there; for a plane domain leave out the constant coordinate "
            "(points[:, :2]), a curved surface has to be filled with tetrahedra"
        )
    if (shape[1], dim) == (4, 2):
        raise MeshError(f"{got}, expected triangles there; cut quadrilaterals into two triangles each")
    raise MeshError(f"{got}, expected {dim + 1} corners: triangles in the plane, tetrahedra in space")


def _row_codes(table: IntArray, base: int) -> IntArray:
    """One number (n,) for each row of vertex numbers below `base`, whatever their order in the row.

    The numbers are in the lexicographic order of the sorted rows.
    """
    if base ** table.shape[1] >= 2**63:
        raise MeshError(f"mesh: {base} points are more than facet numbering can hold; split the domain")
    code = np.zeros(len(table), dtype=np.int64)
    for column in np.sort(table, axis=1).T:
        code = code * base + column
    return code


_Any = TypeVar("_Any", bound=np.generic)


def _frozen(array: NDArray[_Any]) -> NDArray[_Any]:
    """Make an array read-only: what a mesh hands out is shared."""
    array.flags.writeable = False
    return array
