"""Coordinates in which parameters are sought: the cube [−1, 1]^p, logarithms where a range spans enough."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.parameters import ParameterSpace
from dacore.errors import ShapeError

# From this ratio of the ends of a range on, answers are smoother in the logarithm.
_LOGARITHMIC = 3.0


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Where the parameters that vary lie in their ranges.

    The prior is what the ranges say: uniform in the parameter, or in its logarithm where it is `log_uniform`. In a
    logarithmic coordinate x a uniform parameter has a density that grows like exp(slope · x).

    Parameters
    ----------
    parameters : ParameterSpace
    free : (p,) int array
        Columns that vary.
    low, high : (p,) arrays
        Ends of their ranges.
    logarithmic : (p,) bool array
        Which are logarithms.
    slope : (p,) array
        Of the logarithm of the prior's density.
    """

    parameters: ParameterSpace
    free: IntArray
    low: Array
    high: Array
    logarithmic: BoolArray
    slope: Array

    @classmethod
    def of(cls, parameters: ParameterSpace) -> "Coordinates":
        """Return the coordinates of a model's ranges; ShapeError where nothing varies."""
        free = np.array([k for k, p in enumerate(parameters.parameters) if not p.fixed], dtype=np.int64)
        if not len(free):
            raise ShapeError("parameters: none of them varies, so that none can be found; give one a range")
        chosen = parameters.free
        low, high = (np.array([getattr(p, end) for p in chosen]) for end in ("low", "high"))
        uniform_in_log = np.array([p.distribution == "log_uniform" for p in chosen])
        wide = (low > 0) & (high >= _LOGARITHMIC * np.where(low > 0, low, np.inf))
        logarithmic = uniform_in_log | wide
        half = 0.5 * np.log(np.where(logarithmic, high, 1.0) / np.where(logarithmic, low, 1.0))
        return cls(parameters, free, low, high, logarithmic, np.where(uniform_in_log, 0.0, half))

    @property
    def names(self) -> tuple[str, ...]:
        """Names (p) of the parameters that vary."""
        return tuple(self.parameters.names[k] for k in self.free)

    @property
    def prior(self) -> Array:
        """Standard deviation (p,) of each parameter before anything is measured."""
        uniform = (self.high - self.low) / np.sqrt(12.0)
        ratio = np.log(np.where(self.logarithmic, self.high, 1.0) / np.where(self.logarithmic, self.low, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = (self.high - self.low) / ratio
            square = (self.high**2 - self.low**2) / (2 * ratio)
            reciprocal = np.sqrt(square - mean**2)
        return np.asarray(np.where(self.logarithmic & (self.slope == 0), reciprocal, uniform))

    @property
    def prior_of_coordinates(self) -> tuple[Array, Array]:
        """Mean and standard deviation (p,) of the coordinates themselves, of density exp(slope · x) on [−1, 1]."""
        s = np.where(np.abs(self.slope) < 1e-3, 1.0, self.slope)
        mean = 1 / np.tanh(s) - 1 / s
        variance = 1 / s**2 - 1 / np.sinh(s) ** 2
        flat = np.abs(self.slope) < 1e-3
        return np.where(flat, self.slope / 3, mean), np.sqrt(np.where(flat, 1 / 3, variance))

    def of_points(self, points: Array) -> Array:
        """Coordinates (k, p) of parameter vectors (k, n_parameters)."""
        values = np.asarray(points, dtype=np.float64)[:, self.free]
        ends = np.stack([self.low, self.high])
        with np.errstate(invalid="ignore", divide="ignore"):
            logs, log_ends = np.log(values), np.log(ends)
        values = np.where(self.logarithmic, logs, values)
        low, high = np.where(self.logarithmic, log_ends, ends)
        return np.asarray(2 * (values - low) / (high - low) - 1)

    def values(self, x: Array) -> Array:
        """Parameters (..., p) at coordinates (..., p)."""
        share = 0.5 * (np.asarray(x) + 1)
        ratio = np.where(self.logarithmic, self.high, 1.0) / np.where(self.logarithmic, self.low, 1.0)
        return np.where(self.logarithmic, self.low * ratio**share, self.low + (self.high - self.low) * share)

    def slopes(self, x: Array) -> Array:
        """Derivatives (..., p) of the parameters by their coordinates."""
        ratio = np.where(self.logarithmic, self.high, 1.0) / np.where(self.logarithmic, self.low, 1.0)
        return np.where(self.logarithmic, 0.5 * np.log(ratio) * self.values(x), 0.5 * (self.high - self.low))

    def points(self, x: Array) -> Array:
        """Parameter vectors (k, n_parameters) at coordinates (k, p)."""
        fixed = np.array([p.low for p in self.parameters.parameters], dtype=np.float64)
        out = np.tile(fixed, (len(x), 1))
        out[:, self.free] = self.values(x)
        return out

    def log_prior(self, x: Array) -> Array:
        """Logarithm (...) of the prior's density at coordinates (..., p), up to a constant; −∞ outside the cube."""
        inside = (np.abs(x) <= 1.0).all(axis=-1)
        return np.where(inside, x @ self.slope, -np.inf)
