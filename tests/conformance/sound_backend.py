"""A sound backend, scikit-fem's forms passed on, and how to declare one that is broken.

Nothing heavy is imported here: a backend's module must not load its library.
"""

import sys

from dacore.core.discretization import Assembler, Backend
from dacore.testing import backend_suite
from tests.conformance.mutants import Mutant

MUTANTS = []


def skfem(mesh):
    from dacore_skfem.backend import SkfemBackend

    return SkfemBackend().assembler(mesh)


class Delegate(Assembler):
    """scikit-fem's forms as they are."""

    def __init__(self, mesh):
        self.mesh, self.inner = mesh, skfem(mesh)

    def mass(self, order, weight=None):
        return self.inner.mass(order, weight)

    def stiffness(self, order, weight=None):
        return self.inner.stiffness(order, weight)

    def strain(self, order, weight=None):
        return self.inner.strain(order, weight)

    def divergence(self, order, weight=None):
        return self.inner.divergence(order, weight)

    def gradient_coupling(self, scalar, vector, weight=None):
        return self.inner.gradient_coupling(scalar, vector, weight)

    def divergence_coupling(self, vector, scalar, weight=None):
        return self.inner.divergence_coupling(vector, scalar, weight)

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
    """Declare a broken assembler, and a backend of its module that has it; or a broken backend."""

    def declare(cls):
        backend = cls
        if issubclass(cls, Assembler):
            name, module = f"{cls.__name__}Backend", cls.__module__
            members = {"name": "broken", "made": cls, "__module__": module, "__qualname__": name}
            backend = type(name, (Sound,), members)
            setattr(sys.modules[module], name, backend)
        # Some cannot be made the ordinary way, which is what is broken.
        MUTANTS.append(Mutant(cls.__name__, lambda: backend_suite(backend.__new__(backend)), (check, *also), says))
        return cls

    return declare
