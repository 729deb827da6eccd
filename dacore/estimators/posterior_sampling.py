"""Posterior samples in a box by importance sampling with quasi-random points, refined until they fit.

Proposals are normals truncated to the box one coordinate after the other, whose density is known, mixed with wider
ones. Mean and covariance of one round make the proposal of the next. Source of the transform: Genz, J. Comput. Graph.
Stat. 1 (1992) 141; of mixing: Owen and Zhou, J. Am. Stat. Assoc. 95 (2000) 135.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from inspect import signature

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri
from scipy.stats import qmc

from dacore.core.arrays import Array

# Deviations of the parts of a proposal, relative to what is believed, and their shares.
_WIDTHS = (1.1, 2.5)
_SHARES = (0.8, 0.2)
_ROUNDS = 6
# An effective share of the points that is good enough.
_ENOUGH = 0.4
_TINY = 1e-300

LogDensity = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Cloud:
    """Weighted points.

    Parameters
    ----------
    points : (n, p) array
    weights : (n,) array
        Of sum one.
    """

    points: Array
    weights: Array

    @property
    def effective(self) -> float:
        """Effective sample size: one over the sum of the squared weights."""
        return float(1.0 / (self.weights**2).sum())

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p)."""
        mean = self.weights @ self.points
        away = self.points - mean
        return mean, (self.weights[:, None] * away).T @ away


class Truncated:
    """A normal in the cube [−1, 1]^p, cut off coordinate after coordinate.

    Parameters
    ----------
    mean : (p,) array
    covariance : (p, p) array
    """

    def __init__(self, mean: Array, covariance: Array) -> None:
        self.mean = mean
        self.root = np.linalg.cholesky(covariance)

    def draw(self, uniform: Array) -> Array:
        """Points (n, p) of uniform ones (n, p)."""
        v = np.zeros_like(uniform)
        for i in range(len(self.mean)):
            low, high = self._bounds(v, i)
            a, b = ndtr(low), ndtr(high)
            # In the upper tail differences of ndtr lose all digits: mirrored, they do not.
            flip = low > 0
            a, b = np.where(flip, ndtr(-high), a), np.where(flip, ndtr(-low), b)
            share = np.where(flip, 1.0 - uniform[:, i], uniform[:, i])
            drawn = ndtri(np.clip(a + share * (b - a), _TINY, 1.0 - 1e-16))
            v[:, i] = np.clip(np.where(flip, -drawn, drawn), low, high)
        return np.clip(self.mean + v @ self.root.T, -1.0, 1.0)

    def log_density(self, x: Array) -> Array:
        """Logarithm (n,) of the density at points (n, p) of the cube."""
        v = np.linalg.solve(self.root, (x - self.mean).T).T
        out = np.full(len(x), -float(np.log(np.diag(self.root)).sum()) - 0.5 * len(self.mean) * np.log(2 * np.pi))
        for i in range(len(self.mean)):
            low, high = self._bounds(v, i)
            flip = low > 0
            mass = np.where(flip, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
            out -= 0.5 * v[:, i] ** 2 + np.log(np.maximum(mass, _TINY))
        return out

    def _bounds(self, v: Array, i: int) -> tuple[Array, Array]:
        centre = self.mean[i] + v[:, :i] @ self.root[i, :i]
        return (-1.0 - centre) / self.root[i, i], (1.0 - centre) / self.root[i, i]


class Mixture:
    """Truncated normals about several modes, each in several widths.

    Parameters
    ----------
    parts : sequence of (mean (p,), covariance (p, p), share)
    """

    def __init__(self, parts: Sequence[tuple[Array, Array, float]]) -> None:
        self.parts = [
            (Truncated(mean, width**2 * covariance), share * portion)
            for mean, covariance, share in parts
            for width, portion in zip(_WIDTHS, _SHARES, strict=True)
        ]

    def draw(self, count: int) -> Array:
        """Quasi-random points, as many of each part as its share says."""
        ends = np.rint(np.cumsum([share for _, share in self.parts]) * count).astype(int)
        uniform = uniform_points(count, len(self.parts[0][0].mean))
        pieces = np.split(uniform, ends[:-1])
        return np.concatenate([part.draw(u) for (part, _), u in zip(self.parts, pieces, strict=True)])

    def log_density(self, x: Array) -> Array:
        """Logarithm (n,) of the density."""
        each = [part.log_density(x) + np.log(share) for part, share in self.parts]
        return np.asarray(logsumexp(np.stack(each), axis=0))


@cache
def uniform_points(count: int, dimension: int) -> Array:
    """Scrambled Sobol points (count, dimension) of [0, 1], always the same: estimates do not depend on company."""
    source = {"rng" if "rng" in signature(qmc.Sobol).parameters else "seed": np.random.default_rng(20)}
    points = qmc.Sobol(dimension, scramble=True, **source).random_base2(int(np.ceil(np.log2(count))))[:count]
    points.flags.writeable = False
    return np.asarray(points)


def sample(log_density: LogDensity, parts: Sequence[tuple[Array, Array, float]], count: int) -> Cloud:
    """Sample a density on the cube.

    Parameters
    ----------
    log_density : callable
        Takes points (n, p), returns logarithms (n,), up to a constant.
    parts : sequence of (mean (p,), covariance (p, p), share)
        What is believed of it.
    count : int
        Points.
    """
    best = cloud = _weighted(log_density, Mixture(parts), count)
    for _ in range(_ROUNDS - 1):
        if best.effective >= _ENOUGH * count:
            break
        mean, covariance = cloud.moments
        # A few points that carry all weight have no covariance of their own: keep some of what was believed.
        before = sum(share * each for _, each, share in parts)
        share = min(cloud.effective / (10.0 * len(mean)), 1.0)
        parts = [(mean, share * covariance + (1 - share) * before + 1e-18 * np.eye(len(mean)), 1.0)]
        cloud = _weighted(log_density, Mixture(parts), count)
        if cloud.effective > best.effective:
            best = cloud
    return best


def _weighted(log_density: LogDensity, proposal: Mixture, count: int) -> Cloud:
    points = proposal.draw(count)
    log_weights = log_density(points) - proposal.log_density(points)
    weights = np.exp(log_weights - log_weights.max())
    return Cloud(points, weights / weights.sum())
