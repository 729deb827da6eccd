"""The nearest point of a mesh against plain minimisation over every facet."""

import numpy as np
import pytest
from scipy.optimize import nnls

from dacore.geometry import nearest
from dacore.geometry.nearest import NearestPoint
from dacore.testing.meshes import graded_box, shuffled_box


def exhaustive(mesh, x):
    """Distance to the boundary: for every facet, the convex combination of its corners nearest to the point."""
    out = np.full(len(x), np.inf)
    heavy = 1e4  # pulls the weights' sum to one
    for facet in mesh.facets:
        corners = mesh.points[facet]
        for k, point in enumerate(x):
            system = np.vstack([(corners - point).T, np.full(len(facet), heavy)])
            weights = nnls(system, np.append(np.zeros(mesh.dim), heavy))[0]
            weights /= weights.sum()
            out[k] = min(out[k], np.linalg.norm(weights @ corners - point))
    return out


def bumpy(dim):
    return shuffled_box(dim, 3, seed=1, bumpy=True, hole=True)


def graded(dim):
    return graded_box(dim, 3, seed=2)


@pytest.mark.parametrize("make", [bumpy, graded])
@pytest.mark.parametrize("dim", [2, 3])
def test_is_the_nearest_point_of_any_facet(dim, make, monkeypatch):
    monkeypatch.setattr(nearest, "_FIRST", 2)  # so that more have to be tried
    mesh = make(dim)
    rng = np.random.default_rng(dim)
    # Around the mesh and in its hole, which is in the middle.
    x = np.concatenate([rng.uniform(-0.5, 1.5, size=(60, dim)), rng.uniform(0.45, 0.55, size=(5, dim)), [[9.0] * dim]])
    cell, barycentric, distance = NearestPoint(mesh.points, mesh.cells).find(x)
    assert barycentric.min() >= 0
    np.testing.assert_allclose(barycentric.sum(axis=1), 1.0, atol=1e-14)
    assert ((barycentric == 0).sum(axis=1) >= 1).all()
    place = np.einsum("pk,pkd->pd", barycentric, mesh.points[mesh.cells[cell]])
    np.testing.assert_allclose(np.linalg.norm(x - place, axis=1), distance, atol=1e-13)
    np.testing.assert_allclose(distance, exhaustive(mesh, x), atol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_of_the_boundary_are_their_own_nearest(dim):
    mesh = shuffled_box(dim, 4, seed=2, bumpy=True, hole=True)
    middles = mesh.points[mesh.facets].mean(axis=1)
    x = np.concatenate([mesh.points[np.unique(mesh.facets)], middles])
    _, _, distance = NearestPoint(mesh.points, mesh.cells).find(x)
    assert distance.max() < 1e-14


def test_how_many_are_tried_at_once_changes_nothing(monkeypatch):
    mesh = shuffled_box(3, 4, seed=3, bumpy=True)
    x = np.random.default_rng(0).uniform(-1, 2, size=(200, 3))
    whole = NearestPoint(mesh.points, mesh.cells).find(x)
    monkeypatch.setattr(nearest, "_PAIRS", 7)
    for one, other in zip(NearestPoint(mesh.points, mesh.cells).find(x), whole, strict=True):
        np.testing.assert_array_equal(one, other)
