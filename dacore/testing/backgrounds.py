"""Training sets and functionals for tests of estimators, without a mesh or a PDE."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from dacore.algebra.compress import compress
from dacore.core.arrays import Array
from dacore.core.background import Background, ParametricMap
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.core.space import StateSpace


class Population:
    """Gaussian trajectories y = mean + modes · weights, coupled between the fields: a known truth to draw from.

    Parameters
    ----------
    rng : numpy.random.Generator
    space : StateSpace
    steps : int
    decay : float
        Ratio of the sizes of successive modes.
    """

    rank = 9

    def __init__(self, rng: np.random.Generator, space: StateSpace, steps: int = 5, decay: float = 0.6) -> None:
        self.modes = rng.standard_normal((space.n_dofs, self.rank)) * decay ** np.arange(self.rank)
        self.mean = rng.standard_normal((space.n_dofs, steps))
        self.space, self.steps = space, steps

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Trajectories (n_dofs, steps, count)."""
        weights = rng.standard_normal((self.rank, self.steps, count))
        return np.asarray(self.mean[:, :, None] + np.tensordot(self.modes, weights, axes=1))

    def background(self, rng: np.random.Generator, samples: int = 12, tolerance: float = 1e-12) -> Background:
        """Compress `samples` trajectories to a training set."""
        states, times = self.draw(rng, samples), np.arange(1.0, self.steps + 1)
        trajectories = [Trajectory(states[:, :, k], times) for k in range(samples)]
        parameters = ParameterSpace((Parameter("a", "1", 0.0, 1.0),))
        return compress(self.space, trajectories, parameters, rng.random((samples, 1)), tolerance)


class ParametricPopulation(Population):
    """Trajectories that follow from four parameters: two smooth and nonlinear, two amplitudes.

    The training set has the map from parameters to trajectories, and truth is drawn from the parameters' ranges.

    Parameters
    ----------
    rng : numpy.random.Generator
    space : StateSpace
    steps : int
    decay : float
        Ratio of the sizes of successive modes.
    """

    parameters = ParameterSpace(
        (
            Parameter("stiffness", "1", 1.0, 6.0),
            Parameter("ratio", "1", -0.5, 0.5),
            Parameter("push", "1", 0.5, 1.5),
            Parameter("pull", "1", -1.0, 1.0),
            Parameter("density", "1", 1.0, 1.0),
        )
    )

    def __init__(self, rng: np.random.Generator, space: StateSpace, steps: int = 5, decay: float = 0.6) -> None:
        super().__init__(rng, space, steps, decay)
        self.phases = rng.uniform(0.0, 2 * np.pi, (self.rank, steps))

    def trajectories(self, points: Array) -> Array:
        """Trajectories (n_dofs, steps, k) of parameters (k, n_parameters)."""
        stiffness, ratio, push, pull, _ = points.T
        waves = np.sin(self.phases[:, :, None] + 1.5 * np.log(stiffness) + ratio * np.arange(self.steps)[:, None])
        static = np.cos(self.phases[:, :, None]) / stiffness + 0.5 * ratio
        return np.asarray(self.mean[:, :, None] + np.tensordot(self.modes, push * waves + pull * static, axes=1))

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Trajectories (n_dofs, steps, count)."""
        return self.trajectories(self.parameters.sample(rng, count))

    def background(self, rng: np.random.Generator, samples: int = 12, tolerance: float = 1e-12) -> Background:
        """Compress `samples` trajectories to a training set that knows its forward map."""
        points = self.parameters.sample(rng, samples)
        states, times = self.trajectories(points), np.arange(1.0, self.steps + 1)
        trajectories = [Trajectory(states[:, :, k], times) for k in range(samples)]
        made = compress(self.space, trajectories, self.parameters, points, tolerance)
        return replace(made, forward=_Projected(self, made))


class _Projected(ParametricMap):
    def __init__(self, population: ParametricPopulation, background: Background) -> None:
        self.population, self.background = population, background

    def coefficients(self, points: Array) -> Array:
        return self.background.project(self.population.trajectories(points))

    @property
    def accuracy(self) -> Mapping[str, float]:
        return {field.name: 1e-9 for field in self.background.space.fields}


def random_background(
    rng: np.random.Generator,
    space: StateSpace,
    samples: int = 12,
    steps: int = 5,
    decay: float = 0.6,
    tolerance: float = 1e-12,
) -> Background:
    """A training set of random trajectories with a mean, coupled between the fields."""
    return Population(rng, space, steps, decay).background(rng, samples, tolerance)


def functionals_of(matrix: ArrayLike) -> Functionals:
    """Wrap a dense matrix (m, n_dofs) as functionals without geometry."""
    rows = csr_array(np.asarray(matrix, dtype=np.float64))
    m = rows.shape[0]
    labels = tuple(f"l{i}" for i in range(m))
    return Functionals(rows, labels, "cm", np.zeros((m, 1)), np.zeros((m, 1)), np.arange(m))


def random_functionals(rng: np.random.Generator, space: StateSpace, m: int = 11, field: str = "u") -> Functionals:
    """Functionals of one field alone."""
    matrix = np.zeros((m, space.n_dofs))
    block = space.layout.block(field)
    matrix[:, block] = rng.standard_normal((m, block.stop - block.start))
    return functionals_of(matrix)


class Weighted(QuantityOfInterest):
    """A quantity with given weights on the dofs.

    Parameters
    ----------
    weights : (s, n_dofs) array
    over_time : {"mean", "each"}
    """

    def __init__(self, weights: ArrayLike, over_time: Over = "mean") -> None:
        self.weights, self.over_time = np.asarray(weights, dtype=np.float64), over_time

    def functionals(self, space: StateSpace) -> Functionals:
        """Return the functionals."""
        return functionals_of(self.weights)
