"""Trajectories in a store, read one at a time; kept as a note that all of them are there."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Card, Displayed, count
from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.atomic import atomic_write
from dacore.io.snapshots import TrajectoryStore


@dataclass(frozen=True, repr=False)
class TrajectorySet(Displayed, Sequence[Trajectory]):
    """Trajectories in a store, read one at a time.

    Parameters
    ----------
    store : TrajectoryStore
    samples : (K, n_parameters) array
    solved : int
        How many were solved in this run.
    mend : callable, optional
        Solves again what is missing in the store; called where a file turns out to be damaged.
    less_mean : tuple of slice
        Rows of the states that are seen less their mean over the steps.
    """

    store: TrajectoryStore
    samples: Array
    solved: int
    mend: Callable[[], int] | None = None
    less_mean: tuple[slice, ...] = ()

    def _card(self) -> Card:
        facts = ("trajectories", count(len(self))), ("solved in this run", count(self.solved))
        return Card("TrajectorySet", (*facts, ("in", str(self.store.folder))))

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> list[Trajectory]: ...
    def __getitem__(self, index: int | slice) -> Trajectory | list[Trajectory]:
        if isinstance(index, slice):
            return [self._read(k) for k in range(len(self))[index]]
        return self._read(range(len(self))[index])

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[index] for index in range(len(self)))

    def _read(self, index: int) -> Trajectory:
        found = self._stored(index)
        for rows in self.less_mean:
            # What was read is nobody else's yet.
            found.states[rows] -= found.states[rows].mean(axis=1, keepdims=True)
        return found

    def _stored(self, index: int) -> Trajectory:
        try:
            return self.store.read(index)[0]
        except StoreError:
            # Sets a damaged file aside, and says so.
            if self.mend is None or self.store.intact(index):
                raise
            self.mend()
            return self.store.read(index)[0]


def write_note(trajectories: TrajectorySet, path: Path) -> None:
    """Note that all trajectories of a set are in its store; the file appears whole or not at all."""
    note = {"samples": trajectories.samples.tolist()}
    with atomic_write(path) as stream:
        stream.write(json.dumps(note) + "\n")


def read_note(path: Path, folder: Path, mend: Callable[[Array, TrajectoryStore], int]) -> TrajectorySet:
    """Return the set of a note without reading a trajectory; StoreError if one of its files is not there.

    Parameters
    ----------
    path : Path
    folder : Path
        Of the trajectories; its name is their key.
    mend : callable
        (samples, store) -> how many were solved: solves what is missing in the store.
    """
    try:
        samples = np.asarray(json.loads(path.read_text(encoding="utf-8"))["samples"], dtype=np.float64)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path}: damaged ({error}); delete it and run again") from error
    if samples.ndim != 2 or not folder.is_dir():
        raise StoreError(f"{path}: its trajectories are gone; delete it and run again")
    store = TrajectoryStore(folder, folder.name)
    missing = [index for index in range(len(samples)) if index not in store]
    if missing:
        raise StoreError(f"{path}: {len(missing)} of its {len(samples)} trajectories are gone; delete it and run again")
    return TrajectorySet(store, samples, 0, lambda: mend(samples, store))
