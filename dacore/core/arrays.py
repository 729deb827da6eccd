"""Array types and the few checks every value object makes."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from dacore.errors import ShapeError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Sparse: TypeAlias = csr_array


def as_array(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return `values` as a read-only float64 array of the given shape.

    Parameters
    ----------
    name : str
        What the array is, for the error message.
    values : array_like
        Finite real numbers.
    shape : tuple of int or None
        Expected shape; None matches any length.

    Returns
    -------
    (...) array

    Raises
    ------
    ShapeError
        If the shape differs or a value is NaN or infinite.
    """
    array = np.array(values, dtype=np.float64)
    check_shape(name, array, shape)
    if not np.isfinite(array).all():
        bad = int((~np.isfinite(array)).sum())
        raise ShapeError(f"{name}: {bad} of {array.size} values are NaN or infinite; expected finite numbers only")
    array.flags.writeable = False
    return array


def as_indices(name: str, values: ArrayLike, shape: tuple[int | None, ...], bound: int) -> IntArray:
    """Return `values` as a read-only int64 array with entries in ``[0, bound)``.

    Parameters
    ----------
    name : str
        What the array is, for the error message.
    values : array_like of int
    shape : tuple of int or None
        Expected; None matches any length.
    bound : int
        One more than the largest index.

    Returns
    -------
    int array

    Raises
    ------
    ShapeError
        If the shape differs, the values are not whole numbers, or one is out of range.
    """
    raw = np.asarray(values)
    if raw.size and not np.issubdtype(raw.dtype, np.integer):
        raise ShapeError(f"{name}: got numbers of type {raw.dtype}, expected integers")
    array = np.array(raw, dtype=np.int64)
    check_shape(name, array, shape)
    if array.size and (array.min() < 0 or array.max() >= bound):
        raise ShapeError(f"{name}: indices run from {array.min()} to {array.max()}, expected 0 to {bound - 1}")
    array.flags.writeable = False
    return array


def check_shape(name: str, array: NDArray[Any], shape: tuple[int | None, ...]) -> None:
    """Raise ShapeError unless ``array.shape`` matches `shape` (None: any length).

    Parameters
    ----------
    name : str
        What the array is, for the error message.
    array : array
    shape : tuple of int or None
        Expected; None matches any length.

    Raises
    ------
    ShapeError
        If it differs.
    """
    fits = len(array.shape) == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ShapeError(f"{name}: got shape {array.shape}, expected {wanted}")
