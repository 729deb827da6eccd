"""Linear minimum-variance estimation with the training set's own mean and covariance.

A state is written a = mean + A ω with the training anomalies A (r, K) and ω ~ N(0, I): the prior
has the training set's covariance and nothing is inverted that is larger than K. With whitened
observations N^(−½)LA = UΣVᵀ and noise of standard deviation s (in units of the prepared noise)::

    ω̂ = V diag(Σ/(Σ² + s²)) Uᵀ N^(−½)(l − L mean),    cov(ω | l) = I − V diag(Σ²/(Σ² + s²)) Vᵀ

per time step, or once for the whole space–time trajectory.
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
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.frames import FOLDS, fold_masks
from dacore.estimators.plausible import Plausibility

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
        Use the data of the whole trajectory at once, or each time step on its own.
    floor : float or "held_out"
        What the training set cannot represent acts like noise even when the data are exact. Its standard
        deviation, relative to the largest singular value; or measured on training trajectories held out
        in turn.
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
    """Minimum variance with everything done that does not depend on data."""

    def __init__(
        self,
        settings: MinimumVariance,
        background: Background,
        functionals: Functionals,
        noise: NoiseModel,
        steps: IntArray,
        mask: BoolArray | None = None,
    ) -> None:
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps = steps
        training = background.coefficients[:, steps]
        self.mean = training.mean(axis=2)
        self.anomalies = (training - self.mean[:, :, None]) / np.sqrt(background.n_samples - 1)
        # What is left of equal trajectories less their mean is rounding, and would be taken for a covariance.
        if not float(np.linalg.norm(self.anomalies)) > SMALLEST_VARIATION * float(np.linalg.norm(training)):
            raise ShapeError(
                "training set: all trajectories are the same, so there is no covariance; train on more than one "
                "sample, or give a parameter a range"
            )
        observed = background.observe(functionals.matrix)
        self.expected = observed @ self.mean
        self.keep = np.ones(functionals.count, dtype=bool) if mask is None else mask
        self._kept_noise = noise if mask is None else noise.marginal(mask)
        self._plausibility = Plausibility(observed[self.keep], training, self._kept_noise)
        windows = self._windows(self._kept_noise.whiten(np.tensordot(observed[self.keep], self.anomalies, axes=1)))
        self.factors = [thin_svd(window) for window in windows]
        # In the directions of all samples, of which there are few, groups of them are held out at little cost.
        self._white = [s[:, None] * vt for _, s, vt in self.factors]
        self.floors = [
            self._floor(white, s[0], window.size)
            for white, window, (_, s, _) in zip(self._white, windows, self.factors, strict=True)
        ]

    def _windows(self, white: Array) -> list[Array]:
        """Whitened values (m, t, k) in groups that are used together: (m · t, k), or t of (m, k)."""
        if self.settings.window == "cycle":
            return [white.reshape(white.shape[0] * white.shape[1], white.shape[2])]
        return list(white.swapaxes(0, 1))

    @cached_property
    def held_out(self) -> list["_Fold"]:
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
            folds.append(_Fold(mask, (anomalies - mean[:, :, None]) * _unit(count, others), mean, factors))
        return folds

    def _floor(self, white: Array, largest: float, size: int) -> float:
        smallest = SMALLEST_FLOOR * largest
        if self.settings.floor != "held_out":
            return max(self.settings.floor * largest, smallest)
        return max(unrepresented(white * np.sqrt(self.background.n_samples - 1), size), smallest)

    @property
    def inf_sup(self) -> Array:
        """NaN (t,): the prior, not a stability constant, bounds the error."""
        return np.full(len(self.steps), np.nan)

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states; the noise scale decides how much the data are trusted."""
        flags = check_mask(mask, self.functionals.count)
        raw = check_data(data, self.functionals.count, len(self.steps), flags)
        k = raw.shape[2]
        scale = check_scale(noise_scale, k)
        if flags is not None:
            again = PreparedMinimumVariance(
                self.settings, self.background, self.functionals, self.noise, self.steps, flags
            )
            return again.estimate(raw, scale)
        self._plausibility.check(raw[self.keep], scale)
        white = self._kept_noise.whiten((raw - self.expected[:, :, None])[self.keep])
        windows = self._windows(white)
        weights = []
        for (u, s, vt), floor, window in zip(self.factors, self.floors, windows, strict=True):
            level = np.hypot(scale, floor)  # noise and what the training set leaves out, together
            weights.append(vt.T @ (s[:, None] / (s[:, None] ** 2 + level**2) * (u.T @ window)))
        coefficients = np.repeat(self.mean[:, :, None], k, axis=2)
        if self.settings.window == "cycle":
            coefficients += np.tensordot(self.anomalies, weights[0], axes=1)
        else:
            coefficients += np.einsum("rtj,tjk->rtk", self.anomalies, np.stack(weights), optimize=True)
        return Estimate(self.background, self.steps, coefficients, uncertainty=self._uncertainty(scale))

    def _uncertainty(self, scale: Array) -> Uncertainty:
        return _Posterior(self, scale) if self.settings.deviations == "model" else _HeldOut(self, scale)

    def readout(self, quantity: QuantityOfInterest, noise_scale: float = 1.0, mask: BoolArray | None = None) -> Readout:
        """Take data straight to a quantity, at one noise scale."""
        flags = check_mask(mask, self.functionals.count)
        scale = check_scale(noise_scale, 1)
        if flags is not None:
            again = PreparedMinimumVariance(
                self.settings, self.background, self.functionals, self.noise, self.steps, flags
            )
            return replace(again.readout(quantity, noise_scale), mask=flags)
        on_modes, _ = weights_of(quantity, self.background, len(self.steps))
        if self.settings.window == "cycle":
            directions = [_along(on_modes, self.anomalies)]
        else:
            directions = [on_modes[:, t] @ self.anomalies[:, t] for t in range(len(self.steps))]
        white = []
        for direction, (u, s, vt), floor in zip(directions, self.factors, self.floors, strict=True):
            level = float(np.hypot(scale[0], floor))
            white.append((direction @ vt.T * (s / (s**2 + level**2))) @ u.T)
        shape = (len(on_modes), int(self.keep.sum()), len(self.steps))
        whole = white[0].reshape(shape) if self.settings.window == "cycle" else np.stack(white, axis=2)
        gain = np.zeros((len(on_modes), self.functionals.count, len(self.steps)))
        gain[:, self.keep] = _whiten_transpose(self._kept_noise, whole)
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


@dataclass(frozen=True, eq=False)
class _Fold:
    """An estimate that has not seen some trajectories.

    Parameters
    ----------
    mask : (K,) bool array
        Who is held out.
    anomalies : (r, t, K') array
        Of the others.
    mean : (r, t) array
        Of the others, in the units of all anomalies.
    factors : list of (singular values, right vectors, projected held-out data)
        For each window.
    """

    mask: BoolArray
    anomalies: Array
    mean: Array
    factors: list[tuple[Array, Array, Array]]


class _HeldOut(Uncertainty):
    """Mean-square error on training trajectories held out in turn, plus the noise that comes through."""

    def __init__(self, prepared: PreparedMinimumVariance, scale: Array) -> None:
        self.prepared, self.scale = prepared, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; NaN for fewer than three samples."""
        p = self.prepared
        cycle = p.settings.window == "cycle"
        count = p.background.n_samples
        groups = [slice(None)] if cycle else [slice(t, t + 1) for t in range(len(p.steps))]
        full = [_along(on_modes[:, g], p.anomalies[:, g]) for g in groups]
        folds = [
            (
                fold,
                _along(on_modes, p.anomalies[:, :, fold.mask] - fold.mean[:, :, None]),
                [_along(on_modes[:, g], fold.anomalies[:, g]) for g in groups],
            )
            for fold in p.held_out
        ]
        out = np.empty((len(on_modes), len(self.scale)))
        for series, scale in enumerate(self.scale):
            noise = np.zeros(len(on_modes))
            for direction, (_, s, vt), floor in zip(full, p.factors, p.floors, strict=True):
                noise += ((direction @ vt.T * (s * scale / (s**2 + np.hypot(scale, floor) ** 2))) ** 2).sum(axis=1)
            error = np.full((len(on_modes), count), np.nan)
            for fold, truth, directions in folds:
                found = np.zeros_like(truth)
                for direction, (s, vt, data), floor in zip(directions, fold.factors, p.floors, strict=True):
                    gain = s / (s**2 + np.hypot(scale, floor) ** 2)
                    found += (direction @ vt.T * gain) @ data
                error[:, fold.mask] = truth - found
            # Anomalies are scaled by (K − 1)^(−1/2): undo that, then take the mean.
            out[:, series] = (error**2).mean(axis=1) * (count - 1) + noise
        return out


def _whiten_transpose(noise: NoiseModel, gain: Array, width: int = 256) -> Array:
    """Gains (s, m, t) on raw values, of gains on whitened ones; the whitening's matrix a few columns at a time."""
    m = gain.shape[1]
    out = np.empty_like(gain)
    for start in range(0, m, width):
        unit = np.zeros((m, min(width, m - start)))
        unit[start + np.arange(unit.shape[1]), np.arange(unit.shape[1])] = 1.0
        out[:, start : start + width] = np.einsum("smt,mi->sit", gain, noise.whiten(unit), optimize=True)
    return out


def _along(on_modes: Array, states: Array) -> Array:
    """Values (s, k) of functionals (s, t, r) of trajectories (r, t, k)."""
    return np.asarray(np.einsum("str,rtk->sk", on_modes, states, optimize=True))


class _Posterior(Uncertainty):
    """Error covariance of the estimate under the training set's distribution.

    What the training set cannot represent is counted where it disturbs the data (the floor), not in the
    state itself: with exact data the claimed deviations are too small.
    """

    def __init__(self, prepared: PreparedMinimumVariance, scale: Array) -> None:
        self.prepared, self.scale = prepared, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; there is no correction."""
        p = self.prepared
        out = np.empty((len(on_modes), len(self.scale)))
        if p.settings.window == "cycle":
            groups = [_along(on_modes, p.anomalies)]
        else:
            groups = [on_modes[:, t] @ p.anomalies[:, t] for t in range(len(p.steps))]
        for series, scale in enumerate(self.scale):
            left = np.zeros((len(on_modes), p.background.n_samples))
            noise = np.zeros(len(on_modes))
            for direction, (_, s, vt), floor in zip(groups, p.factors, p.floors, strict=True):
                level = float(np.hypot(scale, floor))
                along = direction @ vt.T
                left += direction - (along * (s**2 / (s**2 + level**2))) @ vt
                noise += ((along * (s * level / (s**2 + level**2))) ** 2).sum(axis=1)
            out[:, series] = (left**2).sum(axis=1) + noise
        return out
