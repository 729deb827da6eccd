"""A box with a hole, held at the bottom: the smallest head."""

from itertools import permutations

import numpy as np
import pytest

from dacore.core.mesh import Mesh, exterior_facets
from dacore_skfem.backend import SkfemBackend


def make_head(dim: int = 3, cells: int = 5, length: float = 5.0) -> Mesh:
    """A cube of `cells` cells a side without its middle cell; neck below, ventricles inside, mre around."""
    shape = (cells + 1,) * dim
    axes = [np.arange(n) for n in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    corners = points[(points < cells).all(axis=1) & (points != cells // 2).any(axis=1)]
    simplices = []
    for order in permutations(range(dim)):
        path = np.concatenate([np.zeros((1, dim), dtype=int), np.cumsum(np.eye(dim, dtype=int)[list(order)], axis=0)])
        simplex = np.stack([np.ravel_multi_index(tuple((corners + p).T), shape) for p in path], axis=1)
        if np.linalg.det(np.diff(path, axis=0)) < 0:
            simplex[:, [0, 1]] = simplex[:, [1, 0]]
        simplices.append(simplex)
    every = np.concatenate(simplices)
    facets = exterior_facets(every)
    centres = points[facets].mean(axis=1)
    inside = ((centres > 0) & (centres < cells)).all(axis=1)
    tags = np.where(inside, 2, np.where(centres[:, -1] == 0, 1, 3))
    return Mesh(points * (length / cells), every, facets, tags, {"neck": 1, "ventricles": 2, "mre": 3})


@pytest.fixture(scope="session")
def head():
    return make_head


@pytest.fixture(scope="session")
def on():
    """Turn a mesh into what `Physics.build` asks for."""
    return lambda mesh: lambda fields: SkfemBackend().discretize(mesh, fields)
