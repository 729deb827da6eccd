"""When data contradict an estimator: squares of what it leaves of them, against what right data leave.

What a right case leaves over is noise, whose squares have a known distribution, and what the training set cannot
represent, whose squares have none but are seen on trajectories held out. A statistic is scaled to the chi-squared
distribution of the same mean and variance (Welch and Satterthwaite).
"""

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.misfit import Misfit
from dacore.core.noise import NoiseModel

LARGEST_FREEDOM = 1e9


def matched(statistic: Array, mean: Array, variance: Array) -> Misfit:
    """Scale a statistic (k,) of known mean and variance (k,) to one that is chi-squared distributed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.minimum(2.0 * mean**2 / variance, LARGEST_FREEDOM)
    return Misfit(statistic * freedom / mean, freedom)


def unlearned(background: Background, observed: Array, noise: NoiseModel) -> float:
    """Mean square, over data in units of the noise, of what the training set itself says that it leaves out.

    Compression and reduced training leave out a share of each field, which trajectories held out do not show.

    Parameters
    ----------
    background : Background
    observed : (m, r) array
        Functionals of the background's modes.
    noise : NoiseModel
        Of the m values.
    """
    total = 0.0
    for field in background.space.fields:
        block = background.block(field.name)
        if not observed[:, block].any():
            continue
        share = background.compression[field.name] ** 2
        if background.forward is not None:
            share += background.forward.accuracy[field.name] ** 2
        seen = noise.whiten(observed[:, block])
        parts = background.coefficients[block].reshape(seen.shape[1], -1)
        squares = np.einsum("ij,ij->", seen.T @ seen, parts @ parts.T)
        total += share * float(squares) / (len(observed) * parts.shape[1])
    return total


def of_steps(squares: Array, held_out: Array, count: Array, scale: Array, unlearned: float) -> Misfit | None:
    """Misfit of residuals that are weighed step by step.

    Parameters
    ----------
    squares : (t, k) array
        Squared residuals of data, in units of the prepared noise.
    held_out : (t, K, k) array
        The same of exact data of trajectories held out; in the last axis for the spaces used for each series.
    count : (t, k) array
        Number of residuals at each step that a fit leaves free.
    scale : (k,) array
        Standard deviation of the noise.
    unlearned : float
        Mean square of what no trajectory held out shows; taken to be of one piece.

    Returns
    -------
    Misfit, NaN for a series whose fit leaves nothing over; or None where none does
    """
    some = count.sum(axis=0) > 0
    if not some.any():
        return None
    missed = held_out.mean(axis=1)
    free, floor = np.maximum(count, 1.0), max(unlearned, 1e-300)
    weight = np.where(count > 0, 1.0 / (scale**2 + floor + missed / free), 0.0)
    beyond = (weight * count * floor).sum(axis=0)
    mean = (weight * (count * scale**2 + missed)).sum(axis=0) + beyond
    noise = (weight**2 * (2.0 * count * scale**4 + 4.0 * scale**2 * missed)).sum(axis=0)
    spread = np.einsum("tk,tjk->jk", weight, held_out).var(axis=0)
    found = matched((weight * squares).sum(axis=0), mean, noise + spread + 2.0 * beyond**2)
    return Misfit(np.where(some, found.statistic, np.nan), np.where(some, found.freedom, np.nan))
