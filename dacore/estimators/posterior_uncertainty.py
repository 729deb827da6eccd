"""What is uncertain of states whose parameters are: anomalies of a Gaussian, or weighted points."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from dacore.core.arrays import Array
from dacore.core.estimator import Uncertainty
from dacore.estimators.posterior_emulator import Emulator
from dacore.estimators.posterior_errors import ModelErrors


@dataclass(frozen=True, eq=False)
class ForwardErrors:
    """Errors of the forward map itself, which no data mend.

    Parameters
    ----------
    emulator : Emulator
        Knows what it misses of the training set.
    stated : ModelErrors
        Of the map itself.
    """

    emulator: Emulator
    stated: ModelErrors

    def variance(self, on_modes: Array) -> Array:
        """Variance (s,) of functionals (s, t, r) of a trajectory."""
        emulator = self.emulator
        seen = np.einsum("str,rtk->sk", on_modes * self.stated.growth, emulator.errors, optimize=True)
        out = (seen**2).mean(axis=1)
        for rows, variance in self.stated.even:
            scaled = on_modes[:, :, rows] / emulator.scale[rows]
            weights = np.einsum("str,rtq->sq", scaled, emulator.modes[rows], optimize=True)
            out += variance * (weights**2).sum(axis=1)
        return np.asarray(out)

    def at(self, step: int, on_modes: Array) -> tuple[Array, Array]:
        """Weights (s, q) on the modes' coefficients, and variance (s,), of functionals (s, r) of one state."""
        emulator = self.emulator
        scaled, modes = on_modes / emulator.scale, emulator.modes[:, step]
        out = (((on_modes * self.stated.growth) @ emulator.errors[:, step]) ** 2).mean(axis=1)
        for rows, variance in self.stated.even:
            out += variance * ((scaled[:, rows] @ modes[rows]) ** 2).sum(axis=1)
        return scaled @ modes, np.asarray(out)


class LaplaceUncertainty(Uncertainty):
    """The Gaussian about the most probable parameters, carried to the states by their derivatives.

    Parameters
    ----------
    errors : ForwardErrors
    anomalies : (k, q, p) array
        Derivatives of the modes' coefficients times a root of the parameters' covariance.
    """

    def __init__(self, errors: ForwardErrors, anomalies: Array) -> None:
        self.errors, self.anomalies = errors, anomalies

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; there is no correction."""
        weights, _ = self.errors.emulator.project(on_modes)
        moved = np.einsum("sq,kqp->skp", weights, self.anomalies, optimize=True)
        return np.asarray((moved**2).sum(axis=2) + self.errors.variance(on_modes)[:, None])

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s,) of functionals (s, r) of one state of one series."""
        weights, left = self.errors.at(step, on_modes)
        return np.asarray(((weights @ self.anomalies[series]) ** 2).sum(axis=1) + left)


class SampledUncertainty(Uncertainty):
    """Weighted points of the posterior, as trajectories when asked.

    Parameters
    ----------
    errors : ForwardErrors
    points : (k, n, p) array
        Coordinates of the parameters.
    weights : (k, n) array
        Of sum one for each series.
    """

    def __init__(self, errors: ForwardErrors, points: Array, weights: Array) -> None:
        self.errors, self.points, self.weights = errors, points, weights

        self._last: tuple[Array, list[tuple[Array, Array]]] | None = None

    def _values(self, weights: Array) -> list[Array]:
        emulator = self.errors.emulator
        blocks = emulator.blocks(weights)
        return [emulator.values(points, blocks) for points in self.points]

    def _sorted(self, on_modes: Array) -> list[tuple[Array, Array]]:
        """For each series values (s, n) less their mean, blurred and in order, and the heights (s, n) they have."""
        if self._last is not None and np.array_equal(self._last[0], on_modes):
            return self._last[1]
        weights, _ = self.errors.emulator.project(on_modes)
        blur = np.sqrt(self.errors.variance(on_modes))
        n = self.points.shape[1]
        # The same normal numbers for every series and quantity, in an order that has nothing to do with the points'.
        normal = np.random.default_rng(21).permutation(norm.ppf((np.arange(n) + 0.5) / n))
        out = []
        for values, share in zip(self._values(weights), self.weights, strict=True):
            away = (values - share @ values + normal[:, None] * blur).T
            order = away.argsort(axis=1)
            held = share[order]
            # Each point holds its weight about its own middle.
            out.append((np.take_along_axis(away, order, axis=1), np.cumsum(held, axis=1) - 0.5 * held))
        # Quantiles of many levels are asked for one after the other.
        self._last = (np.array(on_modes), out)
        return out

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; there is no correction."""
        weights, _ = self.errors.emulator.project(on_modes)
        out = np.empty((len(on_modes), len(self.points)))
        for series, (values, share) in enumerate(zip(self._values(weights), self.weights, strict=True)):
            out[:, series] = share @ (values - share @ values) ** 2
        return out + self.errors.variance(on_modes)[:, None]

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s,) of functionals (s, r) of one state of one series."""
        emulator, share = self.errors.emulator, self.weights[series]
        # The modes' coefficients are few, so that each point is worth a product of small matrices.
        values = emulator.values(self.points[series], emulator.blocks())
        weights, left = self.errors.at(step, on_modes)
        away = (values - share @ values) * np.sqrt(share)[:, None]
        return np.asarray(((weights @ away.T) ** 2).sum(axis=1) + left)

    def quantile(self, centre: Array, level: float, on_modes: Array, on_correction: Array | None) -> Array:
        """Quantiles (s, k) of the points, blurred by the forward map's own errors."""
        out = np.empty((len(on_modes), len(self.points)))
        for series, (away, heights) in enumerate(self._sorted(on_modes)):
            out[:, series] = [np.interp(level, *each) for each in zip(heights, away, strict=True)]
        return np.asarray(centre + out)
