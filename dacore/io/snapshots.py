"""Training and test trajectories on disk: one HDF5 file a trajectory, each written atomically.

A folder holds what belongs to one key. A file is complete or not there, so a killed run loses
the trajectories in flight and nothing else; every dataset carries Fletcher-32 checksums.
"""

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.atomic import atomic_path, make_folder

logger = logging.getLogger(__name__)

SCHEMA = 1
MAGIC = "dacore trajectory"


class TrajectoryStore:
    """A folder of trajectories that belong to one key.

    Parameters
    ----------
    folder : Path
        Made if missing.
    key : str
        What the trajectories depend on, as a hash; a file of another key is refused.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key
        make_folder(folder)

    def path(self, index: int) -> Path:
        """File of trajectory `index`."""
        return self.folder / f"trajectory_{index:05d}.h5"

    def __contains__(self, index: int) -> bool:
        return self.path(index).exists()

    def intact(self, index: int) -> bool:
        """Whether a trajectory is there and can be read whole; a damaged one is set aside with a warning."""
        if index not in self:
            return False
        try:
            self.read(index)
        except StoreError as error:
            aside = self.path(index).with_suffix(".damaged")
            self.path(index).replace(aside)
            logger.warning("%s; kept as %s, computing it again", str(error).partition(";")[0], aside.name)
            return False
        return True

    def write(self, index: int, trajectory: Trajectory, parameters: Array, units: Mapping[str, str]) -> None:
        """Write one trajectory; the file appears whole or not at all.

        Parameters
        ----------
        index : int
        trajectory : Trajectory
        parameters : (n_parameters,) array
        units : mapping of str to str
            Unit of each field.
        """
        target = self.path(index)
        arrays = {"states": trajectory.states, "times": trajectory.times, "parameters": parameters}
        try:
            with atomic_path(target) as temporary, h5py.File(temporary, "w") as file:
                file.attrs["magic"] = MAGIC
                file.attrs["schema"] = SCHEMA
                file.attrs["key"] = self.key
                file.attrs["units"] = json.dumps(dict(units))
                for name, values in arrays.items():
                    file.create_dataset(name, data=np.ascontiguousarray(values), chunks=values.shape, fletcher32=True)
        except OSError as error:
            raise StoreError(f"{target}: cannot be written ({error}); is the disk full or read-only?") from error

    def read(self, index: int) -> tuple[Trajectory, Array]:
        """Read one trajectory and its parameters; StoreError if it is missing, damaged or foreign."""
        path = self.path(index)
        try:
            with h5py.File(path, "r") as file:
                self._check(path, file.attrs)
                states, times, parameters = (np.asarray(file[name][:]) for name in ("states", "times", "parameters"))
        except (OSError, KeyError) as error:
            raise StoreError(f"{path}: damaged or not a trajectory ({error}); delete it and run again") from error
        return Trajectory(states, times), parameters

    def _check(self, path: Path, attributes: Mapping[str, Any]) -> None:
        if attributes.get("magic") != MAGIC:
            raise StoreError(f"{path}: not a dacore trajectory; delete it and run again")
        if attributes.get("schema") != SCHEMA:
            raise StoreError(
                f"{path}: written with schema {attributes.get('schema')}, this version reads {SCHEMA}; "
                "delete it and run again"
            )
        if attributes.get("key") != self.key:
            raise StoreError(
                f"{path}: belongs to other settings (key {attributes.get('key')}); delete it and run again"
            )
