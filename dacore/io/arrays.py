"""Named arrays with facts beside them in one sealed file: what results of stages are kept as."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dacore.core.arrays import Array
from dacore.io.sealed import open_sealed, write_sealed

SCHEMA = 1
_KEY = ""  # the name of the file has the stage's


def write_arrays(path: Path, kind: str, arrays: Mapping[str, Any], facts: Mapping[str, Any] | None = None) -> None:
    """Write arrays and facts; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
    kind : str
        What the file holds; reading asks for the same.
    arrays : mapping of str to array
        Under any names.
    facts : mapping, optional
        JSON values.

    Raises
    ------
    StoreError
        If the file cannot be written.
    """
    told = json.dumps({"names": list(arrays), "facts": dict(facts or {})}, ensure_ascii=False).encode()

    def fill(file: h5py.File) -> None:
        file.create_dataset("told", data=np.frombuffer(told, dtype=np.uint8))
        # Numbers for names: a field or a label may hold what a path in the file may not.
        for index, values in enumerate(arrays.values()):
            file.create_dataset(str(index), data=np.asarray(values))

    write_sealed(path, kind, SCHEMA, _KEY, fill)


def read_arrays(path: Path, kind: str) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read what `write_arrays` wrote: (arrays by name, facts); StoreError if it is damaged or of another kind."""
    with open_sealed(path, kind, SCHEMA, _KEY) as file:
        told = json.loads(file["told"][()].tobytes())
        arrays = {name: np.asarray(file[str(index)][()]) for index, name in enumerate(told["names"])}
        return arrays, dict(told["facts"])
