"""Noise on the measurements of unseen cases (docs/method.md: Noise)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.display import Displayed


def noisy(clean: Array, level: float, seed: int) -> tuple[Array, Array]:
    """Add noise of σ = Ξ max|ℓ_i(u(t))|, a σ for each case.

    Parameters
    ----------
    clean : (m, t, k) array
    level : float
        Ξ.
    seed : int
        Each level and case has a stream of its own, so adding one changes no other.

    Returns
    -------
    data : (m, t, k) array
    sigmas : (k,) array
    """
    sigmas = level * np.abs(clean).max(axis=(0, 1))
    data = clean.copy()
    if level > 0:
        for case in range(clean.shape[2]):
            rng = np.random.default_rng([seed, round(level * 1e9), case])
            data[:, :, case] += sigmas[case] * rng.standard_normal(clean.shape[:2])
    return data, sigmas


@dataclass(frozen=True, eq=False, repr=False)
class NoisyData(Displayed):
    """The measurements of the unseen cases at several noise levels.

    Parameters
    ----------
    clean : (m, t, k) array
    data : mapping of float to (m, t, k) array
    sigmas : mapping of float to (k,) array
        Standard deviation of the noise of each case.
    steps : (s,) int array, optional
        Which of the t steps an estimator is given; None for all.
    """

    clean: Array
    data: Mapping[float, Array]
    sigmas: Mapping[float, Array]
    steps: IntArray | None = None

    @classmethod
    def drawn(cls, clean: Array, levels: Sequence[float], seed: int, steps: IntArray | None = None) -> "NoisyData":
        """Add noise of every level: the same at a step, whichever others are given."""
        both = {level: noisy(clean, level, seed) for level in levels}
        data = {level: one for level, (one, _) in both.items()}
        return cls(clean, data, {level: sigma for level, (_, sigma) in both.items()}, steps)

    def given(self, level: float) -> Array:
        """What an estimator is given, (m, s, k)."""
        return self.data[level] if self.steps is None else self.data[level][:, self.steps]
