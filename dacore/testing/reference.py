"""Every standard form once more: plain numpy, cell by cell, slow, and sharing no code with any backend.

Basis functions are found from the places of a cell's nodes alone, by solving for polynomials that are
one at one node and zero at the others; quadrature is Gauss–Legendre in collapsed coordinates.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.mesh import Mesh

# Exact to total degree 5 on tetrahedra: the highest integrand, P2 times P2, has degree 4.
GAUSS = 4


@dataclass(frozen=True, eq=False)
class Expected:
    """A matrix that was computed, and the size of the numbers that went into each entry.

    Parameters
    ----------
    matrix : (n, m) array
    scale : (n, m) array
        Sum over the cells (or facets) of the largest entry of the cell's matrix: rounding is a multiple
        of this number. Zero where no cell contributes.
    """

    matrix: Array
    scale: Array


def simplex_rule(dim: int) -> tuple[Array, Array]:
    """Points (q, dim) and weights (q,) on the unit simplex, exact to degree 5 (dim 3) or more."""
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    x, w = (x + 1.0) / 2.0, w / 2.0
    points = np.array(list(product(x, repeat=dim))).reshape(-1, dim)
    weights = np.prod(np.array(list(product(w, repeat=dim))).reshape(-1, dim), axis=1)
    # Duffy's map: x_k is what is left after the coordinates before it.
    out, left = np.empty_like(points), np.ones(len(points))
    for axis in range(dim):
        out[:, axis] = left * points[:, axis]
        weights = weights * left
        left = left - out[:, axis]
    return out, weights


class Patch:
    """Quadrature points in cells, and the basis functions there.

    Parameters
    ----------
    mesh : Mesh
    cells : (k,) int array
        Numbers of cells, one for each row of points.
    points : (k, q, d) array [cm]
        In the cell or on its boundary.
    weights : (k, q) array
    normals : (k, d) array
        Of the facets; zeros for cells.
    """

    def __init__(self, mesh: Mesh, cells: IntArray, points: Array, weights: Array, normals: Array) -> None:
        self.mesh, self.cells, self.weights, self.normals = mesh, cells, weights, normals
        corner = mesh.points[mesh.cells[cells]]
        self._origin = corner[:, 0]
        self._inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
        self._local = self._to_local(points)

    def _to_local(self, points: Array) -> Array:
        return np.asarray(np.einsum("kij,kqj->kqi", self._inverse, points - self._origin[:, None]))

    def nodes(self, order: int) -> IntArray:
        """Node numbers (k, n_local)."""
        return np.asarray(self.mesh.cell_nodes(order)[self.cells])

    def _coefficients(self, order: int) -> Array:
        places = self._to_local(self.mesh.nodes(order)[self.nodes(order)])
        return np.asarray(np.linalg.inv(_monomials(order, places)), dtype=np.float64)

    def values(self, order: int) -> Array:
        """Basis functions (k, q, n_local)."""
        return np.asarray(_monomials(order, self._local) @ self._coefficients(order))

    def gradients(self, order: int) -> Array:
        """Gradients (k, q, n_local, d)."""
        coefficients = self._coefficients(order)
        local = np.stack([slope @ coefficients for slope in _monomial_slopes(order, self._local)], axis=-1)
        return np.asarray(np.einsum("kqai,kij->kqaj", local, self._inverse))


def _exponents(order: int, dim: int) -> IntArray:
    return np.array([e for e in product(range(order + 1), repeat=dim) if sum(e) <= order])


def _monomials(order: int, x: Array) -> Array:
    return np.asarray(np.prod(x[..., None, :] ** _exponents(order, x.shape[-1]), axis=-1))


def _monomial_slopes(order: int, x: Array) -> list[Array]:
    powers = _exponents(order, x.shape[-1])
    out = []
    for axis in range(x.shape[-1]):
        lowered = powers.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        out.append(powers[:, axis] * np.prod(x[..., None, :] ** lowered, axis=-1))
    return out


class Reference:
    """The forms on one mesh, dense. Same names, arguments and order of dofs as `Assembler`.

    Parameters
    ----------
    mesh : Mesh
    weight : (c,) array, optional
        Factor of the integrand on each cell, of all forms over cells.
    """

    def __init__(self, mesh: Mesh, weight: Array | None = None) -> None:
        self.mesh = mesh
        self._weight = np.ones(len(mesh.cells)) if weight is None else weight

    @cached_property
    def _volume(self) -> Patch:
        points, weights = simplex_rule(self.mesh.dim)
        corner = self.mesh.points[self.mesh.cells]
        edges = corner[:, 1:] - corner[:, :1]
        where = corner[:, :1] + np.einsum("qi,kid->kqd", points, edges)
        size = np.abs(np.linalg.det(edges)) * self._weight
        cells = np.arange(len(corner))
        return Patch(self.mesh, cells, where, size[:, None] * weights, np.zeros((len(cells), self.mesh.dim)))

    def surface(self, role: str, only: int | None = None) -> Patch:
        """Quadrature on the facets of a role (or one of them), with outward unit normals."""
        mesh, dim = self.mesh, self.mesh.dim
        owners: dict[frozenset[int], list[tuple[int, int]]] = {}
        for number, cell in enumerate(mesh.cells.tolist()):
            for vertex in cell:
                owners.setdefault(frozenset(cell) - {vertex}, []).append((number, vertex))
        cells, opposite = [], []
        facets = mesh.facets[mesh.facet_tags == mesh.roles[role]]
        facets = facets if only is None else facets[[only]]
        for facet in facets.tolist():
            ((number, vertex),) = owners[frozenset(facet)]
            cells.append(number)
            opposite.append(vertex)
        corner = mesh.points[facets]
        edges = corner[:, 1:] - corner[:, :1]
        if dim == 2:
            normals = np.stack([edges[:, 0, 1], -edges[:, 0, 0]], axis=1)
        else:
            normals = np.cross(edges[:, 0], edges[:, 1])
        inward = mesh.points[opposite] - corner[:, 0]
        normals *= -np.sign(np.einsum("kd,kd->k", normals, inward))[:, None]
        size = np.linalg.norm(normals, axis=1)
        points, weights = simplex_rule(dim - 1)
        where = corner[:, :1] + np.einsum("qi,kid->kqd", points, edges)
        return Patch(mesh, np.array(cells), where, size[:, None] * weights, normals / size[:, None])

    def mass(self, order: int) -> Expected:
        """∫ a b."""
        return self._product(self._volume, order)

    def stiffness(self, order: int) -> Expected:
        """∫ ∇a·∇b."""
        patch = self._volume
        g = patch.gradients(order)
        local = np.einsum("kq,kqad,kqbd->kab", patch.weights, g, g, optimize=True)
        return self._scatter(local, self._rows(patch, order, 1), self._rows(patch, order, 1), (order, 1), (order, 1))

    def strain(self, order: int) -> Expected:
        """∫ ε(a):ε(b)."""
        patch = self._volume
        g = patch.gradients(order)
        # Gradient of basis function a times unit vector i: row i of the Jacobian; then its symmetric part.
        jacobian = np.einsum("kqad,im->kqiamd", g, np.eye(self.mesh.dim))
        shape = (*jacobian.shape[:2], -1, self.mesh.dim**2)
        symmetric = ((jacobian + np.swapaxes(jacobian, -1, -2)) / 2.0).reshape(shape)
        local = np.einsum("kq,kqam,kqbm->kab", patch.weights, symmetric, symmetric, optimize=True)
        return self._vector_square(patch, local, order)

    def gradient_product(self, order: int) -> Expected:
        """∫ ∇a:∇b of vectors: what a strain would be without taking the symmetric part."""
        one = self.stiffness(order)
        eye = np.eye(self.mesh.dim)
        return Expected(np.asarray(np.kron(eye, one.matrix)), np.asarray(np.kron(eye, one.scale)))

    def divergence(self, order: int) -> Expected:
        """∫ (∇·a)(∇·b)."""
        patch = self._volume
        g = patch.gradients(order)
        div = np.moveaxis(g, 3, 2).reshape(*g.shape[:2], -1)
        local = np.einsum("kq,kqa,kqb->kab", patch.weights, div, div, optimize=True)
        return self._vector_square(patch, local, order)

    def gradient_coupling(self, scalar: int, vector: int) -> Expected:
        """∫ ∇p·v, v the test function."""
        patch = self._volume
        local = np.einsum(
            "kq,kqa,kqbi->kiab", patch.weights, patch.values(vector), patch.gradients(scalar), optimize=True
        )
        return self._tall(patch, local, vector, scalar)

    def divergence_coupling(self, vector: int, scalar: int) -> Expected:
        """∫ q ∇·u, q the test function."""
        patch = self._volume
        local = np.einsum(
            "kq,kqa,kqbi->kiba", patch.weights, patch.values(scalar), patch.gradients(vector), optimize=True
        )
        tall = self._tall(patch, local, vector, scalar)
        return Expected(tall.matrix.T, tall.scale.T)

    def boundary_mass(self, order: int, role: str) -> Expected:
        """∫ a b over a role."""
        return self._product(self.surface(role), order)

    def boundary_coupling(self, scalar: int, vector: int, role: str, only: int | None = None) -> Expected:
        """∫ p v·n over a role (or one of its facets), v the test function."""
        patch = self.surface(role, only)
        values = patch.values(vector), patch.values(scalar)
        local = np.einsum("kq,kqa,kqb,ki->kiab", patch.weights, *values, patch.normals, optimize=True)
        return self._tall(patch, local, vector, scalar)

    def evaluation(self, points: Array, order: int, derivative: int | None) -> Expected:
        """Values or a derivative at points (p, d), each taken from the lowest-numbered cell that holds it."""
        corner = self.mesh.points[self.mesh.cells]
        inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
        local = np.einsum("kij,kpj->pki", inverse, points[None] - corner[:, :1])
        lowest = np.minimum(local.min(axis=2), 1.0 - local.sum(axis=2))
        cell = np.argmax(lowest > -1e-10, axis=1)
        patch = Patch(self.mesh, cell, points[:, None], np.ones((len(points), 1)), np.zeros_like(points))
        rows = patch.values(order)[:, 0] if derivative is None else patch.gradients(order)[:, 0, :, derivative]
        scale = np.abs(rows) if derivative is None else np.linalg.norm(patch.gradients(order)[:, 0], axis=2)
        out = np.zeros((2, len(points), len(self.mesh.nodes(order))))
        where = np.arange(len(points))[:, None], patch.nodes(order)
        out[0][where] = rows
        out[1][where] = scale.max(axis=1, keepdims=True)
        return Expected(out[0], out[1])

    def _product(self, patch: Patch, order: int) -> Expected:
        values = patch.values(order)
        local = np.einsum("kq,kqa,kqb->kab", patch.weights, values, values, optimize=True)
        return self._scatter(local, self._rows(patch, order, 1), self._rows(patch, order, 1), (order, 1), (order, 1))

    def _vector_square(self, patch: Patch, local: Array, order: int) -> Expected:
        rows = self._rows(patch, order, self.mesh.dim)
        return self._scatter(local, rows, rows, (order, self.mesh.dim), (order, self.mesh.dim))

    def _tall(self, patch: Patch, local: Array, vector: int, scalar: int) -> Expected:
        flat = local.reshape(len(local), -1, local.shape[-1])
        rows, columns = self._rows(patch, vector, self.mesh.dim), self._rows(patch, scalar, 1)
        return self._scatter(flat, rows, columns, (vector, self.mesh.dim), (scalar, 1))

    def _rows(self, patch: Patch, order: int, components: int) -> IntArray:
        """Dofs (k, components · n_local) of each cell."""
        nodes, count = patch.nodes(order), len(self.mesh.nodes(order))
        return np.concatenate([nodes + c * count for c in range(components)], axis=1)

    def _scatter(
        self, local: Array, rows: IntArray, columns: IntArray, tall: tuple[int, int], wide: tuple[int, int]
    ) -> Expected:
        shape = tuple(components * len(self.mesh.nodes(order)) for order, components in (tall, wide))
        out = np.zeros((2, *shape))
        where = rows[:, :, None], columns[:, None, :]
        np.add.at(out[0], where, local)
        np.add.at(out[1], where, np.broadcast_to(np.abs(local).max(axis=(1, 2), keepdims=True), local.shape))
        return Expected(out[0], out[1])
