"""Background spaces V_n in the coordinates of the training set: joint modes, means, tails.

A background keeps one orthonormal basis for each field; scaling the coefficients of field f by
√weight_f turns the weighted norm into the Euclidean one, so the joint POD (docs/method.md: The training
set) is a singular value decomposition of a small array.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dacore.algebra.svd import condensed, left_svd
from dacore.core.arrays import Array, BoolArray
from dacore.core.background import Background
from dacore.core.reduced import relative_tails
from dacore.errors import ShapeError

# Groups of trajectories that are held out in turn.
FOLDS = 8

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


def offset_of(coefficients: Array, centring: Centring) -> Array:
    """Offset (r, t) of coefficients (r, t, K): nothing, the mean of the cycle, or the mean of each phase."""
    if centring == "none":
        return np.zeros(coefficients.shape[:2])
    mean = np.asarray(coefficients.mean(axis=2))
    if centring == "cycle":
        return np.repeat(mean.mean(axis=1, keepdims=True), mean.shape[1], axis=1)
    return mean


def field_weights(background: Background, weights: Weights, fluctuations: Array) -> dict[str, float]:
    """Weight of each field; "balanced" is ζ = (max‖u‖ / max‖p‖)² (docs/method.md: The training set).

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
        return balanced_weights(background, fluctuations)
    if isinstance(weights, str):
        raise ShapeError(f"weights: got {weights!r}, expected 'balanced' or a number for each field")
    check_fields(weights, names)
    for name, value in weights.items():
        if not (np.isfinite(value) and value > 0):
            raise ShapeError(f"weights.{name}: got {value}, expected a positive number")
    return {name: float(weights.get(name, 1.0)) for name in names}


def check_fields(weights: Mapping[str, float], names: Sequence[str]) -> None:
    """Raise ShapeError if a weight is given for a field that the state does not have."""
    unknown = set(weights) - set(names)
    if unknown:
        raise ShapeError(f"weights: got the field {sorted(unknown)[0]!r}, expected one of {', '.join(names)}")


def balanced_weights(background: Background, fluctuations: Array) -> dict[str, float]:
    """ζ = (max‖u‖ / max‖p‖)² over training coefficients (r, ...); 1 for a field that does not vary."""
    names = [field.name for field in background.space.fields]
    sizes = [float(np.linalg.norm(fluctuations[background.block(name)], axis=0).max()) for name in names]
    return {
        name: (sizes[0] / size) ** 2 if size > 0 and sizes[0] > 0 else 1.0
        for name, size in zip(names, sizes, strict=True)
    }


def build_frames(
    coefficients: Array, offset: Array, scale: Array, spaces: Spaces, max_dimension: int
) -> tuple[Frame, ...]:
    """Joint POD of coefficients in the weighted product: one space, or one for each phase.

    Parameters
    ----------
    coefficients : (r, t, K) array
    offset : (r, t) array
    scale : (r,) array
        Square roots of the weights.
    spaces : {"cycle", "phase"}
    max_dimension : int
        Modes to keep; all singular values are kept.

    Raises
    ------
    ShapeError
        If the training set does not vary at all.
    """
    fluctuations = scale[:, None, None] * (coefficients - offset[:, :, None])
    if spaces == "phase":
        sets = [fluctuations[:, k] for k in range(fluctuations.shape[1])]
    else:
        sets = [fluctuations.reshape(len(scale), -1)]
    size = float(np.linalg.norm(scale[:, None, None] * coefficients))
    frames = tuple(_frame(data, scale, max_dimension, size) for data in sets)
    if not any(frame.modes.shape[1] for frame in frames):
        raise ShapeError(
            "training set: all trajectories are the same, so there is no space to build; train on more than one "
            "sample, or give a parameter a range"
        )
    return frames


def _frame(scaled: Array, scale: Array, max_dimension: int, size: float) -> Frame:
    """Modes of one set; none where nothing varies, as at a time when a load has not begun."""
    vectors, values = left_svd(scaled)
    # What is left of equal trajectories less their mean is rounding.
    rank = int((values > 1e-13 * values[0]).sum()) if values[0] > 1e-13 * size else 0
    return Frame(vectors[:, : min(max_dimension, rank)] / scale[:, None], values, relative_tails(values))


def fold_masks(count: int, folds: int) -> list[BoolArray]:
    """Split samples into groups to hold out in turn: masks (count,), none if there are too few."""
    folds = min(folds, count)
    return [np.arange(count) % folds == fold for fold in range(folds)] if count > 2 else []


@dataclass(frozen=True, eq=False)
class Fold:
    """Spaces built without some of the trajectories.

    Parameters
    ----------
    mask : (K,) bool array
        Who is held out.
    offset : (r, t) array
        Of the others.
    frames : tuple of Frame
        Of the others: one, or one for each phase.
    """

    mask: BoolArray
    offset: Array
    frames: tuple[Frame, ...]


def held_out_frames(
    coefficients: Array, centring: Centring, scale: Array, spaces: Spaces, max_dimension: int, folds: int = FOLDS
) -> list[Fold]:
    """Build the spaces again without each group of trajectories in turn.

    Spaces of one phase are built in the few directions its trajectories have, which all groups share.

    Parameters
    ----------
    coefficients : (r, t, K) array
    centring : {"none", "cycle", "phase"}
    scale : (r,) array
    spaces : {"cycle", "phase"}
    max_dimension : int
    folds : int
        Groups; none are made of fewer than three samples.
    """
    masks = fold_masks(coefficients.shape[2], folds)
    offsets = [offset_of(coefficients[:, :, ~mask], centring) for mask in masks]
    if spaces == "cycle":
        return [
            Fold(mask, offset, build_frames(coefficients[:, :, ~mask], offset, scale, spaces, max_dimension))
            for mask, offset in zip(masks, offsets, strict=True)
        ]
    frames: list[list[Frame]] = [[] for _ in masks]
    for k in range(coefficients.shape[1] if masks else 0):
        directions, parts = condensed(scale[:, None] * coefficients[:, k])
        size = float(np.linalg.norm(parts))
        for mask, offset, found in zip(masks, offsets, frames, strict=True):
            middle = directions.T @ (scale * offset[:, k])
            small = _frame(parts[:, ~mask] - middle[:, None], np.ones(len(parts)), max_dimension, size)
            found.append(replace(small, modes=(directions @ small.modes) / scale[:, None]))
    return [Fold(*each) for each in zip(masks, offsets, map(tuple, frames), strict=True)]


def held_out_tails(coefficients: Array, scale: Array, folds: Sequence[Fold], max_dimension: int) -> list[Array]:
    """ε̂_n of each space, measured on trajectories held out, n = 0 … max_dimension.

    A space of as many modes as there are samples represents its own training set exactly, so the
    tail of the singular values says nothing about unseen cases; this one does. The offset, too, is that
    of the other trajectories.

    Parameters
    ----------
    coefficients : (r, t, K) array
    scale : (r,) array
    folds : sequence of Fold
    max_dimension : int

    Returns
    -------
    list of (max_dimension + 1,) arrays
        Continued with its last value where a fold has fewer modes; all ones for fewer than three samples.
    """
    count = len(folds[0].frames) if folds else coefficients.shape[1]
    totals = np.zeros((count, max_dimension + 1))
    for fold in folds:
        held = scale[:, None, None] * (coefficients[:, :, fold.mask] - fold.offset[:, :, None])
        for k, frame in enumerate(fold.frames):
            data = held[:, k] if count > 1 or held.shape[1] == 1 else held.reshape(len(scale), -1)
            vectors = scale[:, None] * frame.modes
            parts = vectors.T @ data
            rest = data - vectors @ parts
            left = np.append(np.cumsum((parts**2).sum(axis=1)[::-1])[::-1], 0.0) + (rest**2).sum()
            totals[k] += np.pad(left, (0, max_dimension + 1 - len(left)), mode="edge")
    return [np.sqrt(row / row[0]) if row[0] > 0 else np.ones(max_dimension + 1) for row in totals]
