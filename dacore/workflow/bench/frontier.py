"""The efficient frontier of measured points, what to take for a wanted error, and how costs grow."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray


def frontier(costs: Array, errors: Array, gain: float = 0.0) -> BoolArray:
    """Which points (k,) no other point beats in both cost and error.

    Parameters
    ----------
    costs, errors : (k,) arrays
        A point that is not finite in both is never on the frontier.
    gain : float
        By how much, relatively, an error must be below those of all cheaper points to count as less.
    """
    efficient = np.zeros(len(costs), dtype=bool)
    valid = np.isfinite(costs) & np.isfinite(errors)
    least = np.inf
    # Cheapest first, and of equal cost the most accurate first: each must be better than all before it.
    for k in np.lexsort((errors, costs)):
        if valid[k] and (errors[k] < least * (1.0 - gain) or least == np.inf):
            efficient[k], least = True, errors[k]
    return efficient


def cheapest(costs: Array, errors: Array, wanted: float) -> int | None:
    """Number of the cheapest point with an error of at most `wanted`; None if there is none."""
    fit = np.flatnonzero(np.isfinite(costs) & (errors <= wanted))
    return int(fit[np.argmin(costs[fit])]) if fit.size else None


@dataclass(frozen=True)
class Growth:
    """cost ≈ factor · sizeᵃ, fitted in logarithms.

    Parameters
    ----------
    exponent, factor : float
    scatter : float
        Largest ratio of a measured cost to the fitted one, or its inverse.
    """

    exponent: float
    factor: float
    scatter: float

    def at(self, size: float) -> float:
        """Cost that the fit predicts."""
        return float(self.factor * size**self.exponent)


def growth(sizes: Sequence[float] | Array, costs: Sequence[float] | Array) -> Growth | None:
    """Fit how a cost grows; None with fewer than two different sizes."""
    x, y = np.asarray(sizes, dtype=np.float64), np.asarray(costs, dtype=np.float64)
    usable = np.isfinite(y) & (y > 0) & (x > 0)
    x, y = x[usable], y[usable]
    if len(np.unique(x)) < 2:
        return None
    exponent, offset = np.polyfit(np.log(x), np.log(y), 1)
    ratios = y / np.exp(offset + exponent * np.log(x))
    return Growth(float(exponent), float(np.exp(offset)), float(max(ratios.max(), 1.0 / ratios.min())))
