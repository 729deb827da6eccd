"""Initial guesses for the next step from the last few."""

from collections import deque

import numpy as np

from dacore.core.arrays import Array

# Binomial coefficients: the polynomial through the last values, continued by one step.
_WEIGHTS = {1: (1.0,), 2: (2.0, -1.0), 3: (3.0, -3.0, 1.0), 4: (4.0, -6.0, 4.0, -1.0)}


class Extrapolation:
    """Polynomial through the last values of a motion with equal steps.

    Parameters
    ----------
    first : (n, k) array
        The value before the first step.
    order : int
        Number of values used, 1 to 4.
    """

    def __init__(self, first: Array, order: int = 3) -> None:
        self._last: deque[Array] = deque([first], maxlen=order)

    def append(self, value: Array) -> None:
        """Add the newest value (n, k)."""
        self._last.appendleft(value)

    def guess(self) -> Array:
        """Return a guess (n, k) of the next value."""
        weights = _WEIGHTS[len(self._last)]
        return np.asarray(sum(weight * value for weight, value in zip(weights, self._last, strict=True)))
