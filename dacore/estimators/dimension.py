"""Which dimension n of the background space to take in noise: from trajectories held out, or from data alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.estimators.projection import Projection, triangular


@dataclass(frozen=True, eq=False)
class Without:
    """Spaces that have not seen some trajectories.

    Parameters
    ----------
    mask : (K,) bool array
        Who is held out.
    projection, plain : Projection
        Of the others' spaces: in the metric of the fit, and weighted by the noise alone.
    """

    mask: BoolArray
    projection: Projection
    plain: Projection


def residual_squares(projection: Projection, turned: Array, count: int) -> Array:
    """Squares of what the spaces of n = 0 … `count` modes leave of data, in the projection's own coordinates.

    Parameters
    ----------
    projection : Projection
        In a metric without factors.
    turned : (m, t, k) array
        Data in its coordinates.
    count : int

    Returns
    -------
    (count + 1, t, k) array
        Continued with its last value where there are fewer modes.
    """
    out = np.empty((count + 1, *turned.shape[1:]))
    for space, steps in projection.groups():
        part = turned[:, steps]
        block = part.reshape(len(part), -1)
        q, _ = projection.solver(space, min(count, projection.seen[space].shape[1]), 0.0)
        along = q.T @ block
        rest = ((block - q @ along) ** 2).sum(axis=0)
        left = np.concatenate([np.cumsum(along[::-1] ** 2, axis=0)[::-1] + rest, rest[None]])
        padded = np.pad(left, ((0, count + 1 - len(left)), (0, 0)), mode="edge")
        out[:, steps] = padded.reshape(count + 1, *part.shape[1:])
    return out


def held_out_squares(folds: Sequence[Without], observed: Array, coefficients: Array, count: int) -> Array:
    """`residual_squares` (count + 1, t, K) of exact data of every trajectory, in spaces that have not seen it."""
    out = np.full((count + 1, *coefficients.shape[1:]), np.nan)
    for fold in folds:
        data = np.tensordot(observed, coefficients[:, :, fold.mask], axes=1)
        out[:, :, fold.mask] = residual_squares(fold.plain, fold.plain.turned(data), count)
    return out


def cross_validated(squares: Array, m: int, usable: int) -> Array:
    """Generalised cross validation: for each series, the n that minimises residual squares over (m − n)².

    Parameters
    ----------
    squares : (N + 1, t, k) array
    m : int
        Number of functionals.
    usable : int
        Largest n that is allowed.

    Returns
    -------
    (k,) int array
    """
    # Where n uses up all functionals nothing is left to judge by: 0/0.
    total = squares[1 : max(min(usable, m - 1), 1) + 1].sum(axis=1)
    free = np.maximum(m - np.arange(1, len(total) + 1), 1.0)
    return np.asarray(np.argmin(total / free[:, None] ** 2, axis=0) + 1)


def discrepant(squares: Array, m: int, usable: int, scale: Array, margin: float = 4.0) -> Array:
    """Discrepancy principle (Morozov): for each series, the least n whose residual is no more than the noise.

    The residual may exceed its expectation by `margin` of its standard deviations. The largest n where none does.
    """
    total = squares[1 : usable + 1].sum(axis=1)
    free = np.maximum(m - np.arange(1, len(total) + 1), 0) * squares.shape[1]
    limit = (free + margin * np.sqrt(2.0 * free))[:, None] * scale**2
    meets = total <= limit
    return np.asarray(np.where(meets.any(axis=0), np.argmax(meets, axis=0) + 1, len(total)))


def expected_errors(
    folds: Sequence[Without],
    observed: Array,
    coefficients: Array,
    balance: Array,
    mend: float,
    ratio: float,
    count: int,
) -> tuple[Array, Array]:
    """Mean squared errors of the estimates of n = 0 … N modes: those of exact data, and those from unit noise.

    A trajectory is estimated in spaces that have not seen it. What the correction takes away is counted
    in the inner product of the estimator, times `mend`.

    Parameters
    ----------
    folds : sequence of Without
    observed : (m, r) array
        Functionals of the background's modes.
    coefficients : (r, t, K) array
    balance : (r,) array
        Square roots of the weights with which errors of the coefficients count.
    mend : float
        0 for an estimate without a correction.
    ratio : float
        λ.
    count : int
        N.

    Returns
    -------
    missed : (spaces, N + 1) array
    noise : (spaces, N + 1) array
        Summed over the steps of each space; infinite where there are fewer modes.
    """
    spaces = len(folds[0].projection.modes)
    missed, noise = np.zeros((spaces, count + 1)), np.zeros((spaces, count + 1))
    total = sum(int(fold.mask.sum()) for fold in folds)
    for fold in folds:
        p = fold.projection
        held = coefficients[:, :, fold.mask]
        turned = p.turned(np.tensordot(observed, held, axes=1))
        away = balance[:, None, None] * (held - p.offset[:, :, None])
        for space, steps in p.groups():
            block = turned[:, steps].reshape(len(turned), -1)
            truth = away[:, steps].reshape(len(away), -1)
            found = _curves(p, space, ratio, block, truth, balance, mend, count)
            missed[space] += found[0] / total
            noise[space] += found[1] * (block.shape[1] / total)
    return missed, noise


def _curves(
    p: Projection, space: int, ratio: float, block: Array, truth: Array, balance: Array, mend: float, count: int
) -> tuple[Array, Array]:
    """Sum of squared errors of exact data, and mean square of the noise that comes through in one step."""
    n_max = min(count, p.seen[space].shape[1], len(block))
    factors = p.metric.factors(ratio)
    q, r = p.solver(space, n_max, ratio)
    rest = block if factors is None else factors[:, None] * block
    along = q.T @ rest
    modes = balance[:, None] * p.modes[space][:, :n_max]
    gram, cross, size = modes.T @ modes, modes.T @ truth, float((truth**2).sum())
    coloured = p.metric.noise_gram(q, ratio)
    # A squared residual r² in these coordinates is mended by r²(κ + 2λ)/(κ + λ).
    share = np.ones(len(block)) if factors is None else 1.0 + ratio * factors**2
    # Of the noise in the correction, only what depends on n is counted.
    bent = (q * share[:, None]).T @ q
    straight = np.diag(coloured) if factors is None else (q**2 * (share * factors**2)[:, None]).sum(axis=0)
    missed, noise = np.full(count + 1, np.inf), np.full(count + 1, np.inf)
    # Without a mode the estimate is the offset and its correction.
    missed[0], noise[0] = size, 0.0
    if mend:
        missed[0] -= mend * float(share @ (rest**2).sum(axis=1))
    for n in range(1, n_max + 1):
        if not np.abs(np.diag(r)[:n]).min() > 0:
            break
        c = triangular(r[:n, :n], along[:n])
        missed[n] = size - 2.0 * float((c * cross[:n]).sum()) + float((c * (gram[:n, :n] @ c)).sum())
        inverse = triangular(r[:n, :n], np.eye(n))
        noise[n] = float(((inverse.T @ gram[:n, :n] @ inverse) * coloured[:n, :n]).sum())
        if mend:
            rest = rest - np.outer(q[:, n - 1], along[n - 1])
            missed[n] -= mend * float(share @ (rest**2).sum(axis=1))
            twice = 2.0 * float(straight[:n].sum()) - float((bent[:n, :n] * coloured[:n, :n]).sum())
            noise[n] += mend * (twice - 2.0 * float(np.trace(coloured[:n, :n])))
    return missed, noise
