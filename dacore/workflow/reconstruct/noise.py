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
        "5%" of the largest value, of each unit where there are several, or a number with or without a unit.
    levels : list of float
        Noise levels of the scene.
    units : tuple of str
        Of the functionals.
    given : str, optional
        Unit of all files, in which a number without one is; None if they have several.
    notes : list of str
        Is added to.

    Raises
    ------
    SceneError
        If nobody says how much noise there is, or `asked` cannot be read.
    """
    count = len(used.mask)
    if asked is not None:
        if used.sigma is not None:
            notes.append("the files say sigma; --noise is taken instead")
        return _asked(asked, used, units, given, notes)
    if used.sigma is not None:
        return _of_data(used, notes)
    positive = [each for each in levels if each > 0]
    largest = float(np.abs(used.values[used.mask]).max())
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


def _asked(text: str, used: Used, units: tuple[str, ...], given: str | None, notes: list[str]) -> Array:
    """What `--noise` says: a share of the largest value of the same unit, or a number."""
    of = np.array(units)
    several = list(dict.fromkeys(of[used.mask].tolist()))
    share = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*", text)
    if share:
        largest = {unit: float(np.abs(used.values[used.mask & (of == unit)]).max()) for unit in several}
        known = {unit: float(share[1]) / 100.0 * size for unit, size in largest.items()}
        if len(several) > 1:
            sizes = ", ".join(f"{size:.3g} {unit}" for unit, size in known.items())
            notes.append(f"--noise {text} is of the largest value of each unit: {sizes}")
    else:
        shown = _with_unit(text, several[0], given)
        known = {unit: parse_quantity(shown or f"0 {unit}", unit, f"--noise {text}") for unit in several}
    # Functionals that are not used have any noise.
    out = np.array([known.get(unit, known[several[0]]) for unit in units])
    if not (np.isfinite(out).all() and (out >= 0).all()):
        raise SceneError(f"--noise {text}: expected 0 or a positive standard deviation")
    return out


def _with_unit(text: str, example: str, given: str | None) -> str:
    """A number with the unit that it is in: its own, or that of the files; nothing for 0, which is 0 of any unit."""
    if not re.fullmatch(r"[\s+.\deE-]+", text):
        return text
    if parse_quantity(text, example, f"--noise {text}") == 0:
        return ""
    if given is None:
        raise SceneError(
            f"--noise {text}: a number without a unit, and the data are in several; give it as '{text.strip()} "
            f"{example}', as a share such as '5%', or as sigma in the files"
        )
    return f"{text} {given}"


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
