"""Every standard form by MFEM's integrators, brought to dacore's numbering.

Nine tenths of the time MFEM takes for a form between vectors goes into adding cell matrices to the
sparse matrix. Strain and divergence are therefore composed of the scalar forms D_ij = ∫ ∂_i a ∂_j b,
each MFEM's diffusion with one entry of the tensor set, five times as fast as its elasticity
integrator, which the tests compare them with.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.discretization import Assembler
from dacore.core.mesh import Mesh
from dacore.geometry.locate import PointLocator
from dacore_mfem.library import from_native, mfem
from dacore_mfem.pattern import Pattern, renumbered
from dacore_mfem.shapes import Shapes
from dacore_mfem.spaces import MfemMesh


class MfemAssembler(Assembler):
    """The standard forms on a mesh.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._mfem = MfemMesh(mesh)
        self._patterns: dict[int, Pattern] = {}
        self._shapes: dict[int, Shapes] = {}

    def mass(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ a b: (n, n)."""
        factor = self._factor(weight)
        return self._scalar(order, mfem.MassIntegrator(*factor), 2 * order)

    def stiffness(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ∇a·∇b: (n, n)."""
        factor = self._factor(weight)
        return self._scalar(order, mfem.DiffusionIntegrator(*factor), 2 * (order - 1))

    def strain(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ ε(a):ε(b): (d n, d n)."""
        # ε(u):ε(v) = ½ Σ_ij (∂_j u_i ∂_j v_i + ∂_j u_i ∂_i v_j): block (a, b) is ½ (δ_ab Σ_i D_ii + D_ba).
        pattern, second = self._second(order, weight)
        laplace = sum(second(axis, axis) for axis in range(self.mesh.dim))
        return pattern.block(
            self.mesh.dim, lambda a, b: 0.5 * (second(b, a) + laplace) if a == b else 0.5 * second(b, a)
        )

    def divergence(self, order: int, weight: Array | None = None) -> Sparse:
        """∫ (∇·a)(∇·b): (d n, d n)."""
        pattern, second = self._second(order, weight)
        return pattern.block(self.mesh.dim, second)

    def gradient_coupling(self, scalar: int, vector: int, weight: Array | None = None) -> Sparse:
        """∫ ∇p·v, v the test function: (d n_vector, n_scalar)."""
        p, v = self._mfem.space(scalar), self._mfem.space(vector)
        factor = self._factor(weight)
        form = _mixed(p.scalar, v.vector, mfem.GradientIntegrator(*factor), self._rule(scalar + vector - 1))
        return renumbered(form, self._components(v.nodes), p.nodes)

    def divergence_coupling(self, vector: int, scalar: int, weight: Array | None = None) -> Sparse:
        """∫ q ∇·u, q the test function: (n_scalar, d n_vector)."""
        u, q = self._mfem.space(vector), self._mfem.space(scalar)
        factor = self._factor(weight)
        form = _mixed(u.vector, q.scalar, mfem.VectorDivergenceIntegrator(*factor), self._rule(scalar + vector - 1))
        return renumbered(form, q.nodes, self._components(u.nodes))

    def boundary_mass(self, order: int, role: str) -> Sparse:
        """∫ a b over the facets of `role`: (n, n)."""
        space, marker = self._mfem.space(order), self._mfem.marker(role)
        form = mfem.BilinearForm(space.scalar)
        one = mfem.ConstantCoefficient(1.0)
        integrator = mfem.BoundaryMassIntegrator(one)
        integrator.SetIntRule(self._facet_rule(2 * order))
        form.AddBoundaryIntegrator(integrator, marker)
        return renumbered(_finished(form), space.nodes, space.nodes)

    def boundary_coupling(self, scalar: int, vector: int, role: str) -> Any:
        """∫ p v·n over the facets of `role`, v the test function: (d n_vector, n_scalar)."""
        # MFEM's trace integrator has the normal but one space: that of the higher order, which holds the other.
        order = max(scalar, vector)
        parts = [self._trace(order, role, axis, scalar + vector) for axis in range(self.mesh.dim)]
        if vector < order:
            parts = [self._embedding.T @ part for part in parts]
        if scalar < order:
            parts = [part @ self._embedding for part in parts]
        return vstack(parts, format="csr")

    def evaluation(self, points: Array, order: int, derivative: int | None) -> Sparse:
        """Values or one partial derivative of the basis functions at points: (p, n)."""
        cells, barycentric = self._locator.locate(points)
        if order not in self._shapes:
            self._shapes[order] = Shapes(self._mfem.space(order))
        shapes, reference = self._shapes[order], barycentric[:, 1:]
        if derivative is None:
            values = shapes.values(reference)
        else:
            values = shapes.derivative(self.mesh, cells, reference, derivative)
        nodes = self.mesh.cell_nodes(order)[cells][:, shapes.local]
        start = np.arange(len(points) + 1) * nodes.shape[1]
        return csr_array((values.ravel(), nodes.ravel(), start), shape=(len(points), len(self.mesh.nodes(order))))

    @cached_property
    def _locator(self) -> PointLocator:
        return PointLocator(self.mesh.points, self.mesh.cells)

    @cached_property
    def _embedding(self) -> Sparse:
        """Elements of order 1 in those of order 2: (n_2, n_1)."""
        n, edges = len(self.mesh.points), self.mesh.edges
        indptr = np.concatenate([np.arange(n), n + 2 * np.arange(len(edges) + 1)])
        data, indices = np.repeat([1.0, 0.5], [n, edges.size]), np.concatenate([np.arange(n), edges.ravel()])
        return csr_array((data, indices, indptr), shape=(n + len(edges), n))

    def _rule(self, degree: int) -> Any:
        """Quadrature on cells that is exact for polynomials of `degree`."""
        return mfem.IntRules.Get(self._mfem.space(1).geometry, degree)

    def _facet_rule(self, degree: int) -> Any:
        """Quadrature on facets that is exact for polynomials of `degree`."""
        shape = mfem.Geometry.SEGMENT if self.mesh.dim == 2 else mfem.Geometry.TRIANGLE
        return mfem.IntRules.Get(shape, degree)

    def _factor(self, weight: Array | None) -> tuple[Any, ...]:
        """Arguments of an integrator, whose coefficient the caller must keep: none without a weight."""
        return () if weight is None else (self._mfem.constants(weight),)

    def _components(self, nodes: IntArray) -> IntArray:
        """Canonical dof of each of MFEM's vector dofs."""
        return np.concatenate([axis * len(nodes) + nodes for axis in range(self.mesh.dim)])

    def _form(self, order: int, integrator: Any, degree: int) -> Sparse:
        """Form between equal scalar elements in MFEM's numbering, with every entry of the pattern."""
        form = mfem.BilinearForm(self._mfem.space(order).scalar)
        form.UsePrecomputedSparsity()
        integrator.SetIntRule(self._rule(degree))
        form.AddDomainIntegrator(integrator)
        return _finished(form, skip_zeros=0)

    def _scalar(self, order: int, integrator: Any, degree: int) -> Sparse:
        nodes = self._mfem.space(order).nodes
        return renumbered(self._form(order, integrator, degree), nodes, nodes)

    def _second(self, order: int, weight: Array | None) -> tuple[Pattern, Callable[[int, int], Array]]:
        """Pattern of the forms D_ij = ∫ ∂_i a ∂_j b, a the test function, and a function of (i, j) for their values."""
        known: dict[tuple[int, int], Array] = {}
        factor = self._factor(weight)
        for i in range(self.mesh.dim):
            for j in range(i, self.mesh.dim):
                tensor = mfem.DenseMatrix(self.mesh.dim, self.mesh.dim)
                tensor.Assign(0.0)
                tensor[i, j] = 1.0
                coefficient = constant = mfem.MatrixConstantCoefficient(tensor)
                if factor:
                    coefficient = mfem.ScalarMatrixProductCoefficient(*factor, constant)
                form = self._form(order, mfem.DiffusionIntegrator(coefficient), 2 * (order - 1))
                if order not in self._patterns:
                    self._patterns[order] = Pattern(form, self._mfem.space(order).nodes)
                known[i, j] = self._patterns[order].values(form)
        pattern = self._patterns[order]
        # D_ji is the transpose of D_ij.
        return pattern, lambda i, j: known[i, j] if i <= j else pattern.transpose(known[j, i])

    def _trace(self, order: int, role: str, axis: int, degree: int) -> Sparse:
        """∫ a b n_axis over the facets of `role`: (n, n)."""
        space, marker = self._mfem.space(order), self._mfem.marker(role)
        direction = mfem.VectorConstantCoefficient(mfem.Vector(np.eye(self.mesh.dim)[axis]))
        form = mfem.BilinearForm(space.scalar)
        # α ⟨(u·n) {a}, [b]⟩ + β ⟨|u·n| [a], [b]⟩ of discontinuous elements; on the boundary {a} is a/2 and [b] is b.
        integrator = mfem.DGTraceIntegrator(direction, 2.0, 0.0)
        integrator.SetIntRule(self._facet_rule(degree))
        form.AddBdrFaceIntegrator(integrator, marker)
        matrix = renumbered(_finished(form), space.nodes, space.nodes).tocoo()
        # Shape functions of the cell's other nodes vanish on the facet up to rounding only.
        there = np.zeros(matrix.shape[0], dtype=bool)
        there[self.mesh.boundary_nodes(role, order)] = True
        keep = there[matrix.row] & there[matrix.col]
        return csr_array((matrix.data[keep], (matrix.row[keep], matrix.col[keep])), shape=matrix.shape)


def _mixed(trial: Any, test: Any, integrator: Any, rule: Any) -> Sparse:
    """Form between two spaces in MFEM's numbering."""
    form = mfem.MixedBilinearForm(trial, test)
    integrator.SetIntRule(rule)
    form.AddDomainIntegrator(integrator)
    return _finished(form)


def _finished(form: Any, skip_zeros: int = 1) -> Sparse:
    form.Assemble(skip_zeros)
    form.Finalize(skip_zeros)
    return from_native(form.SpMat())
