"""Checks of what an estimator is given: data, noise, mask and steps. Constructed means valid, and so does estimated."""

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray, as_indices
from dacore.core.background import Background
from dacore.errors import ShapeError


def check_scale(noise_scale: Array | float, series: int) -> Array:
    """Return the noise scale as (k,) numbers of 0 or more; ShapeError otherwise.

    Parameters
    ----------
    noise_scale : float or (k,) array
    series : int
        How many there are, k.

    Returns
    -------
    (k,) array

    Raises
    ------
    ShapeError
        If it is negative, not finite, or of another number of series.
    """
    scale = np.asarray(noise_scale, dtype=np.float64)
    if scale.shape not in ((), (series,)) or not (np.isfinite(scale).all() and (scale >= 0).all()):
        raise ShapeError(
            f"noise_scale: got {noise_scale}, expected one finite number of 0 or more, or {series} of them"
        )
    return np.broadcast_to(scale, (series,))


def observed_steps(background: Background, steps: IntArray | None) -> IntArray:
    """Return which of the background's times are observed, all for None; ShapeError if they are none or not its own.

    Parameters
    ----------
    background : Background
    steps : (t,) int array or None

    Returns
    -------
    (t,) int array

    Raises
    ------
    ShapeError
        If they are none, not its own, or one is there twice.
    """
    count = len(background.times)
    if steps is None:
        return np.arange(count)
    chosen = as_indices("steps", steps, (None,), count)
    if len(chosen) == 0 or len(np.unique(chosen)) < len(chosen):
        raise ShapeError(f"steps: got {len(chosen)}, expected at least one of {count} and none twice")
    return chosen


def check_mask(mask: BoolArray | None, m: int) -> BoolArray | None:
    """Return `mask` as (m,) booleans, None if it leaves everything; ShapeError if it is no mask or leaves nothing.

    Parameters
    ----------
    mask : (m,) bool array or None
    m : int
        Number of functionals.

    Returns
    -------
    (m,) bool array or None

    Raises
    ------
    ShapeError
        If it is no mask, or leaves nothing.
    """
    if mask is None:
        return None
    flags = np.asarray(mask)
    # Integers would select functionals by number instead of switching them off.
    if flags.dtype != np.bool_ or flags.shape != (m,):
        raise ShapeError(
            f"mask: got {flags.dtype} of shape {flags.shape}, expected True or False for each of {m} functionals"
        )
    if not flags.any():
        raise ShapeError(f"mask: leaves none of {m} functionals; expected at least one")
    return None if flags.all() else flags


def check_data(data: Array, m: int, t: int, mask: BoolArray | None = None) -> Array:
    """Return `data` as a finite float64 array (m, t, k), zero where masked; ShapeError says what is wrong.

    Data (m, t) are those of one series.

    Parameters
    ----------
    data : (m, t, k) or (m, t) array
    m, t : int
        Number of functionals and of observed steps.
    mask : (m,) bool array, optional

    Returns
    -------
    (m, t, k) array

    Raises
    ------
    ShapeError
        If shape, type or values are wrong.
    """
    given = np.asarray(data)
    if given.shape == (m, t):
        given = given[:, :, None]
    if given.ndim != 3 or given.shape[:2] != (m, t):
        raise ShapeError(f"data: got shape {given.shape}, expected ({m}, {t}, any) = (functionals, steps, series)")
    if not (np.issubdtype(given.dtype, np.floating) or np.issubdtype(given.dtype, np.integer)):
        raise ShapeError(
            f"data: got values of type {given.dtype}, expected real numbers; of phasors, give the values at each step"
        )
    array = np.asarray(given, dtype=np.float64)
    if mask is not None:
        array = np.where(mask[:, None, None], array, 0.0)
    if not np.isfinite(array).all():
        bad = int((~np.isfinite(array)).any(axis=(1, 2)).sum())
        raise ShapeError(f"data: {bad} of {m} functionals hold NaN or infinite values; leave them out with a mask")
    return array
