"""A plugin as a stranger writes it: an observation, a quantity, a model of its own kind, declarations."""

from dataclasses import dataclass
from typing import ClassVar, reveal_type

import numpy as np

from dacore.core.arrays import Array, Sparse
from dacore.core.fields import Field, Layout
from dacore.core.model import Discretize, ForwardModel, Physics, Trajectory
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.parameters import Parameter, Parameters, ParameterSpace
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.core.space import Product, StateSpace
from dacore.errors import ShapeError
from dacore.plugins import PluginSpec, hookimpl


@hookimpl
def dacore_observations() -> list[PluginSpec]:
    """Declare the gauge."""
    return [PluginSpec("gauge", "user_plugin:Gauge", summary="some entries of a field")]


@hookimpl
def dacore_models() -> list[PluginSpec]:
    """Declare the decay."""
    return [PluginSpec("decay", "user_plugin:Decay", summary="everything decays")]


@dataclass(frozen=True)
class Gauge(ObservationOperator):
    """Entries of a field."""

    needs: ClassVar[frozenset[str]] = frozenset({"points"})

    positions: tuple[tuple[float, ...], ...]
    field: str = "T"

    def __post_init__(self) -> None:
        if not self.positions:
            raise ShapeError("gauge: got no position, expected at least one")

    def functionals(self, space: StateSpace) -> Functionals:
        """Values of the field at the positions."""
        self.check(space)
        points = np.array(self.positions)
        unit = space.layout.field(self.field).unit
        labels = tuple(f"gauge {k + 1}" for k in range(len(points)))
        return Functionals(
            space.evaluation(points, self.field), labels, unit, points, np.zeros_like(points), np.arange(len(points))
        )


@dataclass(frozen=True)
class Largest(QuantityOfInterest):
    """Mean of the field."""

    over_time: Over = "each"

    def functionals(self, space: StateSpace) -> Functionals:
        """One functional."""
        return Gauge(((0.0,),)).functionals(space)


class Line(StateSpace):
    """Values on a line, in an inner product that somebody gives."""

    def __init__(self, product: Sparse) -> None:
        self.product = product

    @property
    def layout(self) -> Layout:
        """One field."""
        return Layout((Field("T", 1, unit="K"),), {"T": 4})

    def scalar_product(self, field: str, kind: Product = "l2") -> Sparse:
        """The one given."""
        return self.product


class Decaying(ForwardModel):
    """Exponential decay."""

    def __init__(self, space: Line) -> None:
        self._space = space

    @property
    def space(self) -> StateSpace:
        """A line."""
        return self._space

    @property
    def parameters(self) -> ParameterSpace:
        """The rate."""
        return ParameterSpace((Parameter("rate", "1/s", 1.0, 2.0),))

    @property
    def times(self) -> Array:
        """Two."""
        return np.array([0.1, 0.2])

    def solve(self, parameters: Parameters) -> Trajectory:
        """By formula."""
        decay: Array = np.exp(-parameters["rate"] * self.times)
        return Trajectory(np.ones((4, 1)) * decay, self.times)


@dataclass(frozen=True)
class Decay(Physics):
    """Settings of the decay."""

    def build(self, discretize: Discretize) -> ForwardModel:
        """Without a mesh."""
        reveal_type(discretize)  # R: Discretization
        return Decaying(Line(Sparse(np.eye(4))))
