"""Noise of the raw measured values."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.display import Displayed
from dacore.errors import ShapeError


class NoiseModel(ABC):
    """Zero-mean Gaussian noise of the m raw values of one time, independent between times."""

    @abstractmethod
    def colour(self, white: Array) -> Array:
        """Turn independent unit normals (m, ...) into noise (m, ...).

        Parameters
        ----------
        white : (m, ...) array

        Returns
        -------
        (m, ...) array [unit of the values]
        """

    @abstractmethod
    def whiten(self, values: Array) -> Array:
        """Inverse of `colour`.

        Parameters
        ----------
        values : (m, ...) array [unit of the values]

        Returns
        -------
        (m, ...) array
        """

    @abstractmethod
    def colour_transpose(self, weights: Array) -> Array:
        """Transpose of `colour` on weights (m, ...): the variance of wᵀε is ‖colour_transpose(w)‖².

        Parameters
        ----------
        weights : (m, ...) array

        Returns
        -------
        (m, ...) array
        """

    @abstractmethod
    def marginal(self, mask: BoolArray) -> "NoiseModel":
        """Noise of the functionals that `mask` (m,) keeps.

        Parameters
        ----------
        mask : (m,) bool array

        Returns
        -------
        NoiseModel
        """

    def sample(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Draw noise of shape (m, ...).

        Parameters
        ----------
        rng : numpy.random.Generator
        shape : tuple of int
            Beginning with m.

        Returns
        -------
        array of that shape [unit of the values]
        """
        return self.colour(rng.standard_normal(shape))


# Whitened values are squared: beyond these, squares of ordinary data overflow or vanish.
_SMALLEST, _LARGEST = 1e-100, 1e100


def check_deviations(sigmas: Array) -> None:
    """Raise ShapeError unless all standard deviations (m,) are positive and of a size that can be squared.

    Parameters
    ----------
    sigmas : (m,) array

    Raises
    ------
    ShapeError
        If one is not positive, or of no size that can be squared.
    """
    wrong = ~((sigmas >= _SMALLEST) & (sigmas <= _LARGEST))
    if wrong.any():
        raise ShapeError(
            f"noise: got a standard deviation of {sigmas[wrong][0]}, expected a positive number from {_SMALLEST:g} to "
            f"{_LARGEST:g}; the level of the noise is given to estimate as noise_scale"
        )


@dataclass(frozen=True)
class WhiteNoise(NoiseModel):
    """Independent noise of one standard deviation.

    Parameters
    ----------
    sigma : float [unit of the measured values]
    """

    sigma: float = 1.0

    def __post_init__(self) -> None:
        check_deviations(np.array([self.sigma]))

    def colour(self, white: Array) -> Array:
        """σ · white."""
        return self.sigma * white

    def whiten(self, values: Array) -> Array:
        """Divide by σ."""
        return values / self.sigma

    def colour_transpose(self, weights: Array) -> Array:
        """σ · weights."""
        return self.sigma * weights

    def marginal(self, mask: BoolArray) -> "WhiteNoise":
        """Itself."""
        return self


@dataclass(frozen=True, eq=False, repr=False)
class SensorNoise(Displayed, NoiseModel):
    """Independent noise with a standard deviation for each functional.

    Parameters
    ----------
    sigmas : (m,) array
    """

    sigmas: Array

    def __post_init__(self) -> None:
        check_deviations(self.sigmas)

    def colour(self, white: Array) -> Array:
        """Scale each row."""
        return white * self.sigmas.reshape(-1, *[1] * (white.ndim - 1))

    def whiten(self, values: Array) -> Array:
        """Divide each row."""
        return values / self.sigmas.reshape(-1, *[1] * (values.ndim - 1))

    def colour_transpose(self, weights: Array) -> Array:
        """Scale each row."""
        return self.colour(weights)

    def marginal(self, mask: BoolArray) -> "SensorNoise":
        """Keep some rows."""
        return SensorNoise(self.sigmas[mask])


class CorrelatedNoise(Displayed, NoiseModel):
    """Noise with a full covariance between the functionals.

    Parameters
    ----------
    covariance : (m, m) array
        Symmetric positive definite.
    """

    def __init__(self, covariance: Array) -> None:
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.ndim != 2 or not np.allclose(matrix, matrix.T, rtol=1e-10, atol=0.0):
            raise ShapeError(f"noise: got a covariance of shape {matrix.shape}, expected a finite symmetric matrix")
        try:
            self.factor = np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError as error:
            raise ShapeError("noise: the covariance is not symmetric positive definite") from error

    def colour(self, white: Array) -> Array:
        """Lower Cholesky factor times white."""
        return np.tensordot(self.factor, white, axes=1)

    def whiten(self, values: Array) -> Array:
        """Solve with the lower Cholesky factor."""
        from scipy.linalg import solve_triangular

        flat = values.reshape(values.shape[0], -1)
        return np.asarray(solve_triangular(self.factor, flat, lower=True)).reshape(values.shape)

    def colour_transpose(self, weights: Array) -> Array:
        """Transposed lower Cholesky factor times weights."""
        return np.tensordot(self.factor.T, weights, axes=1)

    def marginal(self, mask: BoolArray) -> "CorrelatedNoise":
        """Keep some rows and columns of the covariance."""
        return CorrelatedNoise((self.factor @ self.factor.T)[np.ix_(mask, mask)])
