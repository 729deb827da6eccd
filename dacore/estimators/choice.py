"""What PBDW chooses when data are there: n and λ, from the noise level or from the data of each series."""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError
from dacore.estimators.dimension import Without, cross_validated, discrepant, expected_errors
from dacore.estimators.metrics import SMALLEST_RATIO, Pencil
from dacore.estimators.projection import Projection, alike

Missed = float | Literal["held_out", "gcv", "discrepancy"]

# λ that data choose from, in units of the pencil's largest eigenvalue: two a decade.
_RATIOS = np.logspace(-8.0, 4.0, 25)
# Where λ changes with n, errors are expected for λ of each decade, from so many groups of trajectories.
_FEW = 2


class Choice:
    """Rules for n and λ on one set of functionals.

    Parameters
    ----------
    projection : Projection
        The spaces in the metric of the fit.
    pencil : Pencil or None
        Of a fit that has λ.
    folds : sequence of Without
        In the metric of the fit.
    observed : (m, r) array
        Functionals of the background's modes.
    coefficients : (r, t, K) array
        Training set at the observed steps.
    left : (N + 1, t, K) array
        Squares of what the spaces leave of trajectories held out, in units of the prepared noise.
    usable : (spaces,) int array
        Largest n of each space that is seen stably.
    balance : (r,) array
        Square roots of the weights with which errors of coefficients count.
    mend : float
        What the correction takes away of a squared error, over what it takes away in its own product.
    """

    def __init__(
        self,
        projection: Projection,
        pencil: Pencil | None,
        folds: Sequence[Without],
        observed: Array,
        coefficients: Array,
        left: Array,
        usable: IntArray,
        balance: Array,
        mend: float,
    ) -> None:
        self.projection, self.pencil, self.folds = projection, pencil, folds
        self.observed, self.coefficients, self.left, self.usable = observed, coefficients, left, usable
        self.balance, self.mend = balance, mend
        self._curves: dict[float, tuple[Array, Array]] = {}

    def dimensions(self, rule: str, squares: Array, scale: Array, missed: Missed) -> IntArray:
        """Dimensions (spaces, k) by a rule.

        Parameters
        ----------
        rule : {"noise", "gcv", "discrepancy"}
        squares : (N + 1, t, k) array
            What the spaces leave of the data, in units of the prepared noise.
        scale : (k,) array
        missed : float or str
            Setting of the fit.
        """
        m, top = len(self.observed), int(self.usable.max())
        if rule == "gcv":
            return np.minimum(cross_validated(squares, m, top), self.usable[:, None])
        if rule == "discrepancy":
            return np.minimum(discrepant(squares, m, top, scale), self.usable[:, None])
        levels, which = np.unique(scale, return_inverse=True)
        found = np.stack([self._for_level(float(level), missed) for level in levels], axis=1)
        return np.asarray(found[:, which.ravel()])

    def _for_level(self, level: float, missed: Missed) -> IntArray:
        """Dimension (spaces,) of the least expected error at one noise scale; 0 where data are next to noise alone."""
        if not self.folds:
            count = self.coefficients.shape[2]
            raise ShapeError(f"n: got 'noise' with {count} training trajectories, expected at least 3; give a number")
        every = np.arange(int(self.usable.max()) + 1)
        if self.pencil is None:
            total = _with_noise(*self._expected(0.0), level)
        else:
            held: Missed = missed if isinstance(missed, float | int) else "held_out"
            spaces = np.ones(len(self.usable), dtype=int)
            exponents = np.round(
                np.log10(np.stack([self._ratio(self.pencil, n * spaces, level, held) for n in every], axis=1))
            )
            total = np.full(exponents.shape, np.inf)
            for exponent in np.unique(exponents):
                bias, noise = self._expected(float(10.0**exponent))
                total = np.where(exponents == exponent, _with_noise(bias, noise, level), total)
        total = np.where(every > self.usable[:, None], np.inf, total)
        return np.asarray(np.argmin(total, axis=1))

    def _expected(self, ratio: float) -> tuple[Array, Array]:
        if ratio not in self._curves:
            folds = self.folds if self.pencil is None else self.folds[:_FEW]
            self._curves[ratio] = expected_errors(
                folds, self.observed, self.coefficients, self.balance, self.mend, ratio, int(self.usable.max())
            )
        return self._curves[ratio]

    def ratios(
        self, missed: Missed, dimensions: IntArray, scale: Array, turned: Array, projection: Projection
    ) -> Array:
        """λ (spaces, k); 0 where the metric has none.

        Parameters
        ----------
        missed : float or str
        dimensions : (spaces, k) int array
        scale : (k,) array
        turned : (m, t, k) array
            Data in the coordinates of the fit.
        projection : Projection
            Its spaces, or those that have not seen some trajectories.
        """
        if self.pencil is None:
            return np.zeros(dimensions.shape)
        if missed == "gcv" or missed == "discrepancy":
            found = _by_data(projection, self.pencil, missed, dimensions, scale, turned)
            return np.tile(found, (len(dimensions), 1))
        columns = [
            self._ratio(self.pencil, n, float(level), missed) for n, level in zip(dimensions.T, scale, strict=True)
        ]
        return np.stack(columns, axis=1)

    def _ratio(self, pencil: Pencil, dimensions: IntArray, level: float, missed: Missed) -> Array:
        """λ = σ²/τ² (spaces,) at one noise scale; a little more than 0 for exact data."""
        if isinstance(missed, float | int):
            square = np.full(len(dimensions), float(missed) ** 2)
        else:
            square = self._missed[np.arange(len(dimensions)), dimensions]
        top = float(pencil.values.max(initial=0.0))
        with np.errstate(divide="ignore"):
            ratio = level**2 / square if level > 0 else np.zeros(len(square))
        return np.asarray(np.clip(ratio, SMALLEST_RATIO * top, top / SMALLEST_RATIO))

    @cached_property
    def _missed(self) -> Array:
        """τ² (spaces, N + 1): squares that n modes leave of trajectories held out, over what K expects of them."""
        if not self.folds or self.pencil is None:
            raise ShapeError("missed: got 'held_out' with fewer than 3 training trajectories; give a number")
        out = np.empty((len(self.usable), len(self.left)))
        values = self.pencil.values
        for space, steps in self.projection.groups():
            left = self.left[:, steps].mean(axis=(1, 2))
            q, _ = np.linalg.qr(self.projection.seen[space])
            taken = np.cumsum(values @ q**2)
            expected = np.concatenate([[values.sum()], values.sum() - taken])
            expected = np.pad(expected, (0, max(len(left) - len(expected), 0)), mode="edge")[: len(left)]
            # Where all is used up, nothing is left to miss.
            out[space] = left / np.maximum(expected, 1e-12 * values.sum())
        return out


def _with_noise(bias: Array, noise: Array, level: float) -> Array:
    """Expected squares with noise; infinite where spaces without some trajectories have too few modes to tell."""
    return np.where(np.isfinite(noise), bias + level**2 * np.where(np.isfinite(noise), noise, 0.0), np.inf)


def _by_data(p: Projection, pencil: Pencil, rule: str, dimensions: IntArray, scale: Array, turned: Array) -> Array:
    """λ (k,) of each series, the same for all steps, from the residuals of its own data."""
    ratios = _RATIOS * float(pencil.values.max(initial=0.0))
    squares, free = np.zeros((2, len(ratios), turned.shape[2]))
    for number, ratio in enumerate(ratios):
        factors = 1.0 / np.sqrt(pencil.values + ratio)
        for space, steps in p.groups():
            for n, _, series in alike(dimensions[space], np.zeros(dimensions.shape[1])):
                part = turned[:, steps, series]
                q, _ = p.solver(space, n, float(ratio))
                block = factors[:, None] * part.reshape(len(part), -1)
                # The misfit of the data is λ N z, in units of the noise.
                rest = (ratio * factors)[:, None] * (block - q @ (q.T @ block))
                squares[number, series] += (rest**2).sum(axis=0).reshape(part.shape[1:]).sum(axis=0)
                trace = ratio * float((factors**2 * (1.0 - (q**2).sum(axis=1))).sum())
                free[number, series] += trace * part.shape[1]
    if rule == "gcv":
        # Where nothing is left free there is nothing to judge by.
        known = free > 1e-9 * turned.shape[1]
        scores = np.divide(squares, free**2, out=np.full_like(squares, np.inf), where=known)
        return np.asarray(ratios[np.argmin(scores, axis=0)])
    count = turned.shape[1] // len(dimensions)
    left = len(pencil.values) * turned.shape[1] - count * dimensions.sum(axis=0)
    # The residual grows with λ: the largest that leaves no more than the noise.
    meets = squares <= left * scale**2
    last = meets.shape[0] - 1 - np.argmax(meets[::-1], axis=0)
    return np.asarray(ratios[np.where(meets.any(axis=0), last, 0)])
