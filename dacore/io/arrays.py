"""Named arrays with facts beside them in one HDF5 file: what small results of stages are kept as."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dacore.core.arrays import Array
from dacore.errors import StoreError
from dacore.io.atomic import atomic_path


def write_arrays(path: Path, magic: str, arrays: Mapping[str, Any], facts: Mapping[str, Any] | None = None) -> None:
    """Write arrays and facts; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
    magic : str
        What kind of file this is; reading asks for the same.
    arrays : mapping of str to array
        Under any names; each with a Fletcher-32 checksum.
    facts : mapping, optional
        JSON values.
    """
    told = json.dumps({"names": list(arrays), "facts": dict(facts or {})}, ensure_ascii=False).encode()
    try:
        with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
            file.attrs["magic"] = magic
            _keep(file, "told", np.frombuffer(told, dtype=np.uint8))
            # Numbers for names: a field or a label may hold what a path in the file may not.
            for index, values in enumerate(arrays.values()):
                _keep(file, str(index), np.asarray(values))
    except OSError as error:
        raise StoreError(f"{path}: cannot be written ({error}); is the disk full or read-only?") from error


def read_arrays(path: Path, magic: str) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read what `write_arrays` wrote: (arrays by name, facts); StoreError if it is damaged or of another kind."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("magic") != magic:
                raise StoreError(f"{path}: not a {magic} of this version; delete it and run again")
            told = json.loads(file["told"][()].tobytes())
            arrays = {name: np.asarray(file[str(index)][()]) for index, name in enumerate(told["names"])}
            return arrays, dict(told["facts"])
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise StoreError(f"{path}: damaged ({error}); delete it and run again") from error


def _keep(file: h5py.File, name: str, values: Any) -> None:
    # A checksum needs a chunk, and nothing has none.
    checked = {"chunks": values.shape, "fletcher32": True} if values.size and values.ndim else {}
    file.create_dataset(name, data=np.ascontiguousarray(values) if values.ndim else values, **checked)
