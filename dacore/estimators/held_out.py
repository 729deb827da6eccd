"""Errors that PBDW claims: those on training trajectories held out in turn, and those of the noise.

Spaces built from all trajectories would reproduce each of them and claim no error as n approaches their number.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.estimator import Uncertainty

if TYPE_CHECKING:
    from dacore.estimators.prepared_pbdw import PreparedPBDW

# Trajectories that are estimated with noise, where an estimate is not affine in the data.
_SAMPLES = 64


class Linear(Uncertainty):
    """Mean-square error on trajectories held out in turn, plus the noise that comes through.

    Parameters
    ----------
    prepared : PreparedPBDW
    used, ratios : (spaces, k) arrays
        n and λ of each series.
    scale : (k,) array
    """

    def __init__(self, prepared: "PreparedPBDW", used: IntArray, ratios: Array, scale: Array) -> None:
        self.prepared, self.used, self.ratios, self.scale = prepared, used, ratios, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; NaN for fewer than three samples."""
        both = np.concatenate([self.used, self.ratios])
        kinds, which = np.unique(both, axis=1, return_inverse=True)
        spaces = len(self.used)
        missed, noise = np.empty((2, len(on_modes), kinds.shape[1]))
        for number, kind in enumerate(kinds.T):
            used, ratios = kind[:spaces].astype(int), kind[spaces:]
            missed[:, number], noise[:, number] = self._of(used, ratios, on_modes, on_correction, None)
        which = which.ravel()
        return np.asarray(missed[:, which] + noise[:, which] * self.scale**2)

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s,) of functionals (s, r) of one state of one series."""
        extra = None if on_correction is None else on_correction[:, None]
        used, ratios = self.used[:, series].astype(int), self.ratios[:, series]
        missed, noise = self._of(used, ratios, on_modes[:, None], extra, [step])
        return np.asarray(missed + noise * self.scale[series] ** 2)

    def _of(
        self, used: IntArray, ratios: Array, on_modes: Array, on_correction: Array | None, steps: Sequence[int] | None
    ) -> tuple[Array, Array]:
        p = self.prepared
        chosen = slice(None) if steps is None else list(steps)
        training = p.background.coefficients[:, p.steps[chosen]]
        error = np.full((len(on_modes), training.shape[2]), np.nan)
        for fold in p.without:
            gain = p.gain(used, ratios, on_modes, on_correction, fold.projection, steps)
            through = np.einsum("smt,mr->str", gain, p.observed_modes, optimize=True)
            away = training[:, :, fold.mask] - fold.projection.offset[:, chosen, None]
            error[:, fold.mask] = np.einsum("str,rtk->sk", on_modes - through, away, optimize=True)
        gain = p.gain(used, ratios, on_modes, on_correction, None, steps)
        coloured = p.noise.colour_transpose(gain.swapaxes(0, 1))
        return (error**2).mean(axis=1), np.asarray((coloured**2).sum(axis=(0, 2)))


class Sampled(Uncertainty):
    """Mean-square error on trajectories held out in turn, measured with noise that is drawn once.

    For estimates that are not affine in the data: the same noise every time, so that it says the same twice.

    Parameters
    ----------
    prepared : PreparedPBDW
    scale : (k,) array
    used : (spaces, k) int array
        n of each series, used where data do not choose it.
    """

    def __init__(self, prepared: "PreparedPBDW", scale: Array, used: IntArray) -> None:
        self.prepared, self.scale, self.used = prepared, scale, used

    @cached_property
    def _errors(self) -> list[tuple[BoolArray, Array, Array | None]]:
        """Series of equal noise and n, with errors of coefficients (r, t, j) and weights of corrections (m, t, j)."""
        by_data = self.prepared.settings.n in ("gcv", "discrepancy")
        kinds = np.concatenate([self.scale[None], self.used * (not by_data)])
        found = []
        for kind in np.unique(kinds, axis=1).T:
            away, z = self._of(float(kind[0]), None if by_data else kind[1:].astype(int))
            found.append(((kinds == kind[:, None]).all(axis=0), away, z))
        return found

    def _of(self, scale: float, used: IntArray | None) -> tuple[Array, Array | None]:
        p = self.prepared
        training = p.background.coefficients[:, p.steps]
        chosen = np.arange(0, training.shape[2], max(training.shape[2] // _SAMPLES, 1))
        rng = np.random.default_rng(0)
        noise = p.noise.sample(rng, (p.functionals.count, len(p.steps), len(chosen)))
        aways, corrections = [], []
        for fold in p.without:
            mine = fold.mask[chosen]
            truth = training[:, :, chosen[mine]]
            values = (np.tensordot(p.observed_modes, truth, axes=1) + scale * noise[:, :, mine])[p.keep]
            coefficients, z = p.estimated(fold, values, np.full(int(mine.sum()), scale), used)
            aways.append(truth - coefficients)
            if z is not None:
                corrections.append(z)
        away = np.concatenate(aways, axis=2) if aways else np.full((*training.shape[:2], 1), np.nan)
        return away, np.concatenate(corrections, axis=2) if corrections else None

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; NaN for fewer than three samples."""
        out = np.empty((len(on_modes), len(self.scale)))
        for series, away, z in self._errors:
            error = np.einsum("str,rtk->sk", on_modes, away, optimize=True)
            if on_correction is not None and z is not None:
                error -= np.einsum("stm,mtk->sk", on_correction[:, :, self.prepared.keep], z, optimize=True)
            out[:, series] = (error**2).mean(axis=1)[:, None]
        return out

    def at(self, step: int, series: int, steps: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s,) of functionals (s, r) of one state of one series."""
        away, z = next((away, z) for who, away, z in self._errors if who[series])
        error = on_modes @ away[:, step]
        if on_correction is not None and z is not None:
            error -= on_correction[:, self.prepared.keep] @ z[:, step]
        return np.asarray((error**2).mean(axis=1))
