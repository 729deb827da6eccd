"""Do data look like what the training set would have measured? A wrong unit or sign passes every other check."""

import logging

import numpy as np

from dacore.core.arrays import Array
from dacore.core.noise import NoiseModel

logger = logging.getLogger(__name__)

# Unseen cases of the demo are within 1.1 times the range of the training set; a wrong unit is off by 10 or more.
_FACTOR = 3.0
_ALIGNED = 0.5


class Plausibility:
    """Sizes and directions of the training set's own data.

    Parameters
    ----------
    observed : (m, r) array
        Functionals of the background's modes.
    coefficients : (r, t, K) array
        Training set at the observed steps.
    noise : NoiseModel
        Of the m raw values: data in different units count alike.
    """

    def __init__(self, observed: Array, coefficients: Array, noise: NoiseModel) -> None:
        white = noise.whiten(observed)
        gram = white.T @ white
        mean = coefficients.mean(axis=2)
        images = np.tensordot(gram, coefficients, axes=1)
        squares = np.einsum("rtk,rtk->k", coefficients, images)
        self._sizes = np.sqrt(np.maximum(squares, 0.0))
        self._noise = noise
        self._white_mean = white @ mean
        self._mean_size = float(np.linalg.norm(self._white_mean))
        with np.errstate(divide="ignore", invalid="ignore"):
            alignment = np.einsum("rt,rtk->k", mean, images) / (self._sizes * self._mean_size)
        # Only where every sample points along the mean does the opposite direction mean something.
        self._directed = bool((alignment > _ALIGNED).all())

    def check(self, values: Array, scale: Array) -> None:
        """Warn, once for all series, of data (m, t, k) that no training sample resembles.

        Parameters
        ----------
        values : (m, t, k) array
            Raw data.
        scale : (k,) array
            Noise scale.
        """
        if not values.size or not self._sizes.any():
            return
        white = self._noise.whiten(values)
        largest = float(np.abs(white).max()) or 1.0  # divide before squaring
        flat = (white / largest).reshape(-1, values.shape[2])
        sizes = largest * np.linalg.norm(flat, axis=0)
        # What is surely more than noise; noise is no reason to call data too small.
        with np.errstate(over="ignore", invalid="ignore"):
            noise = scale * np.sqrt(len(flat) + 3.0 * np.sqrt(2.0 * len(flat)))
            surplus = np.sqrt(np.maximum(sizes - noise, 0.0)) * np.sqrt(sizes + noise)
        low, high = float(self._sizes.min()), float(self._sizes.max())
        big, small = surplus > _FACTOR * high, sizes < low / _FACTOR
        if big.any() or small.any():
            worst = sizes[big].max() / high if big.any() else sizes[small].min() / low
            logger.warning(
                "data: %d of %d series are out of proportion (%.2g times the training set's own data); "
                "check the unit of the data, or train on wider ranges", int((big | small).sum()), len(sizes), worst,
            )  # fmt: skip
        elif self._directed:
            along = np.einsum("mt,mtk->k", self._white_mean, white) / (self._mean_size * np.maximum(sizes, 1e-300))
            if (along < -_ALIGNED).any():
                logger.warning(
                    "data: %d of %d series point against every training sample; check the sign of the data and the "
                    "order of the functionals", int((along < -_ALIGNED).sum()), len(along),
                )  # fmt: skip
