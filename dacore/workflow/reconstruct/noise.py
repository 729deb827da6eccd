"""How much noise data have: as the user says, as the files say, or as the scene says."""

import re

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import SceneError, ShapeError
from dacore.io.units import parse_quantity
from dacore.workflow.reconstruct.steps import Used

# Deviations of one sensor that differ less from time to time are one.
_STEADY = 0.05


def deviations(
    used: Used, asked: str | None, levels: list[float], units: tuple[str, ...], given: str | None, notes: list[str]
) -> Array:
    """Standard deviation (m,) of the noise of each functional, in its unit; zeros for exact data.

    Parameters
    ----------
    used : Used
    asked : str, optional
        "5%" of the largest value, or a number with or without a unit.
    levels : list of float
        Noise levels of the scene.
    units : tuple of str
        Of the functionals.
    given : str, optional
        Unit of the files, in which a number without one is.
    notes : list of str
        Is added to.

    Raises
    ------
    SceneError
        If nobody says how much noise there is, or `asked` cannot be read.
    """
    count = len(used.mask)
    largest = float(np.abs(used.values[used.mask]).max())
    if asked is not None:
        if used.sigma is not None:
            notes.append("the files say sigma; --noise is taken instead")
        return _asked(asked, largest, units, given)
    if used.sigma is not None:
        return _of_data(used, notes)
    positive = [each for each in levels if each > 0]
    if len(set(units)) == 1 and len(positive) == 1:
        notes.append(
            f"nobody says how much noise the data have; taken as the scene's {positive[0]:.2g} of the largest value, "
            f"{positive[0] * largest:.3g} {units[0]}; --noise says it better"
        )
        return np.full(count, positive[0] * largest)
    raise SceneError(
        "noise: nobody says how much the data have; give --noise, as '5%' of the largest value, '0.2 um' or 0 for "
        "exact data, or a sigma in the files"
    )


def _asked(text: str, largest: float, units: tuple[str, ...], given: str | None) -> Array:
    share = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*", text)
    if share:
        return np.full(len(units), float(share[1]) / 100.0 * largest)
    number = re.fullmatch(r"[\s+.\deE-]+", text)
    shown = f"{text} {given}" if number and given else text
    known = {unit: parse_quantity(shown, unit, f"--noise {text}") for unit in set(units)}
    out = np.array([known[unit] for unit in units])
    if not (np.isfinite(out).all() and (out >= 0).all()):
        raise SceneError(f"--noise {text}: expected 0 or a positive standard deviation")
    return out


def _of_data(used: Used, notes: list[str]) -> Array:
    if used.sigma is None:
        raise ShapeError("noise: no sigma")
    out = np.ones(len(used.mask))
    kept = used.sigma[used.mask]
    out[used.mask] = np.sqrt((kept**2).mean(axis=1))
    out[~used.mask] = np.median(out[used.mask])
    if (np.abs(kept / out[used.mask, None] - 1.0) > _STEADY).any():
        notes.append("sigma differs from time to time; each sensor is given its root mean square over the steps used")
    return out
