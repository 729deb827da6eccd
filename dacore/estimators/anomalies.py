"""What minimum variance keeps of observed anomalies, what it claims of its errors, and what it expects of data."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from dacore.algebra.svd import thin_svd
from dacore.core.arrays import Array, BoolArray
from dacore.core.estimator import Uncertainty
from dacore.core.misfit import Misfit
from dacore.estimators.surprise import matched

if TYPE_CHECKING:
    from dacore.estimators.minimum_variance import PreparedMinimumVariance

# Rows are taken away from a decomposition while the directions that are left keep this share of their squared length:
# round-off grows with its inverse.
_SMALLEST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Factors:
    """Singular value decomposition U Σ Vᵀ of whitened observed anomalies (rows, K), with U in two factors.

    Parameters
    ----------
    base : (rows, k) array
    turn : (k, k) array or None
        U = base · turn; None for the identity.
    s : (k,) array
    vt : (k, K) array
    """

    base: Array
    turn: Array | None
    s: Array
    vt: Array

    @classmethod
    def of(cls, window: Array) -> "Factors":
        """Decompose anomalies."""
        u, s, vt = thin_svd(window)
        return cls(u, None, s, vt)

    @property
    def size(self) -> int:
        """Number of observed values times the number of samples."""
        return len(self.base) * int(self.vt.shape[1])

    def of_rows(self, keep: BoolArray) -> "Factors":
        """The decomposition of some of the rows (rows,).

        With U_d the rows that are left out and CᵀC = I − U_dᵀU_d, the others are QCΣVᵀ, so that a decomposition of the
        small CΣVᵀ is enough. The columns keep their scales, so small singular values are as accurate as
        large ones; where hardly anything is left of a direction, the rows are decomposed anew.
        """
        base = self.base if self.turn is None else self.base @ self.turn
        left = base[~keep]
        gram = np.eye(base.shape[1]) - left.T @ left
        if len(self.base) < base.shape[1] or np.linalg.eigvalsh(gram)[0] < _SMALLEST_SHARE:
            return Factors.of((base[keep] * self.s) @ self.vt)
        c = np.asarray(cholesky(gram, check_finite=False))
        u, s, vt = thin_svd((c * self.s) @ self.vt)
        return Factors(base[keep], np.asarray(solve_triangular(c, u, check_finite=False)), s, vt)

    def split(self, window: Array) -> tuple[Array, Array]:
        """Coordinates Uᵀw (k, j) of whitened data (rows, j), and the squares (j,) of what U leaves of them."""
        along = self.base.T @ window
        if self.turn is not None:
            along = self.turn.T @ along
        return along, ((window - self.spread(along)) ** 2).sum(axis=0)

    def spread(self, values: Array) -> Array:
        """U times values (k, j)."""
        return np.asarray(self.base @ (values if self.turn is None else self.turn @ values))


@dataclass(frozen=True, eq=False)
class Fold:
    """An estimate that has not seen some trajectories.

    Parameters
    ----------
    mask : (K,) bool array
        Who is held out.
    anomalies : (r, T, K') array
        Of the others.
    mean : (r, T) array
        Of the others, in the units of all anomalies.
    factors : list of (singular values, right vectors, projected held-out data)
        For each window.
    """

    mask: BoolArray
    anomalies: Array
    mean: Array
    factors: list[tuple[Array, Array, Array]]


def innovation(prepared: "PreparedMinimumVariance", seen: Sequence[tuple[Array, Array]], scale: Array) -> Misfit | None:
    """Data less the training mean, under the training covariance, the floors and the noise.

    Parameters
    ----------
    prepared : PreparedMinimumVariance
    seen : sequence of ((k, j), (j,)) arrays
        For each window, squared coordinates of the data and the squares of what is left.
    scale : (j,) array

    Returns
    -------
    Misfit, or None for fewer than three samples
    """
    count = prepared.background.n_samples
    if count < 3:
        return None
    beyond_training = prepared.unlearned
    statistic, mean, variance = np.zeros((3, len(scale)))
    levels, which = np.unique(scale, return_inverse=True)
    which = which.ravel()
    for number, level in enumerate(levels):
        mine, right, square = which == number, np.zeros(count), float(level) ** 2
        missing = 0.0
        for (squares, left), each, floor in zip(seen, prepared.factors, prepared.floors, strict=True):
            total = square + max(floor**2, beyond_training)
            signal, rest = 1.0 / (each.s**2 + total), 1.0 / total
            # Noise fills the directions of the anomalies and all others.
            beyond = max(len(each.base) - len(each.s), 0)
            all_along = signal.sum() + beyond * rest
            missing += beyond_training * all_along
            statistic[mine] += signal @ squares[:, mine] + rest * left[mine]
            mean[mine] += square * all_along
            variance[mine] += 2.0 * square**2 * ((signal**2).sum() + beyond * rest**2)
            own, steep = _left_out(each, total, count)
            right += own
            variance[mine] += 4.0 * square * steep.mean()
        mean[mine] += right.mean() + missing
        variance[mine] += right.var() + 2.0 * missing**2
    return matched(statistic, mean, variance)


def _left_out(factors: Factors, total: float, count: int) -> tuple[Array, Array]:
    """For exact data x of each sample, xᵀC⁻¹x and xᵀC⁻²x with the covariance C of the other samples.

    Leaving one sample out takes a matrix of rank one away, so nothing is decomposed again (Sherman and Morrison).
    """
    scaled = (count - 1) / (count - 2)
    inverse = 1.0 / (scaled * factors.s**2 + total)
    parts = (factors.s[:, None] * factors.vt) ** 2
    shares = inverse @ parts
    free = np.maximum(1.0 - scaled * count / (count - 1) * shares, 1e-12)
    # A sample is farther from the mean of the others than from that of all.
    unit = (count - 1) * (count / (count - 1)) ** 2
    return unit * shares / free, unit * (inverse**2 @ parts) / free**2


class Anomalous(Uncertainty):
    """Error covariance of a minimum-variance estimate, which has no correction."""

    def __init__(self, prepared: "PreparedMinimumVariance", scale: Array) -> None:
        self.prepared, self.scale = prepared, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory."""
        return self._of(on_modes, slice(None), self.scale)

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s,) of functionals (s, r) of one state of one series."""
        return self._of(on_modes[:, None], slice(step, step + 1), self.scale[series : series + 1])[:, 0]

    @abstractmethod
    def _of(self, on_modes: Array, times: slice, scales: Array) -> Array:
        """Variance (s, k) of functionals (s, t, r) of some of the states, at k noise scales."""


class HeldOut(Anomalous):
    """Mean-square error on training trajectories held out in turn, plus the noise that comes through.

    What compression and reduced training leave out of the data comes through as noise does. NaN for fewer than
    three samples.
    """

    def _of(self, on_modes: Array, times: slice, scales: Array) -> Array:
        """Variance (s, k) of functionals (s, t, r) of some of the states, at k noise scales."""
        p = self.prepared
        cycle = p.settings.window == "cycle"
        count, beyond = p.background.n_samples, float(np.sqrt(p.unlearned))
        groups = [slice(None)] if cycle else [slice(t, t + 1) for t in range(on_modes.shape[1])]
        # A window that is the whole cycle is used for each of its steps.
        used = slice(None) if cycle else times
        factors, floors, anomalies = p.factors[used], p.floors[used], p.anomalies[:, times]
        full = [along(on_modes[:, g], anomalies[:, g]) for g in groups]
        folds = [
            (
                fold,
                along(on_modes, anomalies[:, :, fold.mask] - fold.mean[:, times, None]),
                [along(on_modes[:, g], fold.anomalies[:, times][:, g]) for g in groups],
            )
            for fold in p.held_out
        ]
        out = np.empty((len(on_modes), len(scales)))
        for series, scale in enumerate(scales):
            noise = np.zeros(len(on_modes))
            for direction, each, floor in zip(full, factors, floors, strict=True):
                gain = each.s * np.hypot(scale, beyond) / (each.s**2 + np.hypot(scale, floor) ** 2)
                noise += ((direction @ each.vt.T * gain) ** 2).sum(axis=1)
            error = np.full((len(on_modes), count), np.nan)
            for fold, truth, directions in folds:
                found = np.zeros_like(truth)
                for direction, (s, vt, data), floor in zip(directions, fold.factors[used], floors, strict=True):
                    gain = s / (s**2 + np.hypot(scale, floor) ** 2)
                    found += (direction @ vt.T * gain) @ data
                error[:, fold.mask] = truth - found
            # Anomalies are scaled by (K − 1)^(−1/2): undo that, then take the mean.
            out[:, series] = (error**2).mean(axis=1) * (count - 1) + noise
        return out


def along(on_modes: Array, states: Array) -> Array:
    """Values (s, k) of functionals (s, t, r) of trajectories (r, t, k)."""
    return np.asarray(np.einsum("str,rtk->sk", on_modes, states, optimize=True))


class Posterior(Anomalous):
    """Error covariance of the estimate under the training set's distribution.

    What the training set cannot represent is counted where it disturbs the data (the floor), not in the
    state itself: with exact data the claimed deviations are too small.
    """

    def _of(self, on_modes: Array, times: slice, scales: Array) -> Array:
        """Variance (s, k) of functionals (s, t, r) of some of the states, at k noise scales."""
        p = self.prepared
        out = np.empty((len(on_modes), len(scales)))
        cycle, anomalies = p.settings.window == "cycle", p.anomalies[:, times]
        used = slice(None) if cycle else times
        if cycle:
            groups = [along(on_modes, anomalies)]
        else:
            groups = [on_modes[:, t] @ anomalies[:, t] for t in range(on_modes.shape[1])]
        for series, scale in enumerate(scales):
            left = np.zeros((len(on_modes), p.background.n_samples))
            noise = np.zeros(len(on_modes))
            for direction, each, floor in zip(groups, p.factors[used], p.floors[used], strict=True):
                s, level = each.s, float(np.hypot(scale, floor))
                parts = direction @ each.vt.T
                left += direction - (parts * (s**2 / (s**2 + level**2))) @ each.vt
                noise += ((parts * (s * level / (s**2 + level**2))) ** 2).sum(axis=1)
            out[:, series] = (left**2).sum(axis=1) + noise
        return out
