"""Meshes in the cache: exact copies, quick to read, checked again on reading."""

import json
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from dacore.core.mesh import Mesh
from dacore.errors import DacoreError, StoreError
from dacore.io.atomic import atomic_path


def write_mesh_cache(mesh: Mesh, path: Path) -> None:
    """Write a mesh as NPZ; the file appears whole or not at all."""
    with atomic_path(path) as temporary:
        np.savez(
            temporary, points=mesh.points, cells=mesh.cells, facets=mesh.facets, facet_tags=mesh.facet_tags,
            roles=np.array(json.dumps(dict(mesh.roles))),
        )  # fmt: skip


def read_mesh_cache(path: Path) -> Mesh:
    """Read a mesh; StoreError if the file is damaged."""
    try:
        with np.load(path) as file:
            roles = json.loads(str(file["roles"]))
            return Mesh(file["points"], file["cells"], file["facets"], file["facet_tags"], roles)
    except (OSError, KeyError, ValueError, BadZipFile, DacoreError) as error:
        raise StoreError(f"{path}: damaged ({error}); delete it and run again") from error
