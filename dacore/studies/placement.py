"""Where to measure: candidates taken one by one, each time the one that helps most.

A candidate is a group of functionals, a slice or a sensor. What a choice is worth is a `Criterion`; beside the greedy
order stand random ones and, where there are few enough, the best of all choices.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Generic, TypeVar

import numpy as np

from dacore.core.arrays import Array, IntArray
from dacore.core.display import Displayed
from dacore.core.observation import Functionals
from dacore.errors import ShapeError

State = TypeVar("State")

Candidates = tuple[IntArray, ...]


class Criterion(ABC, Generic[State]):
    """What a choice of candidates is worth.

    Attributes
    ----------
    larger_is_better : bool
    """

    larger_is_better: bool

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of candidates."""

    @abstractmethod
    def nothing(self) -> State:
        """State in which no candidate is chosen."""

    @abstractmethod
    def add(self, state: State, candidate: int) -> State:
        """State with one more candidate; the old one stays as it is."""

    @abstractmethod
    def value(self, state: State) -> float:
        """What the chosen are worth."""

    def merit(self, state: State, candidate: int) -> float:
        """How good it is to add a candidate, larger being better; compared among candidates of one state only."""
        value = self.value(self.add(state, candidate))
        return value if self.larger_is_better else -value


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Displayed):
    """An order of candidates and what it is worth.

    Parameters
    ----------
    order : (p,) int array
        Candidates, the most helpful first.
    values : (p + 1,) array
        Criterion with none, one, … p of them.
    random : (R, p + 1) array
        The same of random orders.
    best : (p + 1,) array
        The best value of any choice of so many; NaN where there are too many to try.
    choices : tuple of tuple of int
        One of the best choices of each size; empty where not tried.
    larger_is_better : bool
    """

    order: IntArray
    values: Array
    random: Array
    best: Array
    choices: tuple[tuple[int, ...], ...]
    larger_is_better: bool


def place(
    criterion: Criterion[State],
    picks: int,
    random: int = 0,
    rng: np.random.Generator | None = None,
    exhaustive: int = 2000,
) -> Placement:
    """Choose greedily.

    Parameters
    ----------
    criterion : Criterion
    picks : int
        Candidates to choose.
    random : int
        Random orders beside it.
    rng : numpy.random.Generator, optional
        Needed for these.
    exhaustive : int
        Choices of one size that are tried at most to find the best of that size.

    Raises
    ------
    ShapeError
        If there are fewer candidates than picks.
    """
    if not 1 <= picks <= criterion.count:
        raise ShapeError(f"picks: got {picks}, expected 1 to {criterion.count}, the number of candidates")
    if random and rng is None:
        raise ShapeError(f"placement: {random} random orders need a random generator")
    state = criterion.nothing()
    order: list[int] = []
    values = [criterion.value(state)]
    for _ in range(picks):
        left = [c for c in range(criterion.count) if c not in order]
        order.append(left[int(np.argmax([criterion.merit(state, c) for c in left]))])
        state = criterion.add(state, order[-1])
        values.append(criterion.value(state))
    orders = [rng.permutation(criterion.count)[:picks] for _ in range(random)] if rng is not None else []
    others = np.array([values_of(criterion, each) for each in orders]).reshape(len(orders), picks + 1)
    best, choices = _best(criterion, picks, exhaustive)
    return Placement(np.array(order), np.array(values), others, best, choices, criterion.larger_is_better)


def values_of(criterion: Criterion[State], order: Sequence[int] | IntArray) -> Array:
    """Criterion (p + 1,) with none, one, … all of some candidates in their order."""
    state = criterion.nothing()
    values = [criterion.value(state)]
    for candidate in order:
        state = criterion.add(state, int(candidate))
        values.append(criterion.value(state))
    return np.array(values)


def _best(criterion: Criterion[State], picks: int, limit: int) -> tuple[Array, tuple[tuple[int, ...], ...]]:
    """Best value and choice of each size; only what the last choice does not share is computed anew."""
    values = np.full(picks + 1, np.nan)
    values[0] = criterion.value(criterion.nothing())
    choices: list[tuple[int, ...]] = [()]
    sign = 1.0 if criterion.larger_is_better else -1.0
    for size in range(1, picks + 1):
        if comb(criterion.count, size) > limit:
            choices.append(())
            continue
        path: list[tuple[int, State]] = []
        found = -np.inf
        chosen: tuple[int, ...] = ()
        for choice in combinations(range(criterion.count), size):
            shared = 0
            while shared < len(path) and path[shared][0] == choice[shared]:
                shared += 1
            del path[shared:]
            for candidate in choice[shared:]:
                path.append((candidate, criterion.add(path[-1][1] if path else criterion.nothing(), candidate)))
            value = sign * criterion.value(path[-1][1])
            if value > found:
                found, chosen = value, choice
        values[size] = sign * found
        choices.append(chosen)
    return values, tuple(choices)


def by_site(functionals: Functionals) -> Candidates:
    """One candidate a voxel or sensor: all components measured there."""
    return groups_of(functionals.sites)


def by_plane(functionals: Functionals, axis: int) -> tuple[Array, Candidates]:
    """One candidate a slice: what is measured at one coordinate.

    Parameters
    ----------
    functionals : Functionals
    axis : int
        Normal to the slices.

    Returns
    -------
    positions : (g,) array [cm]
        Rising.
    candidates : g index arrays
    """
    if not 0 <= axis < functionals.centres.shape[1]:
        raise ShapeError(f"axis: got {axis}, expected 0 to {functionals.centres.shape[1] - 1}")
    where = functionals.centres[:, axis]
    places = np.round(where, 6)
    return np.unique(places), groups_of(places)


def groups_of(labels: Array | IntArray) -> Candidates:
    """Functionals of one label together, labels rising."""
    return tuple(np.flatnonzero(labels == each) for each in np.unique(labels))


def check_candidates(candidates: Candidates, m: int) -> None:
    """Raise ShapeError unless candidates are groups of m functionals, none empty and no functional in two."""
    together = np.concatenate(candidates) if candidates else np.empty(0, dtype=int)
    if not candidates or min(len(each) for each in candidates) == 0:
        raise ShapeError("candidates: got none, or an empty one; expected groups of functionals")
    if together.min() < 0 or together.max() >= m or len(np.unique(together)) < len(together):
        raise ShapeError(f"candidates: expected numbers from 0 to {m - 1}, none of them twice")
