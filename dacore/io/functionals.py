"""What is measured, kept on disk: a sparse matrix and what a plot needs to know of its rows."""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from dacore.core.observation import Functionals
from dacore.errors import DacoreError, StoreError
from dacore.io.arrays import read_arrays, write_arrays

MAGIC = "dacore functionals 1"


def write_functionals(functionals: Functionals, path: Path) -> None:
    """Write functionals; the file appears whole or not at all."""
    f = functionals
    matrix = csr_array(f.matrix)
    arrays = {
        "data": matrix.data, "indices": matrix.indices, "indptr": matrix.indptr,
        "centres": f.centres, "directions": f.directions, "sites": f.sites,
    }  # fmt: skip
    facts = {
        "shape": list(matrix.shape), "labels": list(f.labels), "unit": f.unit, "spacing": list(f.spacing),
        "dropped": int(f.dropped),
    }  # fmt: skip
    write_arrays(path, MAGIC, arrays, facts)


def read_functionals(path: Path) -> Functionals:
    """Read functionals; StoreError if the file is damaged."""
    arrays, facts = read_arrays(path, MAGIC)
    try:
        matrix = csr_array((arrays["data"], arrays["indices"], arrays["indptr"]), shape=tuple(facts["shape"]))
        return Functionals(
            matrix, tuple(facts["labels"]), facts["unit"], arrays["centres"], arrays["directions"],
            arrays["sites"].astype(np.int64),
            tuple(facts["spacing"]), facts["dropped"],
        )  # fmt: skip
    except (KeyError, ValueError, DacoreError) as error:
        raise StoreError(f"{path}: damaged ({error}); delete it and run again") from error
