"""The parts of DOLFINx, UFL and Basix that changed between the versions this backend runs on.

Everything else may call those libraries as it likes as long as the call means the same from 0.5.2
(Debian 12) to 0.11. Written against the sources of 0.5.2, 0.6.0, 0.7.3, 0.8.0, 0.9.0, 0.10.0 and
0.11.0; run on 0.5.2, 0.9.0 and 0.11.0. Importing this module imports DOLFINx, starts MPI and leaves
no other trace.
"""

import re
from typing import Any

import h5py  # noqa: F401  DOLFINx loads its own HDF5 for all to see: a later h5py would be bound to that one
import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore_dolfinx.quiet import quiet

with quiet():
    import basix
    import dolfinx
    import ufl
    from dolfinx import fem, mesh
    from dolfinx.fem.assemble import assemble_matrix, create_matrix
    from mpi4py import MPI

VERSION = tuple(int(part) for part in re.findall(r"\d+", str(dolfinx.__version__))[:2])

_CELLS = {2: "triangle", 3: "tetrahedron"}


def _jit(options: dict[str, Any]) -> dict[str, Any]:
    """Keyword arguments that hand `options` to the compiler of forms and elements."""
    # Fresh dictionaries: DOLFINx writes into them.
    form, jit = ("params", "params") if VERSION < (0, 6) else ("options", "options")
    return {f"form_compiler_{form}": {}, f"jit_{jit}": dict(options)}


def make_mesh(points: Array, cells: IntArray) -> Any:
    """Mesh of affine simplices on this process alone; points (n, d), cells (c, d + 1)."""
    cell, dim = _CELLS[points.shape[1]], points.shape[1]
    if VERSION < (0, 7):
        # FFCx adds the variant to the mesh's element while it compiles, and every signature would change with it.
        element = ufl.VectorElement("Lagrange", cell, 1, variant="equispaced")
    else:
        import basix.ufl

        element = basix.ufl.element("Lagrange", cell, 1, shape=(dim,))
    keyword = "domain" if VERSION < (0, 8) else "e"
    arrays = {"cells": np.array(cells, dtype=np.int64), "x": np.array(points, dtype=np.float64)}
    return mesh.create_mesh(MPI.COMM_SELF, **arrays, **{keyword: ufl.Mesh(element)})


def cell_vertices(domain: Any) -> IntArray:
    """Numbers (c, d + 1) that the vertices of DOLFINx's cells had in the arrays given to `make_mesh`."""
    geometry = domain.geometry
    dofmap = geometry.dofmap if VERSION < (0, 11) else geometry.dofmaps[0]
    number = np.asarray(geometry.input_global_indices, dtype=np.int64)
    return np.asarray(number[_table(dofmap)].reshape(-1, int(geometry.dim) + 1))


def cell_facets(domain: Any) -> IntArray:
    """Facet numbers (c, d + 1) of DOLFINx's cells; facet k lies opposite to vertex k."""
    dim = int(domain.geometry.dim)
    topology = domain.topology
    topology.create_connectivity(dim - 1, dim)  # forms over facets need it
    topology.create_connectivity(dim, dim - 1)
    return np.array(topology.connectivity(dim, dim - 1).array, dtype=np.int64).reshape(-1, dim + 1)


def facet_tags(domain: Any, facets: IntArray) -> Any:
    """Mark facets, given by their sorted numbers, with 1."""
    marks = np.ones(len(facets), dtype=np.int32)
    return mesh.meshtags(domain, int(domain.geometry.dim) - 1, facets.astype(np.int32), marks)


def space(domain: Any, order: int, jit: dict[str, Any]) -> Any:
    """Scalar Lagrange elements of `order`; 0 for one constant a cell."""
    make = fem.FunctionSpace if VERSION < (0, 7) else fem.functionspace
    # Elements are not compiled since 0.8; the arguments went with 0.10.
    family = "Lagrange" if order else "Discontinuous Lagrange"
    return make(domain, (family, order), **(_jit(jit) if VERSION < (0, 10) else {}))


def cell_dofs(functions: Any) -> IntArray:
    """DOLFINx's dof numbers (c, n_local) of its cells, in the local order of Basix."""
    return _table(functions.dofmap.list).reshape(-1, functions.dofmap.dof_layout.num_dofs)


def compiled(form: Any, jit: dict[str, Any]) -> Any:
    """Compile a UFL form for double precision."""
    return fem.form(form, dtype=np.float64, **_jit(jit))


def function(functions: Any) -> Any:
    """Return a function of a space, zero so far; ``x.array`` holds its dofs."""
    return fem.Function(functions)


def constant(domain: Any, shape: tuple[int, ...]) -> Any:
    """Return a constant whose value is set later, through its ``value``.

    A form should have one at most: UFL orders several by their numbers as text, 9 behind 10, so that a
    process that has made many would compile the same form anew.
    """
    return fem.Constant(domain, np.zeros(shape))


def element(dim: int, order: int) -> Any:
    """Basix's Lagrange element, the one behind `space`."""
    return basix.create_element(
        basix.ElementFamily.P, getattr(basix.CellType, _CELLS[dim]), order, basix.LagrangeVariant.gll_warped
    )


def _table(adjacency: Any) -> IntArray:
    """Flat int64 array of what was an AdjacencyList before 0.7 and is an array since."""
    return np.array(adjacency.array if VERSION < (0, 7) else adjacency, dtype=np.int64).ravel()


__all__ = [
    "VERSION", "assemble_matrix", "cell_dofs", "cell_facets", "cell_vertices", "compiled", "constant",
    "create_matrix", "element", "facet_tags", "function", "make_mesh", "space",
]  # fmt: skip
