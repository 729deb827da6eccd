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
