"""Backends that misbehave in one way each: what they keep, share, change, print, or depend on."""

import os

import numpy as np
from scipy.sparse import csr_array, vstack

from dacore.core.simplex import barycentric_gradients, lagrange
from dacore.errors import ShapeError
from dacore.geometry.locate import PointLocator
from dacore.testing.meshes import with_points
from tests.conformance.sound_backend import Delegate, Sound, caught_by, skfem


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
        made.inner.mass = lambda order, weight=None: scale * inner(order, weight)
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
