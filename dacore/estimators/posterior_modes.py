"""Most probable parameters of many series at once: Levenberg–Marquardt on a box, from several starts.

At a bound a parameter that wants to leave is held and the others move on (an active set), so that a parameter at
the end of its range does not stop the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, IntArray

# Steps shorter than this, in coordinates whose range has length 2, end the search.
_SHORT = 1e-11
_MOST_STEPS = 60
# Starts of one series lie at least so far apart, so that distinct basins are tried.
_APART = 0.35
# A mode counts beside the best where its density is not below exp(−8) of it, so many deviations away.
_COMPETES, _DISTINCT = 8.0, 4.0

Residuals = Callable[[Array, IntArray], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Independent normals in the coordinates.

    Parameters
    ----------
    mean, deviation : (p,) arrays
    """

    mean: Array
    deviation: Array

    def cost(self, x: Array) -> Array:
        """Minus the logarithm (k,) of the density at (k, p), up to a constant."""
        return np.asarray(0.5 * (((x - self.mean) / self.deviation) ** 2).sum(axis=1))

    def gradient(self, x: Array) -> Array:
        """Derivatives (k, p) of the cost."""
        return np.asarray((x - self.mean) / self.deviation**2)


def starts(data: Array, variance: Array, training: Array, places: Array, count: int) -> Array:
    """Coordinates (k, count, p) of the training samples whose data are nearest, apart from each other.

    Parameters
    ----------
    data, variance : (k, d) arrays
    training : (K, d) array
    places : (K, p) array
        Coordinates of the samples.
    count : int
    """
    weight = 1.0 / variance
    far = (data**2 * weight).sum(axis=1)[:, None] - 2 * (data * weight) @ training.T + weight @ (training**2).T
    out = np.empty((len(data), count, places.shape[1]))
    for j in range(count):
        best = far.argmin(axis=1)
        out[:, j] = places[best]
        near = np.abs(places[None] - out[:, j][:, None]).max(axis=2) < _APART
        far = np.where(near, np.inf, far)
        # Where all samples are near one that is taken, the rest repeat the first.
        spent = ~np.isfinite(far).any(axis=1)
        far[spent, best[spent]] = 0.0
    return np.clip(out, -1.0, 1.0)


def search(residuals: Residuals, prior: Gaussian, x: Array) -> tuple[Array, Array, Array]:
    """Minimise ½ ‖r(x)‖² + prior cost on the cube, each row on its own.

    Parameters
    ----------
    residuals : callable
        Takes coordinates (k, p) and the numbers of their rows; returns residuals (k, d) and derivatives (k, d, p).
    prior : Gaussian
    x : (n, p) array
        Starts.

    Returns
    -------
    x : (n, p) array
    cost : (n,) array
    precision : (n, p, p) array
        Of the Gaussian there: JᵀJ and the prior's.
    """
    x = x.copy()
    n, p = x.shape
    everyone = np.arange(n)
    r, j = residuals(x, everyone)
    cost = 0.5 * (r**2).sum(axis=1) + prior.cost(x)
    gradient = np.einsum("kdp,kd->kp", j, r) + prior.gradient(x)
    hessian = np.einsum("kdp,kdq->kpq", j, j, optimize=True)
    damping = np.full(n, 1e-3)
    moving = everyone
    own = np.diag(1.0 / prior.deviation**2)
    for _ in range(_MOST_STEPS):
        if not len(moving):
            break
        place, slope = x[moving], gradient[moving]
        held = ((place >= 1.0) & (slope < 0)) | ((place <= -1.0) & (slope > 0))
        matrix = hessian[moving] + own
        diagonal = np.einsum("kpp->kp", matrix)
        matrix = matrix + (damping[moving, None] * np.maximum(diagonal, 1e-12))[:, :, None] * np.eye(p)
        matrix = np.where(held[:, :, None] | held[:, None, :], np.eye(p), matrix)
        step = -np.linalg.solve(matrix, np.where(held, 0.0, slope)[:, :, None])[:, :, 0]
        new = np.clip(place + step, -1.0, 1.0)
        r, j = residuals(new, moving)
        tried = 0.5 * (r**2).sum(axis=1) + prior.cost(new)
        better = tried <= cost[moving]
        done = np.abs(new - place).max(axis=1) < _SHORT
        taken = moving[better]
        x[taken], cost[taken] = new[better], tried[better]
        gradient[taken] = np.einsum("kdp,kd->kp", j[better], r[better]) + prior.gradient(new[better])
        hessian[taken] = np.einsum("kdp,kdq->kpq", j[better], j[better], optimize=True)
        damping[moving] = np.where(better, damping[moving] * 0.2, damping[moving] * 8.0)
        moving = moving[~(done | (damping[moving] > 1e12))]
    return x, cost, hessian + own


@dataclass(frozen=True, eq=False)
class End:
    """Where several searches of one series ended: the best, and the distinct modes that compete with it.

    Parameters
    ----------
    x : (p,) array
    covariance : (p, p) array
        Inverse of the precision there.
    cost : float
        Minus the logarithm of the density, up to a constant.
    parts : list of (mean, covariance, share)
    """

    x: Array
    covariance: Array
    cost: float
    parts: list[tuple[Array, Array, float]]


def ended(x: Array, cost: Array, precision: Array) -> End:
    """Judge the ends (j, p) of searches of one series by their costs (j,) and precisions (j, p, p)."""
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    winner = cost.argmin()
    parts = _competing(x, cost, precision, covariance)
    return End(x[winner], covariance[winner], float(cost[winner]), parts)


def _competing(x: Array, cost: Array, precision: Array, covariance: Array) -> list[tuple[Array, Array, float]]:
    """Distinct modes (mean, covariance, share) among the ends of several searches."""
    chosen: list[int] = []
    for j in cost.argsort():
        if cost[j] > cost.min() + _COMPETES:
            break
        away = [x[j] - x[other] for other in chosen]
        if all(step @ precision[j] @ step > _DISTINCT**2 for step in away):
            chosen.append(int(j))
    mass = np.array([np.sqrt(np.linalg.det(covariance[j])) * np.exp(cost.min() - cost[j]) for j in chosen])
    # None is left without points, however little it is believed.
    share = 0.9 * mass / mass.sum() + 0.1 / len(chosen)
    return [(x[j], covariance[j], float(portion)) for j, portion in zip(chosen, share, strict=True)]
