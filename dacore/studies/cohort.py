"""Synthetic patients by the thousand: drawn group by group, measured through a map from parameters to trajectories.

Every patient has random numbers of their own, so that more patients, other noise levels or another group after
these change nobody. Truths are what the map gives, in the bases of a background: errors of the map itself and of
the compression are in no number found here (`ParametricMap.accuracy` says how large they are).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background, ParametricMap
from dacore.core.display import Displayed
from dacore.core.parameters import ParameterSpace
from dacore.errors import ShapeError

# What the numbers of one patient are drawn for; streams of noise have the level's billionths in its place.
_PARAMETERS = 0


@dataclass(frozen=True)
class Group:
    """Patients with something in common.

    Parameters
    ----------
    name : str
    ranges : mapping of str to (float, float)
        Narrower ranges of some parameters; the others have the ranges of training.
    """

    name: str
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Patients(Displayed):
    """Who is measured.

    Parameters
    ----------
    groups : tuple of Group
    group : (k,) int array
        Which of them each patient belongs to.
    number : (k,) int array
        Of the patient within the group.
    samples : (k, n_parameters) array
        True parameters.
    seed : int
    """

    groups: tuple[Group, ...]
    group: IntArray
    number: IntArray
    samples: Array
    seed: int

    @property
    def count(self) -> int:
        """Number k of patients."""
        return len(self.group)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each patient's group."""
        return tuple(self.groups[each].name for each in self.group)

    def members(self, name: str) -> Array:
        """Which patients (k,) are of the group called `name`."""
        known = [group.name for group in self.groups]
        if name not in known:
            raise ShapeError(f"group {name!r}: expected one of {', '.join(known)}")
        return np.asarray(self.group == known.index(name))

    def noise(self, patient: int, level: float) -> np.random.Generator:
        """Return the stream of a patient's noise at one level."""
        return self._stream(patient, 1 + round(level * 1e9))

    def _stream(self, patient: int, purpose: int) -> np.random.Generator:
        return _stream(self.seed, purpose, int(self.group[patient]), int(self.number[patient]))


def draw_patients(parameters: ParameterSpace, groups: Sequence[Group], counts: Sequence[int], seed: int) -> Patients:
    """Draw patients, each from a stream of their own.

    Parameters
    ----------
    parameters : ParameterSpace
        Of training.
    groups : sequence of Group
    counts : sequence of int
        Patients of each group.
    seed : int

    Raises
    ------
    ShapeError
        If a group has no patients, or a range that leaves that of training.
    """
    if not groups or len(groups) != len(counts) or min(counts) < 1:
        raise ShapeError(
            f"cohort: got {len(groups)} groups of {list(counts)} patients, expected at least one group, and at least "
            "one patient in each"
        )
    names = [group.name for group in groups]
    if len(set(names)) < len(names):
        raise ShapeError(f"cohort: got the groups {', '.join(names)}, expected no name twice")
    spaces = [_restricted(parameters, group) for group in groups]
    which = np.repeat(np.arange(len(groups)), counts)
    number = np.concatenate([np.arange(count) for count in counts])
    rows = [
        spaces[g].sample(_stream(seed, _PARAMETERS, int(g), int(n)), 1)[0] for g, n in zip(which, number, strict=True)
    ]
    return Patients(tuple(groups), which, number, np.stack(rows), seed)


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(Displayed):
    """Some patients' trajectories and data.

    Parameters
    ----------
    coefficients : (r, t, k) array
        Truth, in the background's bases.
    clean : (m, t, k) array
        Exact data.
    """

    coefficients: Array
    clean: Array

    def noisy(self, patients: Patients, numbers: IntArray, level: float) -> tuple[Array, Array]:
        """Data (m, t, k) with noise of σ = Ξ max|ℓ_i(u(t))|, and σ (k,), of these patients' own streams.

        Parameters
        ----------
        patients : Patients
        numbers : (k,) int array
            Which patients these are.
        level : float
            Ξ.
        """
        if not (np.isfinite(level) and level >= 0):
            raise ShapeError(f"noise level: got {level}, expected a number of 0 or more")
        sigmas = level * np.abs(self.clean).max(axis=(0, 1))
        data = self.clean.copy()
        if level > 0:
            for place, patient in enumerate(numbers):
                rng = patients.noise(int(patient), level)
                data[:, :, place] += sigmas[place] * rng.standard_normal(data.shape[:2])
        return data, sigmas


def measured(forward: ParametricMap, observed: Array, points: Array) -> Measurements:
    """Trajectories and exact data of parameters.

    Parameters
    ----------
    forward : ParametricMap
    observed : (m, r) array
        Functionals of the modes (`Background.observe`).
    points : (k, n_parameters) array

    Raises
    ------
    ShapeError
        If the map's trajectories are not in these bases, or not finite.
    """
    coefficients = forward.coefficients(points)
    if coefficients.ndim != 3 or len(coefficients) != observed.shape[1] or coefficients.shape[2] != len(points):
        raise ShapeError(
            f"parametric map: gave trajectories of shape {coefficients.shape}, expected ({observed.shape[1]}, any, "
            f"{len(points)}) = (modes of the background, times, patients)"
        )
    if not np.isfinite(coefficients).all():
        raise ShapeError("parametric map: gave NaN or infinite trajectories; are the parameters inside its ranges?")
    return Measurements(coefficients, np.tensordot(observed, coefficients, axes=1))


def forward_of(background: Background) -> ParametricMap:
    """Return the background's map from parameters to trajectories; CapabilityError if training left none."""
    return background.parametric("this training set has no map from parameters to trajectories, which a cohort needs")


def _restricted(parameters: ParameterSpace, group: Group) -> ParameterSpace:
    for name, (low, high) in group.ranges.items():
        known = parameters[name]
        if not known.low <= low <= high <= known.high:
            raise ShapeError(
                f"group {group.name!r}: got {name} in [{low:g}, {high:g}], expected a part of the range of training, "
                f"[{known.low:g}, {known.high:g}]"
            )
    return parameters.restrict(group.ranges)


def _stream(seed: int, purpose: int, group: int, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, purpose, group, number])
