"""State spaces and domains that are wrong in one way each."""

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, eye_array

from dacore.core.domain import Domain
from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field, Layout
from dacore.errors import CapabilityError, ShapeError
from dacore.testing import domain_suite, space_suite
from dacore.testing.meshes import shuffled_box
from dacore.testing.spaces import ReferenceBackend
from tests.conformance.mutants import Mutant

MUTANTS = []


class Sound(FiniteElementSpace):
    """Elements on a small square."""

    def __init__(self):
        fields = [Field("u", 2, 2, "cm"), Field("p", 1)]
        super().__init__(ReferenceBackend().discretize(shuffled_box(2, 2), fields))

    def __reduce__(self):
        return type(self), ()


def suite_of(cls):
    return domain_suite(cls()) if issubclass(cls, Domain) else space_suite(cls, ["left", "side"])


def caught_by(check, says="", also=()):
    def declare(cls):
        MUTANTS.append(Mutant(cls.__name__, lambda: suite_of(cls), (check, *also), says))
        return cls

    return declare


@caught_by("layout_stays", "layout changes from call to call")
class LayoutChanges(Sound):
    count = 0

    @property
    def layout(self):
        self.count += 1
        whole = self.discretization.layout
        return Layout(whole.fields[:: 1 if self.count % 2 else -1], whole.nodes)


@caught_by("products_are_inner_products", "unsymmetric by")
class Unsymmetric(Sound):
    def scalar_product(self, field, kind="l2"):
        made = super().scalar_product(field, kind).toarray()
        return csr_array(made + 1e-9 * np.triu(made, 1))


@caught_by("products_are_inner_products", "has the eigenvalue")
class Singular(Sound):
    def scalar_product(self, field, kind="l2"):
        made = super().scalar_product(field, kind).toarray()
        made[0] = made[:, 0] = 0.0
        return csr_array(made)


@caught_by("products_are_inner_products", "the h1 product of u is below l2")
class StiffnessForGotten(Sound):
    def scalar_product(self, field, kind="l2"):
        return csr_array((0.5 if kind == "h1" else 1.0) * super().scalar_product(field, "l2"))


@caught_by("products_stay", "changes from call to call")
class ProductDrifts(Sound):
    calls = 0

    def scalar_product(self, field, kind="l2"):
        self.calls += 1
        return super().scalar_product(field, kind) * (1.0 + 1e-12 * self.calls)


@caught_by("products_of_fields", "from the weighted products of the fields")
class WeightsSquared(Sound):
    def inner_product(self, weights, kind="l2"):
        return super().inner_product({name: value**2 for name, value in weights.items()}, kind)


@caught_by("wrong_questions_are_refused", "raises nothing, expected Exception")
class AnyField(Sound):
    def scalar_product(self, field, kind="l2"):
        return super().scalar_product(field if field == "u" else "p", kind)


@caught_by("capabilities_are_kept", "no points after all")
class ClaimsTooMuch(Sound):
    def evaluation(self, points, field, derivative=None):
        raise CapabilityError("no points after all")


@caught_by("cells_hold_the_fields", "local node 0 is not at vertex 0")
class LocalNodesTurned(Sound):
    def cells(self):
        made = super().cells()
        return replace(made, nodes={name: np.roll(nodes, 1, axis=1) for name, nodes in made.nodes.items()})


@caught_by("cells_hold_the_fields", "have order 1, the field has 2")
class OrderOfTheMesh(Sound):
    def cells(self):
        made = super().cells()
        return replace(made, orders=dict.fromkeys(made.orders, 1))


@caught_by("evaluation_is_that_of_the_cells", "differs by")
class PointByPoint(Sound):
    """Rows point · c + component."""

    def evaluation(self, points, field, derivative=None):
        made = super().evaluation(points, field, derivative).toarray()
        components = self.layout.field(field).components
        return csr_array(made.reshape(components, len(points), -1).swapaxes(0, 1).reshape(made.shape))


@caught_by("derivatives_are_slopes", "along axis 0 is off")
class DerivativeOfTheOtherAxis(Sound):
    def evaluation(self, points, field, derivative=None):
        return super().evaluation(points, field, None if derivative is None else 1 - derivative)


@caught_by("points_outside_are_named", "raises nothing")
class OutsideIsNearest(Sound):
    def evaluation(self, points, field, derivative=None):
        try:
            return super().evaluation(points, field, derivative)
        except ShapeError:
            return csr_array((len(points) * self.layout.field(field).components, self.n_dofs))


@caught_by("means_over_boundaries", "component 0 being 1")
class IntegralInPlaceOfMean(Sound):
    def boundary_mean(self, role, field):
        return 2.0 * super().boundary_mean(role, field)


@caught_by("means_over_boundaries", "a role that is not there")
class AnyRole(Sound):
    def boundary_mean(self, role, field):
        return super().boundary_mean(role if role in ("left", "side") else "left", field)


@caught_by("spaces_can_be_pickled", "differs after pickling")
class ForgetsItsScale(Sound):
    scale = 1.0

    def __init__(self):
        super().__init__()
        self.scale = 2.0

    def __reduce__(self):
        return Sound, ()

    def scalar_product(self, field, kind="l2"):
        return self.scale * super().scalar_product(field, kind)


@dataclass(frozen=True)
class SoundDomain(Domain):
    def mesh(self):
        return shuffled_box(2, 2)


@caught_by("the_same_mesh_again", "is there a random number")
@dataclass(frozen=True)
class RandomMesh(Domain):
    def mesh(self):
        return shuffled_box(2, 2, seed=int(np.random.default_rng().integers(2**31)))


@caught_by("no_global_randomness", "depends on numpy's global random numbers")
@dataclass(frozen=True)
class GlobalRandomness(Domain):
    def mesh(self):
        return shuffled_box(2, 2, seed=int(np.random.randint(1000)))  # noqa: NPY002


@caught_by("no_global_randomness", "draws from numpy's global random numbers")
@dataclass(frozen=True)
class MovesGlobalRandomness(Domain):
    def mesh(self):
        np.random.random()  # noqa: NPY002
        return shuffled_box(2, 2)


@caught_by("fingerprints_stay", "when asked again")
@dataclass(frozen=True)
class FingerprintOfTheTime(Domain):
    def mesh(self):
        return shuffled_box(2, 2)

    def fingerprint(self):
        return str(time.perf_counter_ns())


@caught_by("makes_a_mesh", "makes a csr_array|makes a dia_array|expected Mesh")
@dataclass(frozen=True)
class NoMesh(Domain):
    def mesh(self):
        return eye_array(3)
