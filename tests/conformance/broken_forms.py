"""Backends whose forms or evaluation are wrong in one way each."""

import numpy as np
from scipy.sparse import diags_array

from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient
from dacore.testing.meshes import with_points
from tests.conformance.sound_backend import Delegate, Sound, caught_by, skfem


@caught_by("gradient_coupling", "-1 times what it should be", also=("integrals_between_fields", "green"))
class WrongSign(Delegate):
    def gradient_coupling(self, scalar, vector):
        return -self.inner.gradient_coupling(scalar, vector)


@caught_by("gradient_coupling", "the derivative belongs on the scalar")
class TransposedCoupling(Delegate):
    def gradient_coupling(self, scalar, vector):
        return self.inner.divergence_coupling(vector, scalar).T


@caught_by("gradient_coupling", "integration by parts leaves a boundary term")
class ByParts(Delegate):
    def gradient_coupling(self, scalar, vector):
        return -self.inner.divergence_coupling(vector, scalar).T


@caught_by("divergence_coupling", "the derivative belongs on the vector")
class OtherTransposedCoupling(Delegate):
    def divergence_coupling(self, vector, scalar):
        return self.inner.gradient_coupling(scalar, vector).T


@caught_by(
    "canonical_matrices",
    r"it is transposed, rows belong to the test function(.|\n)*gradient coupling has shape \(\d+, \d+\), expected "
    r"\(\d+, \d+\)$",
    also=("gradient_coupling",),
)
class RowsOfTheTrialFunction(Delegate):
    def gradient_coupling(self, scalar, vector):
        return self.inner.gradient_coupling(scalar, vector).T


@caught_by("divergence_coupling", "component 1 of the vector is missing")
class CouplingWithoutAComponent(Delegate):
    def divergence_coupling(self, vector, scalar):
        made = self.inner.divergence_coupling(vector, scalar).toarray()
        count = len(self.mesh.nodes(vector))
        made[:, count : 2 * count] = 0.0
        return made


@caught_by("stiffness", "P2, .*likely cause: quadrature of too low order")
class GradientsAtTheMiddle(Delegate):
    def stiffness(self, order):
        gradients, volumes = barycentric_gradients(self.mesh.points, self.mesh.cells)
        middle = np.full(self.mesh.dim + 1, 1.0 / (self.mesh.dim + 1))
        slopes = np.einsum("ni,kid->knd", lagrange_gradient(order, middle), gradients)
        nodes = self.mesh.cell_nodes(order)
        out = np.zeros((len(self.mesh.nodes(order)),) * 2)
        np.add.at(out, (nodes[:, :, None], nodes[:, None, :]), np.einsum("k,knd,kmd->knm", volumes, slopes, slopes))
        return out


@caught_by("mass", r"\d+ of (\d+) entries differ, and \d+ are not zero where no cell contributes")
class EntriesBeyondTheCells(Delegate):
    def mass(self, order):
        return self.inner.mass(order).toarray() + 1e-3


@caught_by("strain", r"has shape .* likely cause: it is for one component, expected all of the vector")
class StrainOfOneComponent(Delegate):
    def strain(self, order):
        return self.inner.stiffness(order)


@caught_by(
    "evaluation_at_nodes", "assembler.mesh. is a int, expected an Assembler", also=("mass", "canonical_matrices")
)
class NoAssembler(Sound):
    name = "broken"

    def assembler(self, mesh):
        return 3


@caught_by("gradient_coupling", "shape")
class SwappedOrders(Delegate):
    def gradient_coupling(self, scalar, vector):
        return self.inner.gradient_coupling(vector, scalar)


@caught_by("gradient_coupling", "components are in reverse order")
class CouplingComponentsReversed(Delegate):
    def gradient_coupling(self, scalar, vector):
        made = self.inner.gradient_coupling(scalar, vector).toarray()
        return made.reshape(self.mesh.dim, -1, made.shape[1])[::-1].reshape(made.shape)


@caught_by("strain", "components are permuted|components are in reverse order")
class StrainComponentsPermuted(Delegate):
    def strain(self, order):
        matrix = self.inner.strain(order).toarray()
        turn = np.roll(np.arange(len(matrix)), len(self.mesh.nodes(order)))
        return matrix[np.ix_(turn, turn)]


@caught_by("strain", "dofs are ordered node by node")
class NodeByNode(Delegate):
    def strain(self, order):
        matrix = self.inner.strain(order).toarray()
        turn = np.arange(len(matrix)).reshape(self.mesh.dim, -1).T.ravel()
        return matrix[np.ix_(turn, turn)]


@caught_by("mass", "the same numbers stand in other places")
class EdgeNodesInAnotherOrder(Delegate):
    def mass(self, order):
        matrix = self.inner.mass(order).toarray()
        turn = np.arange(len(matrix))
        turn[len(self.mesh.points) :] = turn[len(self.mesh.points) :][::-1]
        return matrix[np.ix_(turn, turn)]


@caught_by("symmetric_and_positive", "unsymmetric by")
class UnsymmetricStiffness(Delegate):
    def stiffness(self, order):
        matrix = self.inner.stiffness(order).toarray()
        return matrix + 1e-7 * np.triu(matrix, 1)


@caught_by(
    "mass", "P2, .*entries differ.*likely cause: quadrature of too low order", also=("integrals_of_scalar_polynomials",)
)
class QuadratureTooLow(Delegate):
    def mass(self, order):
        dim = self.mesh.dim
        # Exact to degree 2, where P2 needs 4: the middles of the sides, or four points inside.
        a = 0.5 if dim == 2 else 0.5854101966249685
        b = 0.5 if dim == 2 else 0.1381966011250105
        points = np.full((dim + 1, dim + 1), b) + (a - b) * np.eye(dim + 1)
        if dim == 2:
            points = 0.5 * (1.0 - np.eye(3))
        values = lagrange(order, points)
        nodes, volumes = self.mesh.cell_nodes(order), barycentric_gradients(self.mesh.points, self.mesh.cells)[1]
        local = np.einsum("k,qa,qb->kab", volumes / (dim + 1), values, values)
        out = np.zeros((len(self.mesh.nodes(order)),) * 2)
        np.add.at(out, (nodes[:, :, None], nodes[:, None, :]), local)
        return out


@caught_by("boundary_mass", "P1, .*entries differ.*likely cause: quadrature of too low order")
class BoundaryQuadratureTooLow(Delegate):
    def boundary_mass(self, order, role):
        if order == 2:
            return self.inner.boundary_mass(order, role)
        out = np.zeros((len(self.mesh.points),) * 2)
        for facet in self.mesh.boundary_facets(role):
            edges = self.mesh.points[facet[1:]] - self.mesh.points[facet[0]]
            size = np.sqrt(np.linalg.det(edges @ edges.T)) / (self.mesh.dim - 1)
            out[np.ix_(facet, facet)] += size / self.mesh.dim**2
        return out


@caught_by("strain", "take the symmetric part of the gradient", also=("integrals_of_vector_polynomials", "kernels"))
class FullGradient(Delegate):
    def strain(self, order):
        return np.kron(np.eye(self.mesh.dim), self.inner.stiffness(order).toarray())


@caught_by("strain", "engineering strains")
class EngineeringShear(Delegate):
    def strain(self, order):
        # 4 ε:ε − 3 Σ ε_ii ε_ii, the latter from blocks of the two forms.
        strain, laplace = self.inner.strain(order).toarray(), self.inner.stiffness(order).toarray()
        out, n = 4.0 * strain, len(laplace)
        for i in range(self.mesh.dim):
            block = slice(i * n, (i + 1) * n)
            out[block, block] -= 3.0 * (2.0 * strain[block, block] - laplace)
        return out


@caught_by("strain", "2 times what it should be")
class TwiceTheStrain(Delegate):
    def strain(self, order):
        return 2.0 * self.inner.strain(order)


@caught_by("divergence", "component 1 of the vector is missing")
class DivergenceWithoutAComponent(Delegate):
    def divergence(self, order):
        matrix, n = self.inner.divergence(order).toarray(), len(self.mesh.nodes(order))
        matrix[n : 2 * n] = matrix[:, n : 2 * n] = 0.0
        return matrix


@caught_by("boundary_coupling", "the normal points inwards", also=("integrals_over_boundaries", "green"))
class InwardNormal(Delegate):
    def boundary_coupling(self, scalar, vector, role):
        return -self.inner.boundary_coupling(scalar, vector, role)


@caught_by("boundary_coupling", "the normal of the facet .* points inwards", also=("sums",))
class OneFacetTurned(Delegate):
    def boundary_coupling(self, scalar, vector, role):
        tags = np.ones(len(self.mesh.facets), dtype=int)
        tags[np.flatnonzero(self.mesh.facet_tags == self.mesh.roles[role])[-1]] = 2
        mesh = self.mesh
        one = skfem(Mesh(mesh.points, mesh.cells, mesh.facets, tags, {"rest": 1, "one": 2}))
        whole = self.inner.boundary_coupling(scalar, vector, role)
        return whole - 2.0 * one.boundary_coupling(scalar, vector, "one")


@caught_by("boundary_coupling", "over 'hole'.*the normal points inwards")
class NormalsAwayFromTheMiddle(Delegate):
    def boundary_coupling(self, scalar, vector, role):
        return (-1.0 if role == "hole" else 1.0) * self.inner.boundary_coupling(scalar, vector, role)


@caught_by("boundary_mass", "over the whole boundary", also=("sums",))
class WholeBoundary(Delegate):
    def boundary_mass(self, order, role):
        return sum(self.inner.boundary_mass(order, each) for each in self.mesh.roles)


@caught_by("boundary_mass", "it is over the role 'right'")
class WrongRole(Delegate):
    def boundary_mass(self, order, role):
        swapped = {"left": "right", "right": "left"}
        return self.inner.boundary_mass(order, swapped.get(role, role))


@caught_by("boundary_coupling", "it is over the role|entries differ")
class FacetsByPosition(Delegate):
    """Tags read in the order of another list of facets."""

    def __init__(self, mesh):
        super().__init__(Mesh(mesh.points, mesh.cells, mesh.facets, np.roll(mesh.facet_tags, 1), mesh.roles))


@caught_by("mass", "it is lumped", also=("integrals_of_scalar_polynomials",))
class Lumped(Delegate):
    def mass(self, order):
        return diags_array(self.inner.mass(order).sum(axis=1))


@caught_by("stiffness", "entries differ")
class OneAxisStretched(Delegate):
    def stiffness(self, order):
        stretched = self.mesh.points * np.where(np.arange(self.mesh.dim) == 1, 1.0 + 1e-9, 1.0)
        return skfem(with_points(self.mesh, stretched)).stiffness(order)


@caught_by("stiffness", "-1 times")
class NegativeLaplacian(Delegate):
    def stiffness(self, order):
        return -self.inner.stiffness(order)


@caught_by("kernels", "a rigid motion gives")
class StrainWithASpring(Delegate):
    def strain(self, order):
        mass = self.inner.mass(order).toarray()
        return self.inner.strain(order) + 1e-8 * np.kron(np.eye(self.mesh.dim), mass)


@caught_by("kernels", "its kernel has dimension")
class OneShearForgotten(Delegate):
    def strain(self, order):
        # (∂_0 a_1 + ∂_1 a_0)² is missing: that of a divergence, turned.
        matrix = self.inner.strain(order).toarray()
        divergence, n = self.inner.divergence(order).toarray(), len(self.mesh.nodes(order))
        out = np.zeros_like(matrix)
        for i in range(self.mesh.dim):
            block = slice(i * n, (i + 1) * n)
            out[block, block] = divergence[block, block]
        return out


@caught_by("values_at_points", "the nearest vertex")
class NearestVertex(Delegate):
    def evaluation(self, points, order, derivative):
        if derivative is not None:
            return self.inner.evaluation(points, order, derivative)
        distance = np.linalg.norm(points[:, None] - self.mesh.points[None], axis=2)
        return np.eye(len(self.mesh.nodes(order)))[distance.argmin(axis=1)]


@caught_by("derivatives_at_points", "derivative along axis 1")
class WrongAxis(Delegate):
    def evaluation(self, points, order, derivative):
        swapped = {0: 1, 1: 0}
        return self.inner.evaluation(points, order, swapped.get(derivative, derivative))


@caught_by("derivatives_at_points", "entries differ")
class AveragedDerivative(Delegate):
    def evaluation(self, points, order, derivative):
        if derivative is None:
            return self.inner.evaluation(points, order, derivative)
        # Halfway between the cells of the lowest and of the highest number that hold the point.
        turned = Mesh(
            self.mesh.points, self.mesh.cells[::-1], self.mesh.facets, self.mesh.facet_tags, self.mesh.roles
        )  # fmt: skip
        return (
            self.inner.evaluation(points, order, derivative) + skfem(turned).evaluation(points, order, derivative)
        ) / 2


@caught_by("derivatives_at_points", "entries differ")
class DerivativeOfTheLastCell(Delegate):
    def evaluation(self, points, order, derivative):
        mesh = self.mesh
        turned = Mesh(mesh.points, mesh.cells[::-1], mesh.facets, mesh.facet_tags, mesh.roles)
        return skfem(turned).evaluation(points, order, derivative)


@caught_by("evaluation_of_polynomials", "of a polynomial of degree 2")
class LinearInsideCells(Delegate):
    def evaluation(self, points, order, derivative):
        made = self.inner.evaluation(points, 1, derivative).toarray()
        return np.pad(made, ((0, 0), (0, len(self.mesh.nodes(order)) - made.shape[1])))


@caught_by("evaluation_at_nodes", "differs from the identity")
class EvaluationInAnotherOrder(Delegate):
    def evaluation(self, points, order, derivative):
        return self.inner.evaluation(points, order, derivative).toarray()[:, ::-1]


@caught_by("mass", "P2, .*entries differ")
class FirstOrderInPlaceOfSecond(Delegate):
    def mass(self, order):
        made = self.inner.mass(1).toarray()
        return np.pad(made, (0, len(self.mesh.nodes(order)) - len(made)))


@caught_by("mass", "entries differ.*likely cause: numbers of too few digits")
class SinglePrecision(Delegate):
    def mass(self, order):
        return self.inner.mass(order).astype(np.float32)


@caught_by("canonical_matrices", "NaN")
class NotANumber(Delegate):
    def divergence(self, order):
        made = self.inner.divergence(order)
        made.data[0] = np.nan
        return made


@caught_by("weighted_forms", "likely cause: the weight is left out", also=("weights_add_up",))
class WeightLeftOut(Delegate):
    def strain(self, order, weight=None):
        return self.inner.strain(order)


@caught_by("weighted_forms", r"divergence_coupling with a weight, vector P1, scalar P1, on the .*entries differ")
class WeightsOfOtherCells(Delegate):
    def divergence_coupling(self, vector, scalar, weight=None):
        return self.inner.divergence_coupling(vector, scalar, None if weight is None else weight[::-1].copy())


@caught_by("weighted_forms", "mass with a weight, P1, .*entries differ")
class WeightsMadeSmooth(Delegate):
    """A weight that is continuous: the mean of the cells at each vertex, and of the vertices on each cell."""

    def mass(self, order, weight=None):
        if weight is None:
            return self.inner.mass(order)
        cells = self.mesh.cells
        count = np.bincount(cells.ravel())
        mean = np.bincount(cells.ravel(), np.repeat(weight, cells.shape[1])) / count
        return self.inner.mass(order, mean[cells].mean(axis=1))


@caught_by(
    "weights_of_one", "stiffness with a weight of one, P1.*differs by", also=("weighted_forms", "weights_add_up")
)
class WeightOnTopOfTheForm(Delegate):
    def stiffness(self, order, weight=None):
        return self.inner.stiffness(order, None if weight is None else 1.0 + weight)


@caught_by("weights_add_up", "is something kept that belongs to another weight")
class KeepsTheFirstWeight(Delegate):
    def divergence(self, order, weight=None):
        kept = self.__dict__.setdefault("kept", {})
        return self.inner.divergence(order, None if weight is None else kept.setdefault(order, weight))


@caught_by(
    "weights_of_one", r"could not assemble strain with a weight \(TypeError",
    also=("weighted_forms", "weights_add_up"),
)  # fmt: skip
class KnowsNoWeights(Delegate):
    def strain(self, order):
        return self.inner.strain(order)
