"""What a check of an estimator stands on: a training set, functionals, noise and a known truth."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import Estimate, Estimator, PreparedEstimator
from dacore.core.noise import CorrelatedNoise, NoiseModel, SensorNoise, WhiteNoise
from dacore.core.observation import Functionals
from dacore.testing.backgrounds import ParametricPopulation, Population, functionals_of, random_functionals
from dacore.testing.spaces import Chain
from dacore.testing.suite import require


@dataclass(eq=False)
class Bench:
    """An estimator prepared on a small training set.

    Parameters
    ----------
    estimator : Estimator
    affine : bool
        Whether it claims that estimates are affine in the data.
    deviations : bool
        Whether it claims that standard deviations hold on unseen cases.
    forward : bool
        Whether it needs a background that knows the map from parameters to trajectories.
    seed : int
    """

    estimator: Estimator
    affine: bool = True
    deviations: bool = False
    forward: bool = False
    seed: int = 0
    m: int = field(default=16, repr=False)
    steps: int = field(default=5, repr=False)

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.estimator).__name__

    @cached_property
    def space(self) -> Chain:
        """A vector and a scalar field on fourteen nodes."""
        return Chain(14)

    @cached_property
    def population(self) -> Population:
        """Where training and truth are drawn from."""
        kind = ParametricPopulation if self.forward else Population
        return kind(np.random.default_rng(self.seed), self.space, self.steps)

    @cached_property
    def background(self) -> Background:
        """The training set."""
        return self.population.background(np.random.default_rng(self.seed + 1), samples=20)

    @cached_property
    def functionals(self) -> Functionals:
        """Functionals of the vector field; the scalar is not measured."""
        return random_functionals(np.random.default_rng(self.seed + 2), self.space, self.m)

    def noise(self, kind: str = "white") -> NoiseModel:
        """Noise of the functionals: white, one deviation a functional, or correlated."""
        rng = np.random.default_rng(self.seed + 3)
        if kind == "white":
            return WhiteNoise(0.3)
        if kind == "sensors":
            return SensorNoise(rng.uniform(0.1, 0.6, self.m))
        factor = 0.1 * rng.standard_normal((self.m, self.m)) + 0.3 * np.eye(self.m)
        return CorrelatedNoise(factor @ factor.T)

    @cached_property
    def prepared(self) -> PreparedEstimator:
        """The estimator prepared with white noise."""
        return self.prepare(self.background, self.functionals, self.noise())

    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> PreparedEstimator:
        """Prepare the estimator anew, and look at what it returns."""
        made = self.estimator.prepare(background, functionals, noise, steps)
        good = isinstance(made, PreparedEstimator)
        require(good, f"{self.name}: prepare returns a {type(made).__name__}, expected a PreparedEstimator")
        return made

    @cached_property
    def truth(self) -> Array:
        """Unseen trajectories (n_dofs, t, k)."""
        return self.population.draw(np.random.default_rng(self.seed + 4), 4)

    @cached_property
    def data(self) -> Array:
        """Noisy values (m, t, k) of the unseen trajectories."""
        rng = np.random.default_rng(self.seed + 5)
        return self.functionals(self.truth) + self.noise().sample(rng, (self.m, self.steps, self.truth.shape[2]))

    def fewer(self, mask: BoolArray) -> Functionals:
        """The functionals that a mask keeps."""
        return functionals_of(self.functionals.matrix.toarray()[mask])


def parts(estimate: Estimate) -> dict[str, Any]:
    """Arrays of an estimate, by name."""
    return {
        "state": estimate.state(),
        "coefficients": estimate.coefficients,
        "correction": np.zeros(0) if estimate.correction is None else estimate.correction,
    }


def gap(given: Any, want: Any) -> float:
    """Largest difference as a part of the largest entry; infinite for NaN or another shape."""
    one, other = np.asarray(given, dtype=np.float64), np.asarray(want, dtype=np.float64)
    if one.shape != other.shape:
        return float("inf")
    size = float(np.abs(other).max(initial=0.0))
    found = float(np.abs(one - other).max(initial=0.0)) / (size if size > 0 else 1.0)
    return found if np.isfinite(found) else float("inf")
