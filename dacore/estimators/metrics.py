"""How PBDW weighs what the background leaves of the data: S = K + λN in place of the Gram matrix K.

Minimising ξ‖η‖²_M + ‖ℓ(v + η) − y‖²_{(σ²N)⁻¹} over η for a given v = offset + Φc gives η = M⁻¹ℓᵀz with
S z = y − ℓ(v), S = K + λN and λ = ξσ²; what is left to minimise over c is ‖y − ℓ(v)‖² in S⁻¹. λ = 0 is
PBDW as published, which reproduces the data; λ = ∞ is least squares weighted by the noise, without a
correction. One pencil K T = N T κ serves every λ between.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from dacore.algebra.blocks import Blocks, LowerBlocks
from dacore.algebra.gram import lower_solve, lower_transpose_solve
from dacore.core.arrays import Array, IntArray
from dacore.core.noise import NoiseModel, SensorNoise, WhiteNoise

# Below this share of the largest eigenvalue of the pencil, λ makes no difference but to round-off.
SMALLEST_RATIO = 1e-12


class Metric(ABC):
    """S = K + λN as a change of coordinates that is the same for every λ, and factors for one λ.

    ‖factors(λ) · turn(values)‖² is the square of values in S⁻¹, and back(factors(λ)² · turn(values)) is S⁻¹ values.
    """

    corrects = True

    @abstractmethod
    def turn(self, values: Array) -> Array:
        """Coordinates (m, ...) of values (m, ...)."""

    @abstractmethod
    def back(self, values: Array) -> Array:
        """Transpose of `turn`."""

    def factors(self, ratio: float) -> Array | None:
        """(m,) factors for λ = `ratio`; None for ones."""
        return None

    def noise_gram(self, columns: Array, ratio: float) -> Array:
        """Qᵀ C Q (n, n) of columns (m, n), with C the covariance of unit noise in coordinates times factors."""
        factors = self.factors(ratio)
        scaled = columns if factors is None else factors[:, None] * columns
        return np.asarray(scaled.T @ scaled)


@dataclass(frozen=True, eq=False)
class Exact(Metric):
    """λ = 0: S = K = R Rᵀ.

    Parameters
    ----------
    factor : LowerBlocks
        R.
    noise : NoiseModel
    """

    factor: LowerBlocks
    noise: NoiseModel

    def turn(self, values: Array) -> Array:
        """R⁻¹ values."""
        return lower_solve(self.factor, values)

    def back(self, values: Array) -> Array:
        """R⁻ᵀ values."""
        return lower_transpose_solve(self.factor, values)

    def noise_gram(self, columns: Array, ratio: float) -> Array:
        """(N^(½) R⁻ᵀ Q)ᵀ (N^(½) R⁻ᵀ Q)."""
        coloured = self.noise.colour_transpose(self.back(columns))
        return np.asarray(coloured.T @ coloured)


@dataclass(frozen=True, eq=False)
class NoiseWeighted(Metric):
    """λ = ∞: S = N, and nothing is corrected.

    Parameters
    ----------
    noise : NoiseModel
    """

    noise: NoiseModel
    corrects = False

    def turn(self, values: Array) -> Array:
        """N^(−½) values."""
        return self.noise.whiten(values)

    def back(self, values: Array) -> Array:
        """N^(−½)ᵀ values."""
        return whiten_transpose(self.noise, values)


@dataclass(frozen=True, eq=False)
class Pencil:
    """Transformation T with T N Tᵀ = I and T K Tᵀ = diag κ, block by block where the noise is independent.

    Parameters
    ----------
    values : (m,) array
        κ; the coordinates of a block stand where its rows stood.
    parts : tuple of ((c, k) int array, (k, k) array)
        Rows of equal blocks, and their T.
    """

    values: Array
    parts: tuple[tuple[IntArray, Array], ...]

    @classmethod
    def of(cls, gram: Blocks, noise: NoiseModel) -> "Pencil":
        """Decompose K against N once."""
        m = gram.size
        values, parts = np.zeros(m), []
        if isinstance(noise, WhiteNoise | SensorNoise):
            inverse = noise.whiten(np.ones(m))
            for places, block in gram.parts:
                # Equal blocks under equal noise are decomposed once.
                kinds, which = np.unique(inverse[places], axis=0, return_inverse=True)
                for kind, own in enumerate(kinds):
                    rows = places[which.ravel() == kind]
                    found, vectors = eigh(own[:, None] * block * own)
                    values[rows] = np.maximum(found, 0.0)
                    parts.append((rows, np.asarray(vectors.T * own)))
        else:
            whitening = noise.whiten(np.eye(m))
            found, vectors = eigh(whitening @ (gram @ whitening.T))
            values[:] = np.maximum(found, 0.0)
            parts.append((np.arange(m)[None], np.asarray(vectors.T @ whitening)))
        return cls(values, tuple(parts))

    def turn(self, values: Array, transposed: bool = False) -> Array:
        """T values, or Tᵀ values, for values (m, ...)."""
        flat = values.reshape(len(values), -1)
        out = np.empty(flat.shape)
        for places, transform in self.parts:
            beside = flat[places].swapaxes(0, 1)
            product = (transform.T if transposed else transform) @ beside.reshape(len(transform), -1)
            out[places] = product.reshape(beside.shape).swapaxes(0, 1)
        return out.reshape(values.shape)

    def representers(self, values: Array) -> Array:
        """Coordinates (m, ...) of observed states in orthonormal representers; zero where these are dependent."""
        seen = self.values > SMALLEST_RATIO * self.values.max(initial=0.0)
        root = np.where(seen, 1.0 / np.sqrt(np.where(seen, self.values, 1.0)), 0.0)
        return np.asarray(root.reshape(-1, *[1] * (values.ndim - 1)) * self.turn(values))


@dataclass(frozen=True, eq=False)
class Blended(Metric):
    """S = K + λN for any λ > 0.

    Parameters
    ----------
    pencil : Pencil
    """

    pencil: Pencil

    def turn(self, values: Array) -> Array:
        """T values."""
        return self.pencil.turn(values)

    def back(self, values: Array) -> Array:
        """Tᵀ values."""
        return self.pencil.turn(values, transposed=True)

    def factors(self, ratio: float) -> Array:
        """(κ + λ)^(−½)."""
        return np.asarray(1.0 / np.sqrt(self.pencil.values + ratio))


def whiten_transpose(noise: NoiseModel, values: Array, width: int = 256) -> Array:
    """N^(−½)ᵀ values for values (m, ...); the whitening's matrix a few columns at a time."""
    if isinstance(noise, WhiteNoise | SensorNoise):
        return noise.whiten(values)
    m = len(values)
    out = np.empty_like(values)
    for start in range(0, m, width):
        unit = np.zeros((m, min(width, m - start)))
        unit[start + np.arange(unit.shape[1]), np.arange(unit.shape[1])] = 1.0
        out[start : start + width] = np.tensordot(noise.whiten(unit).T, values, axes=1)
    return out
