"""An epidemic in towns that commuters connect: a model without a mesh, a finite element or a linear equation.

People of town i are susceptible (S), infected (I) or recovered (R), in numbers a thousand inhabitants:

    S' = −λ S,   I' = λ S − I / d,   R' = I / d,   λ = (R0 / d) · Σ_j K_ij I_j / 1000,

where K_ij is the share of their time that people of town i spend among those of town j. Doctors of a few towns report
a share of each week's new infections; dacore finds the other towns, and what nobody reports: who is immune.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csr_array, diags_array

from dacore.core.arrays import Array, Sparse
from dacore.core.fields import Field, Layout
from dacore.core.model import Discretize, ForwardModel, Physics, Trajectory
from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.parameters import Parameter, Parameters, ParameterSpace
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.core.space import Product, StateSpace
from dacore.errors import ConvergenceError, ShapeError
from dacore.plugins import PluginSpec, hookimpl

DAY = 86400.0  # dacore counts time in seconds
UNIT = "1/1000"


class Towns(StateSpace):
    """States: each week's new infections, who is infected and who is recovered, in towns of so many people (n,)."""

    def __init__(self, inhabitants: Array) -> None:
        self.inhabitants = inhabitants

    @property
    def layout(self) -> Layout:
        """Three scalar fields with a node a town."""
        names = ("new", "infected", "recovered")
        return Layout([Field(name, 1, unit=UNIT) for name in names], dict.fromkeys(names, len(self.inhabitants)))

    def scalar_product(self, field: str, kind: Product = "l2") -> Sparse:
        """Mean over all people; a graph has no slope, so that "h1" is the same."""
        self.layout.field(field)
        return csr_array(diags_array(self.inhabitants / self.inhabitants.sum()))


class Epidemic(ForwardModel):
    """The equations above, on a map drawn at random; parameters are those of the disease and of how it came."""

    parameters = ParameterSpace(
        (
            Parameter("R0", "1", 1.4, 2.2),  # infections by one person among susceptible people
            Parameter("d", "day", 4.0, 7.0),  # days that a person infects others
            Parameter("mixing", "1", 0.02, 0.2, "log_uniform"),  # share of time spent in other towns
            Parameter("immune", UNIT, 0.0, 200.0),  # recovered from an earlier wave
            Parameter("first", UNIT, 0.5, 5.0, "log_uniform"),  # infected in town 0 at the start
        )
    )
    space = property(lambda self: self._space)
    times = property(lambda self: self._times.copy())

    def __init__(self, towns: int, weeks: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        places, inhabitants = rng.uniform(0.0, 10.0, (towns, 2)), np.exp(rng.uniform(7.5, 12.0, towns))
        self._space, self._times = Towns(inhabitants), 7 * DAY * np.arange(1.0, weeks + 1)
        # Gravity: journeys are many to large towns, few to those far away.
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        pull = inhabitants / (1.0 + apart) ** 2 * (apart > 0)
        self._journeys = pull / pull.sum(axis=1, keepdims=True)

    def solve(self, parameters: Parameters) -> Trajectory:
        """Integrate; infections are counted from week to week."""
        n, (r0, d, mixing, immune, first) = len(self._journeys), (parameters[p] for p in self.parameters.names)

        def change(_: float, y: Array) -> Array:
            infected, recovered = y[:n], y[n:]
            met = (1 - mixing) * infected + mixing * (self._journeys @ infected)
            new = r0 / d * met * (1 - (infected + recovered) / 1000)
            return np.concatenate([new - infected / d, infected / d])

        start = np.concatenate([np.where(np.arange(n) == 0, first, 0.0), np.full(n, immune)])
        days = np.concatenate([[0.0], self._times / DAY])
        solved = solve_ivp(change, (0.0, days[-1]), start, "DOP853", t_eval=days, rtol=1e-8, atol=1e-8)
        if not solved.success:
            raise ConvergenceError(f"epidemic: the integration stopped ({solved.message}); narrow the ranges")
        infected, recovered = solved.y[:n], solved.y[n:]
        new = np.diff(infected + recovered, axis=1)
        return Trajectory(np.concatenate([new, infected[:, 1:], recovered[:, 1:]]), self.times)


@dataclass(frozen=True)
class SIR(Physics):
    """A map of towns, drawn at random but always the same for one seed."""

    towns: int = 30
    weeks: int = 20
    seed: int = 0

    def __post_init__(self) -> None:
        if self.towns < 2 or self.weeks < 1 or self.seed < 0:
            raise ShapeError(f"sir: got {self}, expected at least 2 towns, 1 week and a seed of 0 or more")

    def build(self, discretize: Discretize) -> ForwardModel:
        """Draw the map; nothing is discretised."""
        return Epidemic(self.towns, self.weeks, self.seed)


@dataclass(frozen=True)
class Reports(ObservationOperator):
    """New infections of each week in some towns, as far as doctors report them."""

    towns: tuple[int, ...]
    share: float = 0.3
    field: str = "new"

    def functionals(self, space: StateSpace) -> Functionals:
        """Return a functional a town."""
        rows = _rows(space, self.field, self.towns)
        nowhere, labels = np.zeros((len(self.towns), 1)), tuple(f"{self.field} in town {town}" for town in self.towns)
        return Functionals(self.share * rows, labels, UNIT, nowhere, nowhere, np.arange(len(self.towns)))


@dataclass(frozen=True)
class InTown(QuantityOfInterest):
    """A field in one town: its mean over all weeks, or week by week."""

    town: int
    field: str = "infected"
    over_time: Over = "each"

    def functionals(self, space: StateSpace) -> Functionals:
        """Return the one functional."""
        return Reports((self.town,), 1.0, self.field).functionals(space)


def _rows(space: StateSpace, field: str, towns: tuple[int, ...]) -> Sparse:
    count = space.layout.nodes[space.layout.field(field).name]
    if not towns or len(set(towns)) < len(towns) or not all(0 <= town < count for town in towns):
        raise ShapeError(f"towns: got {list(towns)}, expected different numbers from 0 to {count - 1}")
    columns = space.layout.block(field).start + np.array(towns)
    return csr_array((np.ones(len(towns)), (np.arange(len(towns)), columns)), shape=(len(towns), space.n_dofs))


@hookimpl
def dacore_models() -> list[PluginSpec]:
    return [PluginSpec("sir", f"{__name__}:SIR", summary="susceptible, infected, recovered in towns")]


@hookimpl
def dacore_observations() -> list[PluginSpec]:
    return [PluginSpec("reports", f"{__name__}:Reports", summary="reported cases of some towns")]


@hookimpl
def dacore_quantities() -> list[PluginSpec]:
    return [PluginSpec("in_town", f"{__name__}:InTown", summary="a field in one town")]
