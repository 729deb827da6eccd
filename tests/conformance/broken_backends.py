"""Backends that are wrong in one way each: scikit-fem's forms, changed.

Nothing heavy is imported here: a backend's module must not load its library.
"""

import os

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from dacore.core.discretization import Assembler, Backend
from dacore.core.mesh import Mesh
from dacore.core.simplex import barycentric_gradients, lagrange
from dacore.errors import ShapeError
from dacore.geometry.locate import PointLocator
from dacore.testing.meshes import with_points

# Name of the backend class: the checks that must find it, and a pattern of what they say.
MUTANTS = {}


def skfem(mesh):
    from dacore_skfem.backend import SkfemBackend

    return SkfemBackend().assembler(mesh)


class Delegate(Assembler):
    """scikit-fem's forms as they are."""

    def __init__(self, mesh):
        self.mesh, self.inner = mesh, skfem(mesh)

    def mass(self, order):
        return self.inner.mass(order)

    def stiffness(self, order):
        return self.inner.stiffness(order)

    def strain(self, order):
        return self.inner.strain(order)

    def divergence(self, order):
        return self.inner.divergence(order)

    def gradient_coupling(self, scalar, vector):
        return self.inner.gradient_coupling(scalar, vector)

    def divergence_coupling(self, vector, scalar):
        return self.inner.divergence_coupling(vector, scalar)

    def boundary_mass(self, order, role):
        return self.inner.boundary_mass(order, role)

    def boundary_coupling(self, scalar, vector, role):
        return self.inner.boundary_coupling(scalar, vector, role)

    def evaluation(self, points, order, derivative):
        return self.inner.evaluation(points, order, derivative)


class Sound(Backend):
    """What all mutants are before they are broken."""

    name = "sound"
    made = Delegate

    def assembler(self, mesh):
        return self.made(mesh)

    def version(self):
        return "1.0"


def caught_by(check, says="", also=()):
    """Declare a broken assembler, and a backend of the module that has it; or a broken backend."""

    def declare(cls):
        backend = cls
        if issubclass(cls, Assembler):
            name = f"{cls.__name__}Backend"
            backend = type(
                name, (Sound,), {"name": "broken", "made": cls, "__module__": __name__, "__qualname__": name}
            )
            globals()[name] = backend
        MUTANTS[backend.__name__] = ((check, *also), says)
        return cls

    return declare


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


@caught_by("canonical_matrices", "gradient coupling has shape")
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


@caught_by("mass", "P2, .*entries differ", also=("integrals_of_scalar_polynomials",))
class QuadratureTooLow(Delegate):
    def mass(self, order):
        dim = self.mesh.dim
        # Exact to degree 2, where P2 needs 4: the middles of the sides, or four points inside.
        a = 0.5 if dim == 2 else 0.58541020
        b = 0.5 if dim == 2 else 0.13819660
        points = np.full((dim + 1, dim + 1), b) + (a - b) * np.eye(dim + 1)
        if dim == 2:
            points = 0.5 * (1.0 - np.eye(3))
        values = lagrange(order, points)
        nodes, volumes = self.mesh.cell_nodes(order), barycentric_gradients(self.mesh.points, self.mesh.cells)[1]
        local = np.einsum("k,qa,qb->kab", volumes / (dim + 1), values, values)
        out = np.zeros((len(self.mesh.nodes(order)),) * 2)
        np.add.at(out, (nodes[:, :, None], nodes[:, None, :]), local)
        return out


@caught_by("boundary_mass", "P1, .*entries differ")
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


@caught_by("boundary_coupling", "entries differ", also=("sums",))
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


@caught_by("mass", "entries differ")
class SinglePrecision(Delegate):
    def mass(self, order):
        return self.inner.mass(order).astype(np.float32)


@caught_by("canonical_matrices", "NaN")
class NotANumber(Delegate):
    def divergence(self, order):
        made = self.inner.divergence(order)
        made.data[0] = np.nan
        return made


@caught_by("nothing_is_assembled_too_early", "assembles mass, stiffness on being made")
class Eager(Delegate):
    def __init__(self, mesh):
        super().__init__(mesh)
        self.kept = self.mass(1), self.stiffness(1)


@caught_by("nothing_is_assembled_too_early", "overrides discretize")
class EagerDiscretize(Sound):
    def discretize(self, mesh, fields):
        made = super().discretize(mesh, fields)
        made.scalar_mass(fields[0].name)
        return made


@caught_by("forms_share_no_memory", "share the memory of their indices")
class SharedIndices(Delegate):
    def __init__(self, mesh):
        super().__init__(mesh)
        self.pattern = {}

    def mass(self, order):
        self.pattern[order] = csr_array(np.ones((len(self.mesh.nodes(order)),) * 2))
        return self._fill(self.inner.mass(order), order)

    def stiffness(self, order):
        if order not in self.pattern:
            self.mass(order)
        return self._fill(self.inner.stiffness(order), order)

    def _fill(self, made, order):
        pattern = self.pattern[order]
        return csr_array((made.toarray().ravel(), pattern.indices, pattern.indptr), shape=pattern.shape)


@caught_by("forms_share_no_memory", "changes when forms that were returned earlier are overwritten")
class KeptAndReturned(Delegate):
    def divergence(self, order):
        if not hasattr(self, "kept"):
            self.kept = {}
        if order not in self.kept:
            self.kept[order] = self.inner.divergence(order)
        return self.kept[order]

    def strain(self, order):
        return self.inner.strain(order) + (self.divergence(order) - self.inner.divergence(order))


@caught_by("meshes_do_not_disturb_each_other", "what is kept must belong to one mesh")
class LastMeshWins(Delegate):
    current = None

    def __init__(self, mesh):
        super().__init__(mesh)
        type(self).current = self.inner

    def mass(self, order):
        made = self.inner.mass(order)
        return made if self.current is self.inner else 2.0 * made


@caught_by("forms_are_kept", "strain is another matrix each time")
class AssemblesEachTime(Sound):
    name = "broken"

    def discretize(self, mesh, fields):
        class Sieve(dict):
            def __contains__(self, key):
                return False

        made = super().discretize(mesh, fields)
        made._forms = Sieve()
        return made


@caught_by("the_same_again", "when made again the same way")
class Noisy(Delegate):
    def stiffness(self, order):
        made = self.inner.stiffness(order)
        made.data *= 1.0 + 1e-13 * np.random.default_rng().standard_normal(made.data.shape)
        return made


@caught_by("the_same_again", "when forms are asked for backwards")
class RemembersWhatWasAsked(Delegate):
    asked = 0.0

    def mass(self, order):
        return self.inner.mass(order) * (1.0 + self.asked)

    def strain(self, order):
        self.asked = 1e-12
        return self.inner.strain(order)


@caught_by("can_be_pickled", "cannot be pickled")
class Unpicklable(Sound):
    name = "broken"

    def __reduce__(self):
        raise TypeError("holds a handle of the library")


@caught_by("survives_pickling", "entries|different after pickling")
class ForgetsInPickling(Sound):
    name = "broken"
    scale = 1.0

    def __setstate__(self, state):
        self.scale = 2.0

    def __getstate__(self):
        return {"scale": self.scale}

    def assembler(self, mesh):
        made = Delegate(mesh)
        inner, scale = made.inner.mass, self.scale
        made.inner.mass = lambda order: scale * inner(order)
        return made


@caught_by("made_without_arguments", "keeps used")
class KeepsState(Sound):
    name = "broken"

    def version(self):
        self.used = True
        return "1.0"


@caught_by("made_without_arguments", "cannot be made without arguments")
class NeedsArguments(Sound):
    name = "broken"

    def __init__(self, degree):
        pass


@caught_by("inputs_stay_as_they_are", "changes mesh.cells")
class SortsTheCells(Delegate):
    def mass(self, order):
        made = self.inner.mass(order)
        self.mesh.cells.flags.writeable = True
        self.mesh.cells.sort(axis=1)
        self.mesh.cells.flags.writeable = False
        return made


@caught_by("inputs_stay_as_they_are", "makes mesh.points writeable")
class UnlocksThePoints(Delegate):
    def mass(self, order):
        self.mesh.points.flags.writeable = True
        return self.inner.mass(order)


@caught_by("inputs_stay_as_they_are", "read-only")
class NeedsWriteablePoints(Delegate):
    def evaluation(self, points, order, derivative):
        points += 0.0
        return self.inner.evaluation(points, order, derivative)


@caught_by("any_memory_order", "stored by columns|entries differ")
class ReadsMemoryAsItLies(Delegate):
    def mass(self, order):
        lying = np.frombuffer(self.mesh.points.tobytes(order="A")).reshape(self.mesh.points.shape)
        volumes = np.abs(barycentric_gradients(lying, self.mesh.cells)[1])
        return self.inner.mass(order) * (volumes.sum() / self.mesh.volumes.sum())


@caught_by("any_tags", "tags of the roles are")
class PositiveTagsOnly(Delegate):
    def boundary_mass(self, order, role):
        return (self.mesh.roles[role] > 0) * self.inner.boundary_mass(order, role)


@caught_by("any_tags", "tags of the roles are|there is no")
class OneRoleATag(Delegate):
    def boundary_mass(self, order, role):
        names = {tag: name for name, tag in self.mesh.roles.items()}
        if role not in names.values():
            raise ShapeError(f"there is no {role}")
        return self.inner.boundary_mass(order, role)


@caught_by("lengths_may_be_small", "is there an absolute tolerance")
class DropsSmallEntries(Delegate):
    def boundary_coupling(self, scalar, vector, role):
        made = self.inner.boundary_coupling(scalar, vector, role).toarray()
        return np.where(np.abs(made) > 1e-10, made, 0.0)


@caught_by("the_origin_may_be_elsewhere", "the mesh is moved")
class FarFromTheOriginInexact(Delegate):
    def mass(self, order):
        # Cofactors from the points themselves, in single precision.
        single = self.mesh.points.astype(np.float32).astype(np.float64)
        far = np.abs(self.mesh.points).max() > 10
        return (skfem(with_points(self.mesh, single)) if far else self.inner).mass(order)


@caught_by("points_outside", "raises nothing")
class OutsideIsZero(Delegate):
    def evaluation(self, points, order, derivative):
        cell, _ = PointLocator(self.mesh.points, self.mesh.cells).locate(points, outside="mark")
        inside = np.flatnonzero(cell >= 0)
        out = np.zeros((len(points), len(self.mesh.nodes(order))))
        out[inside] = self.inner.evaluation(points[inside], order, derivative).toarray()
        return out


@caught_by("points_outside", "beside the boundary .* raises nothing")
class WideTolerance(Delegate):
    def evaluation(self, points, order, derivative):
        cell, barycentric = PointLocator(self.mesh.points, self.mesh.cells, 1e-9).locate(points, outside="mark")
        near, other = PointLocator(self.mesh.points, self.mesh.cells, 0.2).locate(points, outside="mark")
        if (near >= 0).all() and derivative is None:
            chosen = np.where((cell < 0)[:, None], other, barycentric)
            out = np.zeros((len(points), len(self.mesh.nodes(order))))
            nodes = self.mesh.cell_nodes(order)[np.where(cell < 0, near, cell)]
            np.put_along_axis(out, nodes, lagrange(order, chosen), axis=1)
            return out
        return self.inner.evaluation(points, order, derivative)


@caught_by("points_outside", "RuntimeError.*expected ShapeError")
class OutsideIsAnotherError(Delegate):
    def evaluation(self, points, order, derivative):
        try:
            return self.inner.evaluation(points, order, derivative)
        except ShapeError as error:
            raise RuntimeError("point not found") from error


@caught_by("points_outside", "expected it to say that point 3 lies outside")
class OutsideIsNotNamed(Delegate):
    def evaluation(self, points, order, derivative):
        try:
            return self.inner.evaluation(points, order, derivative)
        except ShapeError as error:
            raise ShapeError("some points lie outside the mesh") from error


@caught_by("no_points", "")
class NoPointsFail(Delegate):
    def evaluation(self, points, order, derivative):
        return vstack([self.inner.evaluation(point[None], order, derivative) for point in points])


@caught_by("writes_nothing", "orientation fixed")
class Prints(Delegate):
    def mass(self, order):
        print("orientation fixed")
        return self.inner.mass(order)


@caught_by("writes_nothing", "compiled code says so")
class PrintsBelowPython(Delegate):
    def boundary_mass(self, order, role):
        os.write(1, b"compiled code says so\n")
        return self.inner.boundary_mass(order, role)


@caught_by("tells_its_version", "version")
class NoVersion(Sound):
    name = "broken"

    def version(self):
        return ""


@caught_by("named_as_declared", "which is the declared name of dacore_skfem")
class TakesAnotherName(Sound):
    name = "skfem"


@caught_by("named_as_declared", "expected an identifier")
class NoName(Sound):
    name = ""
