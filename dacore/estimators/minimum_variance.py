"""Linear minimum-variance estimation with the training set's own mean and covariance.

A state is written a = mean + A ω with the training anomalies A (r, K) and ω ~ N(0, I): the prior
has the training set's covariance and nothing is inverted that is larger than K. With whitened
observations N^(−½)LA = UΣVᵀ and noise of standard deviation s (in units of the prepared noise)::

    ω̂ = V diag(Σ/(Σ² + s²)) Uᵀ N^(−½)(l − L mean),    cov(ω | l) = I − V diag(Σ²/(Σ² + s²)) Vᵀ

per time step, or once for the whole space–time trajectory. A trajectory that is observed at some of its times is
estimated at all of them.
"""

import logging
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from dacore.algebra.svd import thin_svd
from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import (
    Estimate,
    Estimator,
    PreparedEstimator,
    Readout,
    Uncertainty,
    check_data,
    check_mask,
    check_scale,
    observed_steps,
    weights_of,
)
from dacore.core.noise import NoiseModel, SensorNoise, WhiteNoise
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.anomalies import Factors, Fold, HeldOut, Posterior, along, innovation
from dacore.estimators.frames import FOLDS, fold_masks
from dacore.estimators.metrics import whiten_transpose
from dacore.estimators.plausible import Plausibility
from dacore.estimators.surprise import unlearned

SMALLEST_FLOOR = 1e-12
SMALLEST_VARIATION = 1e-13
LARGEST_MISS = 0.05

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class MinimumVariance(Estimator):
    """Settings of the linear minimum-variance estimate.

    Parameters
    ----------
    window : {"cycle", "step"}
        Use the data of the whole trajectory at once and estimate all of its times, observed or not; or each
        observed step on its own.
    floor : float or "held_out"
        What the training set cannot represent acts like noise even when the data are exact. Its standard
        deviation, relative to the largest singular value; or measured on training trajectories held out
        in turn, together with what compression and reduced training state that they leave out.
    deviations : {"held_out", "model"}
        Where standard deviations come from: the errors on training trajectories held out in turn, plus the
        noise that comes through; or the Gaussian posterior, which takes the training set's covariance for
        the truth and claims too little where samples are few or data exact.
    """

    window: Literal["cycle", "step"] = "cycle"
    floor: float | Literal["held_out"] = "held_out"
    deviations: Literal["held_out", "model"] = "held_out"

    def __post_init__(self) -> None:
        if self.floor != "held_out" and not 0 < self.floor < 1:
            raise ShapeError(f"floor: got {self.floor}, expected 'held_out' or a number between 0 and 1")

    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> "PreparedMinimumVariance":
        """Decompose the whitened observations of the training anomalies."""
        if background.n_samples < 2:
            raise ShapeError(f"training: got {background.n_samples} trajectory, expected at least 2 for a covariance")
        if self.deviations == "model":
            _warn_of_few_samples(background)
        return PreparedMinimumVariance(self, background, functionals, noise, observed_steps(background, steps))


class PreparedMinimumVariance(PreparedEstimator):
    """Minimum variance with everything done that does not depend on data.

    Attributes
    ----------
    times : (T,) int array
        Which of the background's times are estimated: all of them where the data of the whole trajectory are
        used at once, the observed ones otherwise.
    """

    def __init__(
        self,
        settings: MinimumVariance,
        background: Background,
        functionals: Functionals,
        noise: NoiseModel,
        steps: IntArray,
        mask: BoolArray | None = None,
        whole: "PreparedMinimumVariance | None" = None,
    ) -> None:
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps = steps
        self.times = np.arange(len(background.times)) if settings.window == "cycle" else steps
        self.keep = np.ones(functionals.count, dtype=bool) if mask is None else mask
        self._kept_noise = noise if mask is None else noise.marginal(mask)
        if whole is None:
            training = background.coefficients[:, self.times]
            self.mean = training.mean(axis=2)
            self.anomalies = (training - self.mean[:, :, None]) / np.sqrt(background.n_samples - 1)
            # What is left of equal trajectories less their mean is rounding, and would be taken for a covariance.
            if not float(np.linalg.norm(self.anomalies)) > SMALLEST_VARIATION * float(np.linalg.norm(training)):
                raise ShapeError(
                    "training set: all trajectories are the same, so there is no covariance; train on more than one "
                    "sample, or give a parameter a range"
                )
            self.observed = background.observe(functionals.matrix)
        else:
            self.mean, self.anomalies, self.observed = whole.mean, whole.anomalies, whole.observed
        self._seen_rows = steps if settings.window == "cycle" else np.arange(len(steps))
        self.expected = self.observed @ self.mean[:, self._seen_rows]
        self._plausibility = Plausibility(self.observed[self.keep], background.coefficients[:, steps], self._kept_noise)
        self.factors = self._factors() if whole is None else self._without_masked(whole)
        # In the directions of all samples, of which there are few, groups of them are held out at little cost.
        self._white = [each.s[:, None] * each.vt for each in self.factors]
        self.floors = [
            self._floor(white, float(each.s[0]), each.size)
            for white, each in zip(self._white, self.factors, strict=True)
        ]

    def _factors(self) -> list[Factors]:
        seen = np.tensordot(self.observed[self.keep], self.anomalies[:, self._seen_rows], axes=1)
        return [Factors.of(window) for window in self._windows(self._kept_noise.whiten(seen))]

    def _without_masked(self, whole: "PreparedMinimumVariance") -> list[Factors]:
        if not isinstance(self.noise, WhiteNoise | SensorNoise):
            return self._factors()
        rows = np.repeat(self.keep, len(self.steps)) if self.settings.window == "cycle" else self.keep
        return [each.of_rows(rows) for each in whole.factors]

    def _windows(self, white: Array) -> list[Array]:
        """Whitened values (m, t, k) in groups that are used together: (m · t, k), or t of (m, k)."""
        if self.settings.window == "cycle":
            return [white.reshape(white.shape[0] * white.shape[1], white.shape[2])]
        return list(white.swapaxes(0, 1))

    @cached_property
    def unlearned(self) -> float:
        """Mean square, over data in units of the noise, of what the training set says that it leaves out."""
        return unlearned(self.background, self.observed[self.keep], self._kept_noise)

    @cached_property
    def held_out(self) -> list[Fold]:
        """The same estimate without some trajectories, and what it makes of their exact data."""
        count = self.background.n_samples
        folds = []
        for mask in fold_masks(count, FOLDS):
            others = int((~mask).sum())
            anomalies = self.anomalies[:, :, ~mask]
            mean = anomalies.mean(axis=2)
            factors = []
            for window in self._white:
                middle = window[:, ~mask].mean(axis=1, keepdims=True)
                u, s, vt = thin_svd((window[:, ~mask] - middle) * _unit(count, others))
                factors.append((s, vt, u.T @ (window[:, mask] - middle)))
            folds.append(Fold(mask, (anomalies - mean[:, :, None]) * _unit(count, others), mean, factors))
        return folds

    def _floor(self, white: Array, largest: float, size: int) -> float:
        smallest = SMALLEST_FLOOR * largest
        if self.settings.floor != "held_out":
            return max(self.settings.floor * largest, smallest)
        missed = unrepresented(white * np.sqrt(self.background.n_samples - 1), size)
        # Trajectories held out come from the same reduced model: what that leaves out, they do not show.
        return max(float(np.hypot(missed, np.sqrt(self.unlearned))), smallest)

    @property
    def inf_sup(self) -> Array:
        """NaN (t,): the prior, not a stability constant, bounds the error."""
        return np.full(len(self.steps), np.nan)

    def masked(self, mask: BoolArray) -> "PreparedMinimumVariance":
        """Return the same estimator on the functionals of `mask` (m,); what they observe is reused."""
        return PreparedMinimumVariance(
            self.settings, self.background, self.functionals, self.noise, self.steps, mask, self
        )  # fmt: skip

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states; the noise scale decides how much the data are trusted."""
        flags = check_mask(mask, self.functionals.count)
        raw = check_data(data, self.functionals.count, len(self.steps), flags)
        k = raw.shape[2]
        scale = check_scale(noise_scale, k)
        if flags is not None:
            return self.masked(flags).estimate(raw, scale)
        self._plausibility.check(raw[self.keep], scale)
        windows = self._windows(self._kept_noise.whiten((raw - self.expected[:, :, None])[self.keep]))
        weights, seen = [], []
        for each, floor, window in zip(self.factors, self.floors, windows, strict=True):
            level = np.hypot(scale, floor)  # noise and what the training set leaves out, together
            along, left = each.split(window)
            weights.append(each.vt.T @ (each.s[:, None] / (each.s[:, None] ** 2 + level**2) * along))
            seen.append((along**2, left))
        coefficients = np.repeat(self.mean[:, :, None], k, axis=2)
        if self.settings.window == "cycle":
            coefficients += np.tensordot(self.anomalies, weights[0], axes=1)
        else:
            coefficients += np.einsum("rtj,tjk->rtk", self.anomalies, np.stack(weights), optimize=True)
        return Estimate(
            self.background, self.times, coefficients,
            uncertainty=self._uncertainty(scale), misfit=innovation(self, seen, scale),
        )  # fmt: skip

    def _uncertainty(self, scale: Array) -> Uncertainty:
        return Posterior(self, scale) if self.settings.deviations == "model" else HeldOut(self, scale)

    def readout(self, quantity: QuantityOfInterest, noise_scale: float = 1.0, mask: BoolArray | None = None) -> Readout:
        """Take data straight to a quantity, at one noise scale."""
        flags = check_mask(mask, self.functionals.count)
        scale = check_scale(noise_scale, 1)
        if flags is not None:
            return replace(self.masked(flags).readout(quantity, noise_scale), mask=flags)
        on_modes, _ = weights_of(quantity, self.background, len(self.times))
        if self.settings.window == "cycle":
            directions = [along(on_modes, self.anomalies)]
        else:
            directions = [on_modes[:, t] @ self.anomalies[:, t] for t in range(len(self.steps))]
        white = []
        for direction, each, floor in zip(directions, self.factors, self.floors, strict=True):
            level = float(np.hypot(scale[0], floor))
            white.append(each.spread((direction @ each.vt.T * (each.s / (each.s**2 + level**2))).T).T)
        shape = (len(on_modes), int(self.keep.sum()), len(self.steps))
        whole = white[0].reshape(shape) if self.settings.window == "cycle" else np.stack(white, axis=2)
        gain = np.zeros((len(on_modes), self.functionals.count, len(self.steps)))
        gain[:, self.keep] = whiten_transpose(self._kept_noise, whole.swapaxes(0, 1)).swapaxes(0, 1)
        offset = np.einsum("str,rt->s", on_modes, self.mean) - np.einsum("smt,mt->s", gain, self.expected)
        return Readout(gain, offset, np.sqrt(self._uncertainty(scale).variance(on_modes, None)[:, 0]))


def unrepresented(values: Array, size: int | None = None) -> float:
    """Root mean square, over data, of the part of held-out samples that the other samples cannot represent.

    Parameters
    ----------
    values : (m, K) array
        One sample a column; as they are, or in coordinates of fewer directions that hold all of them.
    size : int, optional
        Number of values there were before they were put into fewer directions.
    """
    total = 0.0
    for held_out in fold_masks(values.shape[1], FOLDS):
        mean = values[:, ~held_out].mean(axis=1, keepdims=True)
        basis, r = np.linalg.qr(values[:, ~held_out] - mean)
        length = np.abs(np.diag(r))
        basis = basis[:, length > 1e-12 * length.max(initial=0.0)]
        left = values[:, held_out] - mean
        left = left - basis @ (basis.T @ left)
        total += float((left**2).sum())
    return float(np.sqrt(total / (size or values.size)))


def _warn_of_few_samples(background: Background) -> None:
    """Warn where the training set's covariance leaves out much of what another sample would be."""
    parts = []
    for field in background.space.fields:
        values = background.coefficients[background.block(field.name)]
        values = values - values.mean(axis=2, keepdims=True)
        size = float(np.linalg.norm(values))
        # Fields count alike: what matters is which combinations of them were seen together.
        parts.append((values / size if size > 0 else values).reshape(-1, background.n_samples))
    joint = np.concatenate(parts)
    missed, spread = unrepresented(joint), float(np.sqrt((joint**2).mean()))
    if missed > LARGEST_MISS * spread:
        logger.warning(
            "deviations = 'model': %d samples cannot represent %.0f%% of what another one would vary, so that claimed "
            "deviations are too small; use deviations = 'held_out', or train on more samples",
            background.n_samples, 100 * min(missed / spread, 1.0),
        )  # fmt: skip


def _unit(count: int, others: int) -> float:
    """Factor from anomalies scaled for `count` samples to anomalies scaled for `others` of them."""
    return float(np.sqrt((count - 1) / max(others - 1, 1)))
