"""MFEM's mesh of a dacore mesh, its Lagrange spaces, and where its dofs are in dacore's numbering."""

from collections import deque
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.mesh import Mesh
from dacore.errors import PluginError
from dacore_mfem.library import from_native, mfem, quiet


class MfemMesh:
    """MFEM's copy of a mesh: the same vertices, cells and numbers; roles become boundary attributes.

    Parameters
    ----------
    mesh : Mesh

    Attributes
    ----------
    native
        MFEM's mesh.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        # Facets as the cells have them: MFEM turns others round, and says so on stdout.
        facets = _turned(mesh, mesh.exterior_facets)
        # Attributes must be positive and MFEM's markers are as long as the largest: number the tags from one.
        self._tags, attributes = np.unique(_tags_of(mesh, facets), return_inverse=True)
        self.native = mfem.Mesh(mesh.dim, len(mesh.points), len(mesh.cells), len(facets), mesh.dim)
        flat = mesh.dim == 2
        _call(self.native.AddVertex, mesh.points)
        _call(self.native.AddTriangle if flat else self.native.AddTet, mesh.cells)
        bounded = np.column_stack([facets, attributes.ravel() + 1])
        _call(self.native.AddBdrSegment if flat else self.native.AddBdrTriangle, bounded)
        finalize = self.native.FinalizeTriMesh if flat else self.native.FinalizeTetMesh
        # With edges, without marking for refinement, which would turn the cells' vertices.
        with quiet():
            finalize(1, 0, True)
        self._spaces: dict[int, Space] = {}
        self._numbered = False

    def space(self, order: int) -> "Space":
        """Lagrange elements of order 1 or 2."""
        if order not in self._spaces:
            self._spaces[order] = Space(self.mesh, self.native, order)
        return self._spaces[order]

    def constants(self, weight: Array) -> Any:
        """MFEM's coefficient with a number (c,) for each cell. It must outlive the form that it is in."""
        if not self._numbered:
            # MFEM's constants belong to attributes, which start at one: give each cell its own.
            count = np.arange(len(self.mesh.cells))
            _call(self.native.SetAttribute, np.stack([count, count + 1], axis=1))
            self._numbered = True
        return mfem.PWConstCoefficient(mfem.Vector(np.array(weight, dtype=np.float64)))

    def marker(self, role: str) -> Any:
        """MFEM's marker of the boundary attributes that carry `role`."""
        marker = mfem.intArray(len(self._tags))
        marker.Assign(0)
        marker[int(np.searchsorted(self._tags, self.mesh.roles[role]))] = 1
        return marker


class Space:
    """Continuous Lagrange elements of one order.

    Parameters
    ----------
    mesh : Mesh
    native
        MFEM's mesh of it.
    order : int

    Attributes
    ----------
    dim, order : int
    scalar
        MFEM's space. What it hands out, such as an element, dies with it.
    """

    def __init__(self, mesh: Mesh, native: Any, order: int) -> None:
        self._mesh, self._native, self.dim, self.order = mesh, native, mesh.dim, order
        # Nodal at equally spaced points: vertices and edge midpoints. There P2 has one dof an edge, so none has a sign.
        self._collection = mfem.H1_FECollection(order, mesh.dim, mfem.BasisType.ClosedUniform)
        self.scalar = mfem.FiniteElementSpace(native, self._collection)
        given, expected = self.scalar.GetNDofs(), len(mesh.nodes(order))
        if given != expected:
            raise PluginError(
                f"mfem: elements of order {order} have {given} dofs, expected {expected}; MFEM sees another mesh: "
                "report this with the mesh"
            )

    @cached_property
    def vector(self) -> Any:
        """MFEM's space of vectors, dofs component by component."""
        return mfem.FiniteElementSpace(self._native, self._collection, self.dim, mfem.Ordering.byNODES)

    @property
    def geometry(self) -> int:
        """MFEM's name of the cells' shape."""
        return int(mfem.Geometry.TRIANGLE if self.dim == 2 else mfem.Geometry.TETRAHEDRON)

    @cached_property
    def nodes(self) -> IntArray:
        """Canonical node (n,) of each of MFEM's scalar dofs.

        Vertices keep their numbers. Edges do not; MFEM's own embedding of order 1 in order 2 tells which
        two vertices each one has.
        """
        if self.order == 1:
            return np.arange(len(self._mesh.points))
        n = len(self._mesh.points)
        linear = mfem.H1_FECollection(1, self.dim, mfem.BasisType.ClosedUniform)
        coarse = mfem.FiniteElementSpace(self._native, linear)
        form = mfem.DiscreteLinearOperator(coarse, self.scalar)
        form.AddDomainInterpolator(mfem.IdentityInterpolator())
        form.Assemble()
        form.Finalize()
        embedding = from_native(form.SpMat())
        embedding.data[np.abs(embedding.data) < 0.25] = 0.0
        embedding.eliminate_zeros()
        embedding.sort_indices()
        expected = np.repeat([1, 2], [n, embedding.shape[0] - n])
        if not (
            np.array_equal(np.diff(embedding.indptr), expected)
            and np.array_equal(embedding.indices[:n], np.arange(n))
            and np.allclose(embedding.data, np.repeat(1.0 / expected, expected), rtol=0, atol=1e-12)
        ):
            raise PluginError("mfem: elements of order 2 are not nodal at vertices and edge midpoints; report this")
        pairs = embedding.indices[n:].reshape(-1, 2).astype(np.int64)
        codes, wanted = (edges[:, 0] * n + edges[:, 1] for edges in (self._mesh.edges, pairs))
        edge = np.searchsorted(codes, wanted)
        return np.concatenate([np.arange(n), n + edge])


def _tags_of(mesh: Mesh, facets: IntArray) -> IntArray:
    """Tags (f,) of boundary facets given in another order and orientation."""
    both = np.sort(np.concatenate([mesh.facets, facets]), axis=1)
    _, label = np.unique(both, axis=0, return_inverse=True)
    given, wanted = np.split(label.ravel(), [len(facets)])
    tags = np.empty(len(facets), dtype=np.int64)
    tags[given] = mesh.facet_tags
    return tags[wanted]


def _turned(mesh: Mesh, facets: IntArray) -> IntArray:
    """Facets (f, d) that begin at the vertex opposite the longest edge, orientation kept.

    MFEM takes the area of a triangle from √(|a|²|b|² − (a·b)²), a and b the edges at its first vertex, which
    loses digits where |a||b| is much larger than the area.
    """
    if mesh.dim == 2:
        return facets
    corner = mesh.points[facets]
    opposite = np.linalg.norm(corner[:, [2, 0, 1]] - corner[:, [1, 2, 0]], axis=2)
    first = opposite.argmax(axis=1)
    return np.take_along_axis(facets, (first[:, None] + np.arange(3)) % 3, axis=1)


def _call(function: Callable[..., Any], table: Any) -> None:
    """Call a function with each row of a table as its arguments; there is no way to hand MFEM whole arrays."""
    deque(map(function, *table.T.tolist()), maxlen=0)
