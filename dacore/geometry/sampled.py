"""A level set sampled on a regular grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates
from scipy.special import ndtri

from dacore.core.arrays import Array, BoolArray

_TAIL = 1e-4


@dataclass(frozen=True, eq=False)
class SampledLevelSet:
    """Trilinear interpolation of samples; outside the grid the nearest sample counts.

    Parameters
    ----------
    samples : (a, b, c) array
    origin : (3,) array
        Position of the first sample.
    spacing : float
        Distance of neighbouring samples, in the unit of `origin`.
    """

    samples: NDArray[np.floating]
    origin: Array
    spacing: float

    def __call__(self, points: Array) -> Array:
        """Values (n,) at points (n, 3)."""
        index = (points - self.origin) / self.spacing
        return np.asarray(map_coordinates(self.samples, index.T, output=np.float64, order=1, mode="nearest"))

    def placed(self, scale: float, shift: Array) -> "SampledLevelSet":
        """The level set in coordinates ``scale * x + shift``; values scale as lengths do."""
        return SampledLevelSet(self.samples * scale, self.origin * scale + shift, self.spacing * scale)


def smooth_distance(mask: BoolArray, sigma: float, level: float = 0.5) -> Array:
    """Signed distance, in samples, to the smoothed outline of a mask.

    The mask blurred by a Gaussian is Φ(−d/σ) at distance d from a flat outline, so −σ Φ⁻¹ of the
    blurred mask is the signed distance there, far more exact than distances between samples. Where
    the blur has died out, distances between samples continue it. A sphere's outline of radius r moves
    inwards by σ²/r.

    Parameters
    ----------
    mask : (a, b, c) bool array
        True inside.
    sigma : float
        Width of the Gaussian in samples, at least 1.
    level : float
        Value of the blurred mask on the outline.

    Returns
    -------
    (a, b, c) array
        Negative inside.
    """
    blurred = gaussian_filter(mask.astype(np.float32), sigma, mode="nearest").astype(np.float64)
    # The sum over samples is that of a Gaussian narrower by the variance of a sample's width.
    width = np.sqrt(sigma**2 - 1.0 / 12.0)
    near = -width * (ndtri(np.clip(blurred, _TAIL, 1.0 - _TAIL)) - ndtri(level))
    far = distance_transform_edt(~mask) - distance_transform_edt(mask)
    dead = (blurred < 10.0 * _TAIL) | (blurred > 1.0 - 10.0 * _TAIL)
    return np.asarray(np.where(dead & (np.abs(far) > np.abs(near)), far, near), dtype=np.float64)
