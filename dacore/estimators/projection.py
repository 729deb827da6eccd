"""Nested affine spaces seen through functionals, and least squares in them for any metric."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg import solve_triangular

from dacore.core.arrays import Array, IntArray
from dacore.estimators.box import solve_within
from dacore.estimators.metrics import Metric


class Projection:
    """Spaces offset + span of nested modes: one for all steps, or one for each.

    Parameters
    ----------
    offset : (r, t) array
    modes : sequence of (r, N) arrays
        One, or one for each step.
    observed : (m, r) array
        Functionals of the background's modes.
    metric : Metric
    limits : sequence of ((N, t'), (N, t')) arrays, optional
        For each space, the least and the largest coefficients at each of its steps.
    """

    def __init__(
        self,
        offset: Array,
        modes: Sequence[Array],
        observed: Array,
        metric: Metric,
        limits: Sequence[tuple[Array, Array]] | None = None,
    ) -> None:
        self.offset, self.modes, self.metric, self.limits = offset, tuple(modes), metric, limits
        self.expected = observed @ offset
        self.seen = [metric.turn(observed @ each) for each in self.modes]
        self._kept: dict[int, tuple[Array, Array]] = {}

    def groups(self) -> list[tuple[int, slice]]:
        """Numbers of the spaces, with the steps that each is for."""
        if len(self.modes) == 1:
            return [(0, slice(None))]
        return [(k, slice(k, k + 1)) for k in range(len(self.modes))]

    def at(self, step: int) -> int:
        """Number of the space of a step."""
        return step if len(self.modes) > 1 else 0

    def solver(self, space: int, n: int, ratio: float) -> tuple[Array, Array]:
        """QR factors (m, n), (n, n) of the observed modes for one λ; kept where there is only one λ."""
        factors = self.metric.factors(ratio)
        if factors is not None:
            q, r = np.linalg.qr(factors[:, None] * self.seen[space][:, :n])
            return q, r
        if space not in self._kept:
            q, r = np.linalg.qr(self.seen[space])
            self._kept[space] = q, r
        # Factors of the first columns are the first columns of the factors.
        q, r = self._kept[space]
        return q[:, :n], r[:n, :n]

    def turned(self, values: Array) -> Array:
        """Values (m, t, k) less those of the offset, in the coordinates of the metric."""
        return self.metric.turn(values - self.expected[:, :, None])

    def fit(self, turned: Array, dimensions: IntArray, ratios: Array, correct: bool) -> tuple[Array, Array | None]:
        """Coefficients in the background's bases, and weights of the correction.

        Parameters
        ----------
        turned : (m, t, k) array
            As `turned` gives them.
        dimensions : (len(modes), k) int array
        ratios : (len(modes), k) array
        correct : bool

        Returns
        -------
        coefficients : (r, t, k) array
        correction : (m, t, k) array, or None
        """
        coefficients = np.repeat(self.offset[:, :, None], turned.shape[2], axis=2)
        left = np.empty_like(turned) if correct else None
        for space, steps in self.groups():
            for n, ratio, series in alike(dimensions[space], ratios[space]):
                part = turned[:, steps, series]
                block = part.reshape(len(part), -1)
                factors = self.metric.factors(ratio)
                if factors is not None:
                    block = factors[:, None] * block
                q, r = self.solver(space, n, ratio)
                c = self._coefficients(space, r, q.T @ block, part.shape[1:])
                found = self.modes[space][:, :n] @ c
                coefficients[:, steps, series] += found.reshape(len(found), *part.shape[1:])
                if left is not None:
                    rest = block - q @ (r @ c)
                    left[:, steps, series] = (rest if factors is None else factors[:, None] * rest).reshape(part.shape)
        return coefficients, None if left is None else self.metric.back(left)

    def _coefficients(self, space: int, r: Array, right: Array, shape: tuple[int, ...]) -> Array:
        if self.limits is None or not len(r):
            return triangular(r, right)
        low, high = (
            np.broadcast_to(each[: len(r), :, None], (len(r), *shape)).reshape(len(r), -1)
            for each in self.limits[space]
        )
        return solve_within(r, right, low, high)

    def gain(
        self, step: int, n: int, ratio: float, on_modes: Array, on_correction: Array | None, correct: bool
    ) -> Array:
        """Weights (s, m) with which raw data at one step enter linear functionals of the estimate."""
        q, r = self.solver(self.at(step), n, ratio)
        factors = self.metric.factors(ratio)
        along = on_modes @ self.modes[self.at(step)][:, :n]
        gain = triangular(r, along.T, transposed=True).T @ q.T
        if on_correction is not None and correct:
            rest = self.metric.turn(on_correction.T).T
            rest = rest if factors is None else rest * factors
            gain = gain + rest - (rest @ q) @ q.T
        return self.metric.back((gain if factors is None else gain * factors).T).T


def triangular(r: Array, right: Array, transposed: bool = False) -> Array:
    """Solve with an upper triangular factor (n, n), which may be empty where nothing varies."""
    if not len(r):
        return np.zeros_like(right)
    return np.asarray(solve_triangular(r, right, trans="T" if transposed else "N", check_finite=False))


def alike(dimensions: IntArray, ratios: Array) -> Iterator[tuple[int, float, IntArray]]:
    """Yield n, λ and the series (k',) that have both.

    Parameters
    ----------
    dimensions, ratios : (k,) arrays

    Yields
    ------
    (int, float, (k',) int array)
    """
    both = np.stack([dimensions.astype(np.float64), ratios])
    pairs, which = np.unique(both, axis=1, return_inverse=True)
    for number in range(pairs.shape[1]):
        yield int(pairs[0, number]), float(pairs[1, number]), np.flatnonzero(which.ravel() == number)
