"""A model without a mesh, a finite element or a second field: heat between the nodes of a ring of tanks."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, eye_array

from dacore.core.fields import Field, Layout
from dacore.core.model import Discretize, ForwardModel, Physics, Trajectory
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.core.space import StateSpace
from dacore.plugins import PluginSpec, hookimpl


class Tanks(StateSpace):
    def __init__(self, count):
        self._layout = Layout([Field("T", 1, unit="K")], {"T": count})

    layout = property(lambda self: self._layout)

    def scalar_product(self, field, kind="l2"):
        return csr_array(eye_array(self.layout.nodes[field]))


class RingModel(ForwardModel):
    def __init__(self, count):
        self._space = Tanks(count)

    space = property(lambda self: self._space)
    times = property(lambda self: np.linspace(0.25, 2.0, 8))
    parameters = property(
        lambda self: ParameterSpace((Parameter("rate", "1/s", 0.5, 2.0), Parameter("source", "K/s", 1.0, 3.0)))
    )

    def solve(self, parameters):
        n = self.space.n_dofs
        ring = np.roll(np.eye(n), 1, axis=0) + np.roll(np.eye(n), -1, axis=0) - 2 * np.eye(n)
        values, vectors = np.linalg.eigh(parameters["rate"] * ring - 0.1 * np.eye(n))
        push = vectors.T @ (parameters["source"] * (np.arange(n) == 0))
        states = vectors @ (push[:, None] * (np.expm1(np.outer(values, self.times)) / values[:, None]))
        # The last tank is connected late: its field is zero at the first steps of every case.
        states[:, :2] = 0.0
        return Trajectory(states, self.times)


@dataclass(frozen=True)
class Ring(Physics):
    count: int = 12

    def build(self, discretize: Discretize):
        return RingModel(self.count)


@dataclass(frozen=True)
class Thermometers(ObservationOperator):
    tanks: tuple[int, ...] = (1, 2, 3)

    def functionals(self, space):
        m = len(self.tanks)
        matrix = csr_array((np.ones(m), (np.arange(m), np.array(self.tanks))), shape=(m, space.n_dofs))
        labels = tuple(f"T{k}" for k in self.tanks)
        return Functionals(matrix, labels, "K", np.zeros((m, 1)), np.zeros((m, 1)), np.arange(m))


@dataclass(frozen=True)
class Tank(QuantityOfInterest):
    tank: int = 6
    over_time: Over = "each"

    def functionals(self, space):
        return Thermometers((self.tank,)).functionals(space)


def _spec(name, target):
    return [PluginSpec(name, f"tests.graph_plugin:{target}")]


@hookimpl
def dacore_models():
    return _spec("ring", "Ring")


@hookimpl
def dacore_observations():
    return _spec("thermometers", "Thermometers")


@hookimpl
def dacore_quantities():
    return _spec("tank", "Tank")
