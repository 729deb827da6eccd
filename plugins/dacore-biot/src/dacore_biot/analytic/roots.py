"""Roots of a function, one in each of many brackets."""

from collections.abc import Callable

import numpy as np

from dacore.core.arrays import Array

SPENT = 40.0
"""A term below exp(−40) = 4e-18 of the first one is lost in double precision."""


def roots(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Bisect to the last bit.

    Parameters
    ----------
    function : callable
        (n,) -> (n,), of different signs at `low` and `high`.
    low, high : (n,) array

    Returns
    -------
    (n,) array
    """
    low, high = low.copy(), high.copy()
    rising = function(high) > 0
    for _ in range(64):
        middle = 0.5 * (low + high)
        above = (function(middle) > 0) == rising
        high, low = np.where(above, middle, high), np.where(above, low, middle)
    return 0.5 * (low + high)


def terms(rate: float, most: int = 20_000) -> int:
    """Return how many of the terms exp(−n² rate) count, with some to spare, at most `most`."""
    return most if rate <= 0 else int(min(most, np.ceil(np.sqrt(SPENT / rate)) + 2))
