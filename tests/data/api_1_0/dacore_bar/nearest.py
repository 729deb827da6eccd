from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from dacore.core.background import Background
from dacore.core.estimator import (
    Estimate,
    Estimator,
    PreparedEstimator,
    check_data,
    check_mask,
    check_scale,
    observed_steps,
)
from dacore.core.misfit import Misfit
from dacore.core.uncertainty import Uncertainty
from dacore.errors import ShapeError


class Spread(Uncertainty):
    """Scatter of the trajectories that fit, and what each differs from the nearest other one."""

    def __init__(self, trajectories, gaps, weights):
        self.trajectories, self.gaps, self.weights = trajectories, gaps, weights

    def variance(self, on_modes, on_correction):
        values, gaps = (np.einsum("str,rtk->sk", on_modes, each) for each in (self.trajectories, self.gaps))
        about = values[:, :, None] - (values @ self.weights)[:, None, :]  # (s, K, k): quantity, trajectory, series
        return np.einsum("sjk,jk->sk", about**2, self.weights) + (gaps**2).mean(axis=1)[:, None]


class PreparedNearest(PreparedEstimator):
    def __init__(self, background, functionals, noise, steps):
        self.background, self.noise, self.steps = background, noise, observed_steps(background, steps)
        # ℓΦ (m, r) times the coefficients (r, t, K): the data of every training trajectory.
        reduced = background.observe(functionals.matrix)
        self.data = np.einsum("mr,rtk->mtk", reduced, background.coefficients[:, self.steps])
        self.all = self._fit(None)

    @property
    def inf_sup(self):
        return np.full(len(self.steps), np.nan)  # this estimator has no stability constant

    def _seen(self, data, mask):
        """Data (m, t, k) in units of the noise, a row a series: (k, m · t)."""
        noise = self.noise if mask is None else self.noise.marginal(mask)
        white = noise.whiten(data if mask is None else data[mask])
        return white.reshape(-1, data.shape[2]).T

    def _fit(self, mask):
        """The training set's data, the nearest other one of each, and its squared distance."""
        seen = self._seen(self.data, mask)
        apart = cdist(seen, seen, "sqeuclidean")
        np.fill_diagonal(apart, np.inf)
        return seen, apart.argmin(axis=1), apart.min(axis=1)

    def estimate(self, data, noise_scale=1.0, mask=None):
        m, t, _ = self.data.shape
        mask = check_mask(mask, m)
        values = check_data(data, m, t, mask)
        power = check_scale(noise_scale, values.shape[2]) ** 2
        seen, nearest, gap = self.all if mask is None else self._fit(mask)
        distance = cdist(seen, self._seen(values, mask), "sqeuclidean")  # (K, k)
        # Mean and variance of the least distance, by gaps and by noise: those of unit · chi-squared(freedom).
        mean, variance = gap.mean() + power * seen.shape[1], gap.var() + 2 * power**2 * seen.shape[1]
        unit, freedom = variance / (2 * mean), 2 * mean**2 / variance
        least = distance.min(axis=0)
        weights = np.exp((least - distance) / (2 * unit))
        weights /= weights.sum(axis=0)
        trajectories = self.background.coefficients
        return Estimate(
            self.background,
            np.arange(trajectories.shape[1]),  # a trajectory is known at all times, however few are observed
            trajectories @ weights,
            uncertainty=Spread(trajectories, trajectories - trajectories[:, :, nearest], weights),
            misfit=Misfit(least / unit, freedom),
        )


@dataclass(frozen=True)
class Nearest(Estimator):
    """Mean of the training trajectories near the data, weighed by how well each fits.

    Parameters
    ----------
    least : int
        Samples that a training set must have.
    """

    least: int = 10

    def __post_init__(self) -> None:
        if self.least < 3:
            raise ShapeError(f"nearest: got least = {self.least}, expected at least 3")

    def check(self, layout, samples) -> None:
        if samples < self.least:
            raise ShapeError(f"nearest: got {samples} training samples, expected at least {self.least}")

    def prepare(self, background: Background, functionals, noise, steps=None) -> PreparedEstimator:
        self.check(background.space.layout, background.n_samples)
        return PreparedNearest(background, functionals, noise, steps)
