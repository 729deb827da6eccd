"""State spaces on boxes, so that these tests need no finite element library."""

from itertools import permutations, product

import numpy as np
import pytest

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.mesh import Mesh, exterior_facets
from dacore.testing.spaces import ReferenceBackend, interpolate, without


class BoxSpace(FiniteElementSpace):
    """Elements on a mesh, with states made of functions."""

    @property
    def mesh(self):
        return self.discretization.mesh

    def state(self, **functions):
        """Interpolate functions of points (n, d), given by field name, with values (n,) or (n, c)."""

        def columns(function):
            return lambda x: np.asarray(function(x), dtype=float).reshape(len(x), -1)

        return sum(interpolate(self, name, columns(function)) for name, function in functions.items())


def _box_mesh(dim, n, lengths, jitter, seed, renumber):
    rng = np.random.default_rng(seed)
    counts = np.broadcast_to(np.asarray(n), (dim,))
    lengths = np.broadcast_to(np.asarray(lengths, dtype=float), (dim,))
    grid = np.stack(np.meshgrid(*[np.arange(k + 1) for k in counts], indexing="ij"), axis=-1).reshape(-1, dim)
    inner = ((grid > 0) & (grid < counts)).all(axis=1)
    points = (grid + rng.uniform(-jitter, jitter, grid.shape) * inner[:, None]) * lengths / counts
    strides = np.array([np.prod(counts[a + 1 :] + 1, dtype=int) for a in range(dim)])
    corners = np.array(list(product(*[range(k) for k in counts]))) @ strides
    cells = np.concatenate(
        [corners[:, None] + np.concatenate([[0], np.cumsum(strides[list(o)])]) for o in permutations(range(dim))]
    )
    if renumber:
        new = rng.permutation(len(points))
        moved = np.empty_like(points)
        moved[new] = points
        points, cells = moved, rng.permuted(new[cells], axis=1)
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[negative, :2] = cells[negative, 1::-1]
    facets = exterior_facets(cells)
    tags = np.where(np.isclose(points[facets][:, :, 0], 0.0).all(axis=1), 1, 2)
    return Mesh(points, cells, facets, tags, {"left": 1, "rest": 2})


@pytest.fixture(scope="session")
def make_space():
    """Factory of state spaces on a box [0, lengths] cut in n^d cubes, inner points jittered."""

    def make(dim=3, n=3, lengths=3.0, order=1, jitter=0.25, seed=0, renumber=False):
        mesh = _box_mesh(dim, n, lengths, jitter, seed, renumber)
        fields = [Field("u", dim, order, "cm"), Field("p", 1, 1, "dyn/cm^2"), Field("c", 2, 1, "1")]
        return BoxSpace(ReferenceBackend().discretize(mesh, fields))

    return make


@pytest.fixture(scope="session")
def point_space(make_space):
    """Factory of spaces that have no cells."""
    return lambda **settings: without(make_space(**settings), "cells")
