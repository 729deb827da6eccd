"""Background spaces V_n in the coordinates of the training set: joint modes, means, tails.

A background keeps one orthonormal basis for each field; scaling the coefficients of field f by
√weight_f turns the weighted norm into the Euclidean one, so the joint POD of METHOD's section on
POD is a singular value decomposition of a small array.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.reduced import relative_tails
from dacore.errors import ShapeError

Centring = Literal["none", "cycle", "phase"]
Spaces = Literal["cycle", "phase"]
Weights = Mapping[str, float] | Literal["balanced"]


@dataclass(frozen=True, eq=False)
class Frame:
    """One affine background space: offset plus the span of joint modes.

    Parameters
    ----------
    modes : (r, n) array
        Coefficients of the modes in the background's bases, orthonormal in the weighted product.
    singular_values : (k,) array
    tails : (k + 1,) array
        ε̂_n, n = 0 … k.
    """

    modes: Array
    singular_values: Array
    tails: Array


def offsets(background: Background, steps: IntArray, centring: Centring) -> Array:
    """Offset coefficients (r, t): nothing, the mean of the cycle, or the mean of each phase."""
    if centring == "none":
        return np.zeros((background.dimension, len(steps)))
    mean = background.mean()[:, steps]
    if centring == "cycle":
        return np.repeat(mean.mean(axis=1, keepdims=True), len(steps), axis=1)
    return mean


def field_weights(background: Background, weights: Weights, fluctuations: Array) -> dict[str, float]:
    """Weight of each field; "balanced" is ζ = (max‖u‖ / max‖p‖)², METHOD's section on POD.

    Parameters
    ----------
    background : Background
    weights : mapping or "balanced"
        A field left out has weight 1.
    fluctuations : (r, ...) array
        Training coefficients less the offset: balancing looks at what varies.
    """
    names = [field.name for field in background.space.fields]
    if weights == "balanced":
        sizes = [np.linalg.norm(fluctuations[background.block(name)], axis=0).max() for name in names]
        return {name: float((sizes[0] / size) ** 2) for name, size in zip(names, sizes, strict=True)}
    if isinstance(weights, str):
        raise ShapeError(f"weights: got {weights!r}, expected 'balanced' or a number for each field")
    unknown = set(weights) - set(names)
    if unknown:
        raise ShapeError(f"weights: got the field {sorted(unknown)[0]!r}, expected one of {', '.join(names)}")
    for name, value in weights.items():
        if not (np.isfinite(value) and value > 0):
            raise ShapeError(f"weights.{name}: got {value}, expected a positive number")
    return {name: float(weights.get(name, 1.0)) for name in names}


def joint_frame(fluctuations: Array, scale: Array, max_dimension: int) -> Frame:
    """Joint POD of coefficients in the weighted product.

    Parameters
    ----------
    fluctuations : (r, K) array
    scale : (r,) array
        Square roots of the weights.
    max_dimension : int
        Modes to keep; all singular values are kept.
    """
    vectors, values, _ = np.linalg.svd(scale[:, None] * fluctuations, full_matrices=False)
    rank = int((values > 1e-13 * values[0]).sum()) if values[0] > 0 else 0
    n = min(max_dimension, rank)
    return Frame(vectors[:, :n] / scale[:, None], values, relative_tails(values))


def cross_validated_tails(
    fluctuations: Array, scale: Array, samples: IntArray, max_dimension: int, folds: int = 8
) -> Array:
    """ε̂_n measured on trajectories held out, n = 0 … max_dimension.

    A space of as many modes as there are samples represents its own training set exactly, so the
    tail of the singular values says nothing about unseen cases; this one does.

    Parameters
    ----------
    fluctuations : (r, N) array
    scale : (r,) array
    samples : (N,) int array
        The training trajectory that each column belongs to; it is left out as a whole.
    max_dimension : int
    folds : int

    Returns
    -------
    (max_dimension + 1,) array
        Continued with its last value where a fold has fewer modes.
    """
    scaled = scale[:, None] * fluctuations
    total = np.zeros(max_dimension + 1)
    folds = min(folds, int(samples.max()) + 1)
    for fold in range(folds if folds > 1 else 0):
        held_out, others = scaled[:, samples % folds == fold], scaled[:, samples % folds != fold]
        vectors, _, _ = np.linalg.svd(others, full_matrices=False)
        parts = (vectors.T @ held_out) ** 2
        outside = held_out - vectors @ (vectors.T @ held_out)
        left = np.append(np.cumsum(parts.sum(axis=1)[::-1])[::-1], 0.0) + (outside**2).sum()
        left = left[: max_dimension + 1]
        total += np.pad(left, (0, max_dimension + 1 - len(left)), mode="edge")
    if folds < 2 or total[0] == 0:
        return np.ones(max_dimension + 1)
    return np.asarray(np.sqrt(total / total[0]))
