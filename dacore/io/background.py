"""Backgrounds on disk: one HDF5 file, written atomically."""

import json
from pathlib import Path

import h5py
import numpy as np

from dacore.core.background import Background
from dacore.core.parameters import ParameterSpace
from dacore.core.reduced import ReducedSpace
from dacore.core.space import Product, StateSpace
from dacore.errors import DacoreError, StoreError
from dacore.io.atomic import atomic_path

SCHEMA = 1
MAGIC = "dacore background"


def write_background(background: Background, path: Path) -> None:
    """Write a background; the file appears whole or not at all."""
    try:
        with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
            file.attrs["magic"] = MAGIC
            file.attrs["schema"] = SCHEMA
            file.attrs["kind"] = background.kind
            file.attrs["compression"] = json.dumps(dict(background.compression))
            for name in ("coefficients", "times", "samples"):
                values = np.ascontiguousarray(getattr(background, name))
                file.create_dataset(name, data=values, chunks=values.shape, fletcher32=True)
            for name, basis in background.bases.items():
                group = file.create_group(f"bases/{name}")
                group.create_dataset("basis", data=basis.basis, chunks=basis.basis.shape, fletcher32=True)
                group.create_dataset("singular_values", data=basis.singular_values)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written ({error}); is the disk full or read-only?") from error


def read_background(path: Path, space: StateSpace, parameters: ParameterSpace) -> Background:
    """Read a background of `space`; StoreError if the file is damaged or of another space."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("magic") != MAGIC or file.attrs.get("schema") != SCHEMA:
                raise StoreError(f"{path}: not a background of this version; delete it and run again")
            kind: Product = "h1" if file.attrs["kind"] == "h1" else "l2"
            bases = {
                field.name: ReducedSpace(
                    np.asarray(file[f"bases/{field.name}/basis"][:]),
                    np.asarray(file[f"bases/{field.name}/singular_values"][:]),
                    space.field_product(field.name, kind),
                )
                for field in space.fields
            }
            arrays = [np.asarray(file[name][:]) for name in ("coefficients", "times", "samples")]
            compression = json.loads(str(file.attrs["compression"]))
    except StoreError:
        raise
    except (OSError, KeyError, ValueError, DacoreError) as error:
        raise StoreError(f"{path}: damaged or of another space ({error}); delete it and run again") from error
    coefficients, times, samples = arrays
    return Background(space, bases, coefficients, times, parameters, samples, kind, compression)
