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
        assumed = onto @ (model_errors(emulator, background)[:, None] * onto.T)
        squares, turn = np.linalg.eigh(within @ within.T / count + assumed)
        size = float((self._mean**2).mean() + (images**2).sum() / max(len(images), 1))
        self.errors = np.maximum(squares, _ROUND_OFF**2 * max(size, 1e-300))
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

    @cached_property
    def training(self) -> Array:
        """Compressed data (K, d) of the training samples, as emulated."""
        e = self.emulator
        return e.values(e.training, self.blocks)


def model_errors(emulator: Emulator, background: Background) -> Array:
    """Variances (q,) of the modes' coefficients from the accuracy that the forward map states.

    A map that is off by some share of a trajectory's norm is off in directions that nobody knows; its error is
    spread evenly over the modes.
    """
    if background.forward is None:
        return np.zeros(emulator.q)
    accuracy, total = background.forward.accuracy, 0.0
    for field in background.space.fields:
        rows = background.block(field.name)
        size = float((background.coefficients[rows] ** 2).sum() / background.n_samples)
        scale = float(emulator.scale[rows][0]) if rows.stop > rows.start else 0.0
        total += (accuracy[field.name] * scale) ** 2 * size
    return np.full(emulator.q, total / max(emulator.q, 1))
