"""Clipping keeps volume, moments and the numbering's indifference for any grid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from dacore.geometry.clip import box_integrals

SETTINGS = settings(max_examples=40, deadline=None)


@st.composite
def meshes(draw):
    """A Delaunay mesh of random points in grid coordinates of random rotation, box sizes and place."""
    dim = draw(st.sampled_from([2, 3]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = rng.uniform(-1, 1, (draw(st.integers(dim + 1, 12)), dim))
    mesh = Delaunay(points).simplices.astype(np.int64)
    turn, _ = np.linalg.qr(rng.standard_normal((dim, dim)))
    sizes = np.array(draw(st.lists(st.floats(0.3, 3.0), min_size=dim, max_size=dim)))
    shift = np.array(draw(st.lists(st.floats(-20, 20), min_size=dim, max_size=dim)))
    return points @ turn.T / sizes + shift, mesh


def integrals(points, cells):
    lower = np.floor(points.min(axis=0)).astype(int)
    upper = np.maximum(np.ceil(points.max(axis=0)).astype(int), lower + 1)
    return box_integrals(points, cells, cells, 1, lower, upper), lower, upper


@SETTINGS
@given(meshes())
def test_volume_and_first_moments_are_conserved(mesh):
    points, cells = mesh
    matrix, lower, upper = integrals(points, cells)
    corners = points[cells]
    dim = points.shape[1]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / (2 if dim == 2 else 6)
    total = volumes.sum()
    assert matrix.sum() == pytest.approx(total, rel=1e-12)
    moments = (volumes[:, None] * corners.mean(axis=1)).sum(axis=0)
    scale = total * (1 + np.abs(points).max())
    np.testing.assert_allclose((matrix @ points[: matrix.shape[1]]).sum(axis=0), moments, atol=1e-12 * scale)

    fill = np.asarray(matrix.sum(axis=1)).ravel()
    assert (matrix.data >= -1e-15).all()
    assert fill.max() <= 1 + 1e-12
    # The centroid of what a box holds lies in the box.
    numbers = np.stack(np.unravel_index(np.arange(len(fill)), upper - lower), axis=1) + lower
    held = fill > 1e-6
    centroids = (matrix @ points[: matrix.shape[1]])[held] / fill[held, None]
    assert (centroids >= numbers[held] - 1e-8).all()
    assert (centroids <= numbers[held] + 1 + 1e-8).all()


@SETTINGS
@given(meshes(), st.integers(0, 2**32 - 1))
def test_numbering_does_not_matter(mesh, seed):
    points, cells = mesh
    rng = np.random.default_rng(seed)
    new = rng.permutation(len(points))
    renumbered = np.empty_like(points)
    renumbered[new] = points
    turned = rng.permuted(new[cells][rng.permutation(len(cells))], axis=1)
    one, _, _ = integrals(points, cells)
    other, _, _ = integrals(renumbered, turned)
    value = np.sin(np.arange(len(points)))
    moved = np.empty_like(value)
    moved[new] = value
    np.testing.assert_allclose(one @ value[: one.shape[1]], other @ moved[: other.shape[1]], atol=1e-12)
