"""Do data look like anything in the training set? A wrong unit, or axes that are exchanged, pass every other check."""

from collections.abc import Callable, Sequence

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.observation import Functionals
from dacore.errors import DacoreError, ShapeError
from dacore.io.units import factor
from dacore.workflow.reconstruct.steps import Used

# Sizes beyond the training set's by less are wider ranges; by more than this, another unit or another thing.
_ODD, _HOPELESS = 3.0, 50.0
# What another reading must leave of the misfit to be believed instead.
_BETTER = 0.5
# Readings that share less of the data are not compared; what fits to this is right as it is.
_COMMON, _EXACT = 0.7, 1e-3
# Of readings that fit about alike the first is named: one of the array before one of its components.
_CLEARLY, _AGAINST = 0.9, 1.2
_ENOUGH = 20_000
# A mean over the steps that is this part of the motion is none that was left by subtracting it.
_CONSTANT = 0.1
_UNITS = ("m", "cm", "mm", "um", "nm")


def seen_in_training(background: Background, functionals: Functionals, used: Used) -> Array:
    """Data (m', t, K) that the training set would have given, of the functionals and steps that are used."""
    reduced = background.observe(functionals.matrix)[used.mask]
    return np.asarray(np.einsum("mr,rtk->mtk", reduced, background.coefficients[:, used.steps]))


def check_size(used: Used, training: Array, units: Sequence[str], given: str | None, noise: float) -> str | None:
    """Compare the size of data with that of the training set's.

    Parameters
    ----------
    used : Used
    training : (m', t, K) array
    units : sequence of str
        Of the values that are used.
    given : str, optional
        Unit that was said to be that of the files.
    noise : float
        Root mean square of the noise that is expected.

    Returns
    -------
    A warning, or None.

    Raises
    ------
    ShapeError
        If they are so far apart that nothing can come of it.
    """
    values = used.values[used.mask]
    size = float(np.sqrt(np.mean(values**2)))
    sizes = np.sqrt((training**2).mean(axis=(0, 1)))
    low, middle, high = (float(each) for each in (sizes.min(), np.median(sizes), sizes.max()))
    if high == 0:
        return None
    beyond = float(np.sqrt(max(size**2 - noise**2, 0.0)))
    if beyond > _ODD * high:
        ratio = beyond / high
        text = f"values are about {_round(size / middle)} times larger than anything in training"
    elif size < low / _ODD:
        ratio = size / low
        times = _round(middle / size) if size > 0 else "infinitely many"
        text = f"values are about {times} times smaller than anything in training"
    else:
        return None
    text += f" (root mean square {size:.3g} {units[0]}; training {low:.3g} to {high:.3g})"
    text += _unit(size / middle, units, given) if size > 0 else "; are they measured at all?"
    if not 1.0 / _HOPELESS < ratio < _HOPELESS:
        raise ShapeError(f"data: {text}")
    return f"{text}; what follows goes beyond what was learned"


def _unit(ratio: float, units: Sequence[str], given: str | None) -> str:
    """Which unit would bring the data to the size of the training set's."""
    if given is None or len(set(units)) > 1:
        return "; check the unit of the data"
    best, off = "", abs(np.log10(ratio)) - 0.3
    for unit in _UNITS:
        try:
            scale = factor(unit, given, "")
        except DacoreError:
            continue
        if abs(np.log10(ratio * scale)) < off:
            best, off = unit, float(abs(np.log10(ratio * scale)))
    if not best:
        return "; check the unit of the data, or train on wider ranges"
    return f"; they were taken to be in {given}: if they are in {best}, say --unit {best}"


def _round(value: float) -> str:
    return f"{float(f'{value:.1g}' if value >= 10 else f'{value:.2g}'):,.0f}" if value >= 10 else f"{value:.1f}"


def better_reading(
    used: Used, training: Array, others: Sequence[tuple[str, Callable[[IntArray], Array]]]
) -> str | None:
    """Whether the data fit combinations of training data far better when they are read in another way.

    Parameters
    ----------
    used : Used
    training : (m', t, K) array
    others : sequence of (str, callable)
        The data read in other ways: functionals (k,) in, values (k, t) at the steps that are used out.

    Returns
    -------
    A warning, or None.
    """
    # A part of very many data tells readings apart as well as all of them.
    step = -(-training.shape[0] * training.shape[1] // _ENOUGH)
    rows = np.flatnonzero(used.mask)[::step]
    flat = training[::step].reshape(-1, training.shape[2])
    if flat.shape[0] <= 2 * flat.shape[1] or not flat.any():
        return None  # anything would fit
    # What many samples vary together: few directions, so that noise and other readings do not fit by chance.
    u, s, _ = np.linalg.svd(flat, full_matrices=False)
    basis = u[:, : max(1, int((np.cumsum(s[::-1] ** 2)[::-1] > 1e-4 * (s**2).sum()).sum()))]

    mine, mean = used.values[rows].ravel(), flat.mean(axis=1)
    ratio, best, name = 1.0, 1.0, ""
    for other, values in others:
        theirs = values(rows).ravel()
        both = ~np.isnan(theirs)
        if both.mean() < _COMMON:
            continue
        part, _ = np.linalg.qr(basis[both])
        own, share = _left(part, mine[both]), _left(part, theirs[both])
        # Of two that differ by a sign alone, the one that points where training points.
        share *= 1.0 if mean[both] @ theirs[both] > 0 else _AGAINST
        if own > _EXACT and share < _BETTER * own and share < _CLEARLY * best:
            ratio, best, name = own, share, other
    if not name:
        return None
    return (
        f"the data look like the training set with {name}: {np.sqrt(best):.0%} of them are left over instead of "
        f"{np.sqrt(ratio):.0%}; is this how they were written? They are taken as they are"
    )


def check_mean(used: Used, rows: BoolArray, sigma: Array, name: str) -> str | None:
    """Compare the mean over the steps with the motion, for a field that the scene takes less its mean.

    Parameters
    ----------
    used : Used
        Of all recorded steps.
    rows : (m,) bool array
        Functionals of the field.
    sigma : (m,) array
        Standard deviation of the noise that is supposed.
    name : str
        Of the field.

    Returns
    -------
    A warning, or None.
    """
    rows = rows & used.mask
    if not rows.any():
        return None
    values, steps = used.values[rows], used.values.shape[1]
    mean = values.mean(axis=1)
    motion, noise = float(((values - mean[:, None]) ** 2).mean()), float((sigma[rows] ** 2).mean()) / steps
    left = float((mean**2).mean()) - noise
    # Noise has a mean, too, and its square scatters.
    if left <= _CONSTANT**2 * motion + 5.0 * noise * float(np.sqrt(2.0 / rows.sum())):
        return None
    return (
        f"{name} has a mean over the steps, {np.sqrt(left / motion) if motion > 0 else np.inf:.2g} times as large as "
        f"its motion about it, and the scene takes {name} less its mean (observed.less_mean): subtract it from the data"
    )


def _left(basis: Array, data: Array) -> float:
    """Share of the squares of data (n,) that an orthonormal basis (n, r) leaves over."""
    total, inside = float(data @ data), basis.T @ data
    return max(total - float(inside @ inside), 0.0) / total if total > 0 else 1.0


def level(sigma: Array, used: Used) -> float:
    """Root mean square of the noise (m,) over the values that are used."""
    kept = sigma[used.mask]
    if not np.isfinite(kept).all():
        raise ShapeError("noise: standard deviations must be finite numbers")
    return float(np.sqrt(np.mean(kept**2)))
