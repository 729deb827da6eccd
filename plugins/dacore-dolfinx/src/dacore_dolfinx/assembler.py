"""Every standard form by DOLFINx, block by block.

Matrices of vector elements are arrangements of scalar blocks, each one pass of a compiled kernel
over the cells into DOLFINx's own CSR matrix. That is faster than vector elements, which in 0.5.2
only PETSc's matrices take, and needs no PETSc.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import ufl

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.discretization import Assembler
from dacore.core.mesh import Mesh
from dacore.geometry.locate import PointLocator
from dacore_dolfinx import compat, forms, numbering
from dacore_dolfinx.compilation import compile_form, compile_space
from dacore_dolfinx.evaluation import basis_at


class DolfinxAssembler(Assembler):
    """The standard forms on a mesh.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._spaces: dict[int, Any] = {}
        self._dofs: dict[int, IntArray] = {}
        self._patterns: dict[tuple[int, int], tuple[Any, numbering.Places]] = {}

    def mass(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ a b: (n, n)."""
        return self._assemble(forms.MASS, order, order, weight=weight)

    def stiffness(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ∇a·∇b: (n, n)."""
        return self._assemble(forms.STIFFNESS, order, order, weight=weight)

    def strain(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ε(a):ε(b): (d n, d n)."""
        return self._assemble(forms.STRAIN, order, order, rows=self.mesh.dim, columns=self.mesh.dim, weight=weight)

    def divergence(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ (∇·a)(∇·b): (d n, d n)."""
        return self._assemble(forms.DIVERGENCE, order, order, rows=self.mesh.dim, columns=self.mesh.dim, weight=weight)

    def gradient_coupling(self, scalar: int, vector: int, weight: Array | None = None) -> Sparse:
        """∫ ∇p·v, v the test function: (d n_vector, n_scalar)."""
        return self._assemble(forms.GRADIENT_COUPLING, scalar, vector, rows=self.mesh.dim, weight=weight)

    def divergence_coupling(self, vector: int, scalar: int, weight: Array | None = None) -> Sparse:
        """∫ q ∇·u, q the test function: (n_scalar, d n_vector)."""
        return self._assemble(forms.DIVERGENCE_COUPLING, vector, scalar, columns=self.mesh.dim, weight=weight)

    def boundary_mass(self, order: int, role: str) -> Sparse:
        """∫ a b over the facets of `role`: (n, n)."""
        return self._assemble(forms.BOUNDARY_MASS, order, order, role=role)

    def boundary_coupling(self, scalar: int, vector: int, role: str) -> Sparse:
        """∫ p v·n over the facets of `role`, v the test function: (d n_vector, n_scalar)."""
        return self._assemble(forms.BOUNDARY_COUPLING, scalar, vector, rows=self.mesh.dim, role=role)

    def evaluation(self, points: Array, order: int, derivative: int | None) -> Sparse:
        """Values or one partial derivative of the basis functions at points: (p, n)."""
        return basis_at(self.mesh, self._locator, points, order, derivative)

    def _assemble(
        self,
        form: forms.Form,
        trial: int,
        test: int,
        rows: int = 1,
        columns: int = 1,
        role: str | None = None,
        weight: Array | None = None,
    ) -> Sparse:
        """Matrix of ``rows × columns`` blocks, (i, j) for the test direction i and the trial direction j."""
        domain = self._domain
        p, q = ufl.TrialFunction(self._space(trial)), ufl.TestFunction(self._space(test))
        directions = compat.constant(domain, (2, self.mesh.dim))
        a, b = (ufl.as_vector([directions[k, axis] for axis in range(self.mesh.dim)]) for k in range(2))
        measure = ufl.dx(domain=domain) if role is None else self._surface(role)
        integrand = form.integrand(p, q, a, b, ufl.FacetNormal(domain))
        if weight is not None:
            integrand = self._weight(weight) * integrand
        kernel = compile_form(integrand * measure(degree=form.degree(trial, test)))
        matrix, places = self._pattern(kernel, trial, test, keep=role is None)

        def blocks() -> Iterator[tuple[int, int, Array]]:
            axes = np.eye(self.mesh.dim)
            for i in range(rows):
                for j in range(i if form.symmetric else 0, columns):
                    directions.value[:] = axes[i], axes[j]
                    matrix.data[:] = 0.0
                    compat.assemble_matrix(matrix, kernel)
                    values = places.canonical(matrix.data)
                    yield i, j, values
                    if form.symmetric and j > i:
                        yield j, i, values[places.transposed]

        return places.matrix(rows, columns, blocks())

    def _pattern(self, kernel: Any, trial: int, test: int, keep: bool) -> tuple[Any, numbering.Places]:
        """DOLFINx's matrix for a kernel, and the places of its entries; kept for forms over cells."""
        if keep and (trial, test) in self._patterns:
            return self._patterns[trial, test]
        matrix = compat.create_matrix(kernel)
        made = matrix, numbering.Places(matrix, self._numbers(test), self._numbers(trial))
        if keep:
            self._patterns[trial, test] = made
        return made

    def _surface(self, role: str) -> Any:
        """Measure over the facets of `role`. Its mark is always 1, so that no role needs a kernel of its own."""
        facets = numbering.marked_facets(self.mesh, self._vertices, self._facets, role)
        tags = compat.facet_tags(self._domain, facets)
        return ufl.Measure("ds", domain=self._domain, subdomain_data=tags, subdomain_id=1)

    def _weight(self, weight: Array) -> Any:
        """A function that is constant on each cell; its numbers go in by the cells of the mesh."""
        function = compat.function(self._space(0))
        function.x.array[compat.cell_dofs(self._space(0))[:, 0]] = weight[self._cells]
        return function

    @cached_property
    def _cells(self) -> IntArray:
        return numbering.canonical_cells(self.mesh, self._vertices)

    def _space(self, order: int) -> Any:
        """Scalar Lagrange elements; of order 0, one constant a cell."""
        if order not in self._spaces:
            self._spaces[order] = compile_space(self._domain, order)
        return self._spaces[order]

    def _numbers(self, order: int) -> IntArray:
        if order not in self._dofs:
            self._dofs[order] = numbering.canonical_dofs(self.mesh, self._vertices, self._space(order), order)
        return self._dofs[order]

    @cached_property
    def _domain(self) -> Any:
        return compat.make_mesh(self.mesh.points, self.mesh.cells)

    @cached_property
    def _vertices(self) -> IntArray:
        return compat.cell_vertices(self._domain)

    @cached_property
    def _facets(self) -> IntArray:
        return compat.cell_facets(self._domain)

    @cached_property
    def _locator(self) -> PointLocator:
        return PointLocator(self.mesh.points, self.mesh.cells)
