"""Means and covariances of parameters whose coordinates have a Gaussian posterior.

The Gaussian stands for a likelihood times a Gaussian of the prior's moments. Coordinate by coordinate the prior itself,
which ends where the range ends, is put in that one's place: what nothing pins gets its prior's moments back, and the
mean of a parameter is not the parameter at the mean of its logarithm.
"""

import numpy as np

from dacore.core.arrays import Array
from dacore.estimators.posterior_coordinates import Coordinates

# Deviations to each side and points of a Gauss–Legendre rule there, which give eleven digits of a normal's moments.
_REACH, _POINTS = 8.0, 64


def moments(coordinates: Coordinates, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Mean (k, p) and covariance (k, p, p) of the parameters.

    Parameters
    ----------
    coordinates : Coordinates
    mean : (k, p) array
        Of the Gaussians, in coordinates, within the cube.
    covariance : (k, p, p) array
        In coordinates; correlations are kept. No parameter varies more than by its prior.
    """
    deviation = np.sqrt(np.einsum("kpp->kp", covariance))
    low, high = np.clip(mean - _REACH * deviation, -1.0, 1.0), np.clip(mean + _REACH * deviation, -1.0, 1.0)
    at, share = np.polynomial.legendre.leggauss(_POINTS)
    x = 0.5 * (low + high) + 0.5 * (high - low) * at[:, None, None]
    middle, spread = coordinates.prior_of_coordinates
    log_density = -0.5 * ((x - mean) / deviation) ** 2 + 0.5 * ((x - middle) / spread) ** 2 + coordinates.slope * x
    weights = share[:, None, None] * np.exp(log_density - log_density.max(axis=0))
    weights /= weights.sum(axis=0)
    values = coordinates.values(x)
    # About a value nearby, so that small deviations of large parameters keep their digits.
    near = coordinates.values(mean)
    shift = (weights * (values - near)).sum(axis=0)
    squares = (weights * (values - near - shift) ** 2).sum(axis=0)
    size = np.minimum(np.sqrt(squares), coordinates.prior) / deviation
    return np.asarray(near + shift), np.asarray(covariance * size[:, :, None] * size[:, None, :])
