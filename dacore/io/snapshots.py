"""Training and test trajectories on disk: one sealed HDF5 file a trajectory, each written atomically.

A folder holds what belongs to one key. A file is complete or not there, so a killed run loses the
trajectories in flight and nothing else. Finding out which are there reads 512 bytes of each; its
checksum is compared whenever a trajectory is used.
"""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import Trajectory
from dacore.errors import StoreError
from dacore.io.atomic import make_folder
from dacore.io.sealed import check_seal, open_sealed, write_sealed
from dacore.plugins.versions import versions

logger = logging.getLogger(__name__)

SCHEMA = 2
KIND = "dacore trajectory"


@dataclass(frozen=True)
class Provenance:
    """Where a trajectory comes from.

    Parameters
    ----------
    key : str
        Hash of everything it depends on.
    parameters : mapping of str to float
        Values by name.
    units : mapping of str to str
        Unit of each field.
    versions : mapping of str to str
        Of dacore and of the plugins installed where it was written.
    """

    key: str
    parameters: Mapping[str, float]
    units: Mapping[str, str]
    versions: Mapping[str, str]


class TrajectoryStore:
    """A folder of trajectories that belong to one key.

    Several processes may use one folder at once: they never see half a file, and whoever ends last
    leaves the same content.

    Parameters
    ----------
    folder : Path
        Made if missing; half-written files of killed processes are removed from it.
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
        """Whether a trajectory is there, of this key and schema, and not cut short; reads 512 bytes.

        What is not is set aside with a warning. A changed byte is found when the trajectory is read.
        """
        if index not in self:
            return False
        try:
            check_seal(self.path(index), KIND, SCHEMA, self.key)
        except StoreError as error:
            self._set_aside(index, error)
            return False
        return True

    def write(
        self, index: int, trajectory: Trajectory, parameters: Array, names: Sequence[str], units: Mapping[str, str]
    ) -> None:
        """Write one trajectory; the file appears whole or not at all, and the same content gives the same bytes.

        Parameters
        ----------
        index : int
        trajectory : Trajectory
        parameters : (n_parameters,) array
        names : sequence of str
            Of the parameters.
        units : mapping of str to str
            Unit of each field.

        Raises
        ------
        StoreError
            If there is no room or no right to write; nothing else in the folder changes.
        """
        if len(names) != len(parameters):
            raise StoreError(f"{self.path(index)}: got {len(names)} names for {len(parameters)} parameters")
        facts = {"parameters": list(names), "units": dict(units), "versions": versions()}

        def fill(file: h5py.File) -> None:
            file.attrs["provenance"] = json.dumps(facts)
            file["states"] = np.ascontiguousarray(trajectory.states)
            file["times"] = np.ascontiguousarray(trajectory.times)
            file["parameters"] = np.ascontiguousarray(parameters)

        write_sealed(self.path(index), KIND, SCHEMA, self.key, fill)

    def read(self, index: int) -> tuple[Trajectory, Array]:
        """Read one trajectory and its parameters, its checksum compared.

        Raises
        ------
        StoreError
            If it is missing, damaged or foreign; it is then set aside, and the next run solves it again.
        """
        try:
            with open_sealed(self.path(index), KIND, SCHEMA, self.key) as file:
                states, times, parameters = (np.asarray(file[name][...]) for name in ("states", "times", "parameters"))
        except StoreError as error:
            if index in self:
                self._set_aside(index, error)
            raise
        return Trajectory(states, times), parameters

    def provenance(self, index: int) -> Provenance:
        """Where a trajectory comes from; StoreError as `read`, but nothing is set aside."""
        with open_sealed(self.path(index), KIND, SCHEMA, self.key) as file:
            facts = json.loads(str(file.attrs["provenance"]))
            values = np.asarray(file["parameters"][...])
        named = dict(zip(facts["parameters"], values.tolist(), strict=True))
        return Provenance(self.key, named, facts["units"], facts["versions"])

    def _set_aside(self, index: int, error: StoreError) -> None:
        aside = self.path(index).with_suffix(".damaged")
        try:
            self.path(index).replace(aside)
        except FileNotFoundError:  # another process was quicker
            return
        except OSError as why:
            raise StoreError(f"{error}; it could not be set aside ({why.strerror})") from why
        logger.warning("%s; kept as %s, to be computed again", str(error).partition(";")[0], aside.name)
