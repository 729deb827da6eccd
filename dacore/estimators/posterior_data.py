"""Data of the whole window as a few hundred numbers, with what the forward map misses of them counted as noise.

With whitened functionals L and the modes Φ of trajectories, data say nothing about parameters outside the range of
LΦ. In its coordinates, turned so that the covariance of the forward map's own errors is diagonal, Λ, data are::

    y = g(θ) + η,    η ~ N(0, s² I + Λ)

for noise of scale s. What lies outside is noise alone and counts in the misfit only.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.estimators.posterior_emulator import Emulator
from dacore.estimators.posterior_errors import model_errors

# Deviations of errors below this share of the data's size are round-off.
_ROUND_OFF = 1e-9


@dataclass(frozen=True, eq=False)
class Compressed:
    """Data of k series.

    Parameters
    ----------
    values : (k, d) array
    rest : (k,) array
        Sum of squares, in units of the prepared noise, of what the compression leaves out.
    """

    values: Array
    rest: Array


class Observed:
    """What is measured of emulated trajectories.

    Parameters
    ----------
    emulator : Emulator
    background : Background
    functionals : Functionals
    noise : NoiseModel
    steps : (t,) int array
        Times observed.
    keep : (m,) bool array
        Functionals in use.

    Attributes
    ----------
    blocks : (1 + affine, n, d) array
        Polynomial weights of compressed data.
    errors : (d,) array
        Variances Λ of the forward map's own errors.
    misses : (d, K) array
        What the map misses of the training samples' data, each sample as if it were not one of them.
    count : int
        Number of raw values.
    """

    def __init__(
        self,
        emulator: Emulator,
        background: Background,
        functionals: Functionals,
        noise: NoiseModel,
        steps: IntArray,
        keep: BoolArray,
    ) -> None:
        self.emulator, self.steps, self.keep = emulator, steps, keep
        self.noise = noise if keep.all() else noise.marginal(keep)
        self.count = int(keep.sum()) * len(steps)
        seen = self.noise.whiten(background.observe(functionals.matrix)[keep])
        # Functionals first: there are often more of them than modes of the background.
        self._functionals, small = np.linalg.qr(seen)
        self._small = small
        r, _ = small.shape
        images = np.tensordot(small / emulator.scale, emulator.modes[:, steps], axes=1).reshape(r * len(steps), -1)
        u, s, vt = np.linalg.svd(images, full_matrices=False)
        kept = s > 1e-13 * s.max(initial=0.0)
        if not kept.any():
            kept[:1] = True
        u, onto = u[:, kept], s[kept, None] * vt[kept]
        self._mean = np.tensordot(small, emulator.mean[:, steps], axes=1).reshape(-1)
        misses = np.tensordot(small, emulator.errors[:, steps], axes=1).reshape(len(u), -1)
        within = u.T @ misses
        count = max(misses.shape[1], 1)
        stated = model_errors(emulator, background)
        grown = np.tensordot(small * stated.growth, emulator.errors[:, steps], axes=1).reshape(len(u), -1)
        grown = u.T @ grown
        anywhere = np.zeros((u.shape[1], u.shape[1]))
        for rows, variance in stated.even:
            part = np.tensordot(small[:, rows] / emulator.scale[rows], emulator.modes[rows][:, steps], axes=1)
            part = u.T @ part.reshape(len(u), -1)
            anywhere += variance * (part @ part.T)
        squares, turn = np.linalg.eigh(shrunk(grown) + anywhere)
        size = float((self._mean**2).mean() + (images**2).sum() / max(len(images), 1))
        self.errors = np.maximum(squares, _ROUND_OFF**2 * max(size, 1e-300))
        self.misses, self._grown, self._anywhere = turn.T @ within, turn.T @ grown, turn.T @ anywhere @ turn
        self._directions = u @ turn
        self.blocks = emulator.blocks(turn.T @ onto)
        outside = float(((misses - u @ within) ** 2).sum()) / count
        # The part of the model's error that lies outside is as large as the part within, at most.
        self.outside = (outside + float(self.errors.sum())) / self.count

    @property
    def dimension(self) -> int:
        """Number d of compressed values."""
        return len(self.errors)

    def compress(self, raw: Array) -> Compressed:
        """Compress raw data (m, t, k); those of functionals not in use are not looked at."""
        white = self.noise.whiten(raw[self.keep])
        inner = np.tensordot(self._functionals.T, white, axes=1)
        total = (white**2).sum(axis=(0, 1))
        away = inner.reshape(-1, raw.shape[2])
        # What the functionals' own modes do not reach, and then what trajectories do not reach.
        rest = total - (away**2).sum(axis=0)
        away = away - self._mean[:, None]
        values = self._directions.T @ away
        rest += (away**2).sum(axis=0) - (values**2).sum(axis=0)
        return Compressed(values.T, np.maximum(rest, 0.0))

    def of_trajectories(self, coefficients: Array) -> Array:
        """Compressed exact data (k, d) of trajectories (r, t, k) in the background's bases."""
        images = np.tensordot(self._small, coefficients[:, self.steps], axes=1).reshape(len(self._mean), -1)
        return np.asarray((self._directions.T @ (images - self._mean[:, None])).T)

    def variance(self, scale: Array) -> Array:
        """Variances (k, d) of the compressed data of series with noise of scales (k,)."""
        return np.asarray(scale[:, None] ** 2 + self.errors)

    def without(self, left_out: IntArray) -> Array:
        """Covariance (d, d) of the map's own errors without what some training samples say of it."""
        return np.asarray(shrunk(np.delete(self._grown, left_out, axis=1)) + self._anywhere)

    @cached_property
    def training(self) -> Array:
        """Compressed data (K, d) of the training samples, as emulated."""
        e = self.emulator
        return e.values(e.training, self.blocks)


def shrunk(samples: Array) -> Array:
    """Covariance (d, d) about zero of samples (d, k), with a floor for directions in which few of them say little.

    A share of the mean variance in all directions; the share is the one of least expected error. Source: Ledoit and
    Wolf, J. Multivar. Anal. 88 (2004) 365.
    """
    d, k = samples.shape
    if not k or not d:
        return np.zeros((d, d))
    found = samples @ samples.T / k
    mean = float(np.trace(found)) / d
    own = float((found**2).sum())
    away = own - d * mean**2
    noise = (float(((samples**2).sum(axis=0) ** 2).sum()) / k - own) / k
    share = min(max(noise / away, 0.0), 1.0) if away > 0 else 1.0
    return np.asarray((1.0 - share) * found + share * mean * np.eye(d))
