"""Which recorded steps data are of, and which of them, with which functionals, are used."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.errors import ShapeError
from dacore.workflow.drawn import time_text
from dacore.workflow.reconstruct.target import Fitted, Target

# Deviations that are stated too small by less are not worth a warning.
_REPEATED = 1.1
# Times differ by rounding: this part of a step is none.
_NEAR = 0.01
_COUNTED = "give --times if they are counted otherwise"


@dataclass(frozen=True, eq=False)
class Used:
    """Data that an estimator takes.

    Parameters
    ----------
    values : (m, t) array
        At the steps that are used; NaN where the mask leaves a functional out.
    sigma : (m, t) array or None
    steps : (t,) int array
        Of the recorded times.
    mask : (m,) bool array
        Functionals that are used.
    """

    values: Array
    sigma: Array | None
    steps: IntArray
    mask: BoolArray

    @property
    def count(self) -> int:
        """Number of values."""
        return int(self.mask.sum()) * len(self.steps)


def on_steps(data: Fitted, target: Target, notes: list[str], warnings: list[str]) -> tuple[Array, Array | None]:
    """Values and deviations (m, t) at the steps that the scene measures; NaN where there is none.

    Parameters
    ----------
    data : Fitted
    target : Target
    notes, warnings : lists of str
        Are added to.

    Raises
    ------
    ShapeError
        If no time is one of the scene's, or nobody says which are which.
    """
    values = timed(data, data.values, target, notes)
    if np.iscomplexobj(data.values):
        warnings += _repeated(data, target)
    if data.sigma is None:
        return values, None
    if np.iscomplexobj(data.values):
        return values, np.where(np.isnan(values), np.nan, data.sigma)
    return values, timed(data, data.sigma, target, [])


def timed(data: Fitted, values: Array, target: Target, notes: list[str]) -> Array:
    """Values (k, ·) at the times of some data as values (k, t) at the steps that the scene measures."""
    if np.iscomplexobj(values):
        return _harmonic(data, values, target, notes)
    out = np.full((len(values), len(target.observed)), np.nan)
    for step, column in enumerate(_columns(data, target, notes)):
        if column >= 0:
            out[:, step] = values[:, column]
    return out


def _columns(data: Fitted, target: Target, notes: list[str]) -> list[int]:
    """For each step that is measured, the column of the data, or -1."""
    count, times = data.values.shape[1], target.times[target.observed]
    if data.times is None:
        if count == len(times):
            if count > 1:
                notes.append(f"{data.name}: nobody says when its {count} volumes are of; taken for the steps in order")
            return list(range(count))
        what = "one time" if count == 1 else f"{count} times"
        raise ShapeError(
            f"{data.name}: values of {what}, and nobody says when; the scene measures {len(times)} steps, from "
            f"{time_text(times[0])} to {time_text(times[-1])}: give --times, or --set observed.steps=[...]"
        )
    step = float(np.diff(target.times).min()) if len(target.times) > 1 else abs(float(target.times[0])) or 1.0
    gap = np.abs(data.times[:, None] - times[None, :])
    near = gap <= _NEAR * step
    if not near.any():
        k, j = np.unravel_index(int(gap.argmin()), gap.shape)
        raise ShapeError(
            f"{data.name}: none of its times is one that the scene measures; the nearest is {data.times[k]:.6g} s "
            f"beside {times[j]:.6g} s. They run from {data.times.min():.6g} to {data.times.max():.6g} s, the scene's "
            f"from {times[0]:.6g} to {times[-1]:.6g} s; {_other_unit(data.times, times, step) or _COUNTED}"
        )
    lost = int((~near.any(axis=1)).sum())
    if lost:
        hint = f" ({other})" if (other := _other_unit(data.times, times, step)) else ""
        notes.append(f"{data.name}: {lost} of {len(data.times)} times are none that the scene measures; left out{hint}")
    return [int(np.argmax(near[:, j])) if near[:, j].any() else -1 for j in range(len(times))]


def _other_unit(given: Array, times: Array, step: float) -> str:
    """Say in which unit most times would be the scene's; nothing if as many are as they stand."""
    own = _share(given, times, step)
    for unit, scale in (("ms", 1e-3), ("us", 1e-6)):
        if _share(scale * given, times, step) > max(0.5, own):
            return (
                f"they fit if they are in {unit}: say so in the file ('time [{unit}]' in a table, xyzt_units in NIfTI, "
                "time_unit in arrays), or give --times"
            )
    return ""


def _share(given: Array, times: Array, step: float) -> float:
    """Share of some times that are the scene's."""
    return float((np.abs(given[:, None] - times) <= _NEAR * step).any(axis=1).mean())


def _harmonic(data: Fitted, values: Array, target: Target, notes: list[str]) -> Array:
    """Re(v exp(iωt)) at the steps that are measured."""
    times = target.times[target.observed]
    if values.shape[1] != 1:
        raise ShapeError(f"{data.name}: complex values at {values.shape[1]} times; expected one phasor for each place")
    frequency = _frequency(data, target)
    if data.frequency is None and frequency is not None:
        notes.append(f"{data.name}: nobody says the frequency; taken as the scene's, {frequency:.6g} Hz")
    if frequency is not None and target.frequency is not None and abs(frequency / target.frequency - 1.0) > _NEAR:
        raise ShapeError(
            f"{data.name}: is of {frequency:.6g} Hz, but the scene's model is of {target.frequency:.6g} Hz"
        )
    if frequency is None or not (np.isfinite(frequency) and frequency > 0):
        raise ShapeError(f"{data.name}: complex values, and nobody says of which frequency; give --frequency in Hz")
    turns = np.exp(2j * np.pi * frequency * times)
    return np.asarray(np.real(values * turns[None, :]))


def _frequency(data: Fitted, target: Target) -> float | None:
    return target.frequency if data.frequency is None else data.frequency


def _repeated(data: Fitted, target: Target) -> list[str]:
    """Warning of steps whose noise is the same: those of a phasor are all made of its two numbers.

    The steps count it as independent. Of all of them together, what they say of the phasor has then a variance that
    is too small by at most the largest eigenvalue of D'D, D having the rows cos ωt, −sin ωt; it is 1 for two steps a
    quarter of the period apart.
    """
    phase = 2 * np.pi * (_frequency(data, target) or 0.0) * target.times[target.observed]
    rows = np.stack([np.cos(phase), -np.sin(phase)], axis=1)
    much = float(np.linalg.norm(rows, 2))
    if much < _REPEATED:
        return []
    return [
        f"{data.name}: {len(phase)} steps are made of one phasor a place, so that their noise is not independent as is "
        f"supposed: an estimator that sees all of them states deviations up to {much:.1f} times too small; observe two "
        f"steps a quarter of the period apart (--set observed.steps=[...]), or state {much:.1f} times the noise"
    ]


def merge(parts: Sequence[tuple[str, Array, Array | None]], target: Target) -> tuple[Array, Array | None]:
    """Put data of several files together; ShapeError if two give the same measurement."""
    values = np.full((target.count, len(target.observed)), np.nan)
    sigma = None if any(each[2] is None for each in parts) else np.full(values.shape, np.nan)
    if sigma is None and any(each[2] is not None for each in parts):
        raise ShapeError("data: some files say sigma and others do not; give it in all, or --noise for all of them")
    whose = np.full(values.shape, -1)
    for number, (name, some, spread) in enumerate(parts):
        here = ~np.isnan(some)
        if (whose[here] >= 0).any():
            row = int(np.flatnonzero((here & (whose >= 0)).any(axis=1))[0])
            other = parts[int(whose[row].max())][0]
            raise ShapeError(f"{name}: {target.functionals.labels[row]} is measured in {other}, too; give it once")
        values[here], whose[here] = some[here], number
        if sigma is not None and spread is not None:
            sigma[here] = spread[here]
    return values, sigma


def choose(values: Array, sigma: Array | None, target: Target, warnings: list[str]) -> Used:
    """Choose steps and functionals without gaps that keep most values.

    An estimator takes the same functionals at every step. Steps are sorted by what is missing in them; of the first
    so many, and the functionals that have values at all of these, the most values are kept.
    """
    there = ~np.isnan(values)
    order = np.argsort(-there.sum(axis=0), kind="stable")
    complete = np.logical_and.accumulate(there[:, order], axis=1)
    kept = complete.sum(axis=0) * np.arange(1, len(order) + 1)
    last = len(kept) - 1 - int(np.argmax(kept[::-1]))
    if kept[last] == 0:
        raise ShapeError("data: no measurement of the scene has a value; nothing can be reconstructed")
    chosen = np.sort(order[: last + 1])
    mask = np.asarray(there[:, chosen].all(axis=1))
    absent = int((~there.any(axis=1)).sum())
    if absent:
        warnings.append(
            f"{absent} of {len(values)} measurements of the scene have no value ({absent / len(values):.0%})"
        )
    if len(chosen) < len(target.observed):
        warnings.append(f"{len(chosen)} of the {len(target.observed)} steps that the scene measures are used")
    lost = int(there.sum()) - int(kept[last])
    if lost:
        warnings.append(
            f"{lost} of {int(there.sum())} values are not used: the same measurements are taken at every step, and "
            "these have gaps"
        )
    return Used(
        np.where(mask[:, None], values[:, chosen], np.nan), None if sigma is None else sigma[:, chosen],
        target.observed[chosen], mask,
    )  # fmt: skip
