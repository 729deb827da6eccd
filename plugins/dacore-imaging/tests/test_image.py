"""Averages over the voxels of an image's own grid: exact for any affine."""

import nibabel as nib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dacore.errors import ShapeError, StoreError
from dacore.testing import observation_suite, run
from dacore_imaging.image import Image
from dacore_imaging.voxels import Voxels


def save(path, shape, affine, array=None):
    image = nib.Nifti1Image(np.zeros(shape, np.uint8) if array is None else array, affine)
    image.header.set_xyzt_units("mm", "sec")
    nib.save(image, path)
    return path


def in_mm(affine):
    out = np.array(affine, dtype=float)
    out[:3] *= 10.0
    return out


def test_an_upright_image_measures_what_voxels_do(make_space, tmp_path):
    space = make_space()
    affine = np.array([[0.5, 0, 0, 0.25], [0, 1.0, 0, 0.5], [0, 0, -1.5, 2.25], [0, 0, 0, 1]])
    file = save(tmp_path / "a.nii.gz", (6, 3, 2), in_mm(affine))
    ours = Image(file, coverage=0.3).functionals(space)
    theirs = Voxels(affine=affine, shape=(6, 3, 2), coverage=0.3).functionals(space)
    assert ours.labels == theirs.labels
    assert np.allclose(ours.centres, theirs.centres)
    assert abs(ours.matrix - theirs.matrix).max() < 1e-12
    assert ours.spacing == pytest.approx((0.5, 1.0, 1.5))
    assert (ours.unit, ours.dropped) == (theirs.unit, theirs.dropped)


numbers = st.floats(-1.0, 1.0, allow_nan=False)


@settings(max_examples=15, deadline=None)
@given(st.lists(numbers, min_size=9, max_size=9), st.lists(numbers, min_size=3, max_size=3), st.integers(0, 10**6))
def test_any_affine_gives_exact_averages_of_linear_fields(make_space, tmp_path_factory, matrix, shift, seed):
    """Rotated, stretched, sheared and mirrored voxels that lie inside average a linear field to its centre's value."""
    edges = 0.5 * np.array(matrix).reshape(3, 3) + 0.6 * np.eye(3)[:, [1, 2, 0]] * [1, -1, 1]
    lengths = np.linalg.norm(edges, axis=0)
    if lengths.min() < 0.2 or abs(np.linalg.det(edges / lengths)) < 0.2:
        return  # needles: what single precision leaves of the header says more than the average
    space = make_space(order=1)
    affine = np.eye(4)
    affine[:3, :3] = edges
    affine[:3, 3] = 1.5 + np.array(shift) - edges @ np.full(3, 1.5)
    file = save(tmp_path_factory.mktemp("affine") / "a.nii", (4, 4, 4), in_mm(affine))
    rng = np.random.default_rng(seed)
    slope, offset = rng.standard_normal((3, 3)), rng.standard_normal(3)
    try:
        measured = Image(file, coverage=1.0 - 1e-6).functionals(space)
    except ShapeError:
        return  # no voxel lies wholly inside
    state = space.state(u=lambda x: x @ slope.T + offset)
    expected = np.einsum("mi,mi->m", measured.directions, measured.centres @ slope.T + offset)
    assert np.abs(measured(state) - expected).max() < 1e-6


def test_partial_voxels_of_a_sheared_grid_fill_the_domain(make_space, tmp_path):
    """Integrals over all voxels, inside or not, add up to that over the domain: nothing is lost or counted twice."""
    space = make_space()
    edges = np.array([[0.9, 0.3, 0.1], [-0.2, 1.1, 0.2], [0.0, -0.3, 0.8]])
    affine = np.eye(4)
    affine[:3, :3] = edges
    affine[:3, 3] = np.full(3, 1.5) - edges @ np.full(3, 9.5)
    file = save(tmp_path / "a.nii", (20, 20, 20), in_mm(affine))
    measured = Image(file, field="p", coverage=0.0).functionals(space)
    from dacore_imaging.image import SkewGrid
    from dacore_imaging.layers import Layer, cover

    grid = SkewGrid(affine)
    part = cover(space.cells(), "p", Layer.over(space.cells(), grid, (20, 20, 20), None), 0.0, "exact")
    assert len(part.centres) == measured.count
    fill = np.asarray(part.integrals.sum(axis=1)).ravel()
    assert fill.sum() * grid.volume == pytest.approx(27.0, rel=1e-9)
    assert measured.spacing == ()


def test_a_placement_moves_places_and_turns_vectors(make_space, tmp_path):
    space = make_space()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = turn, (3.0, 0.0, 0.0)
    affine = np.diag([1.0, 1, 1, 1])
    affine[:3, 3] = 0.5
    file = save(tmp_path / "a.nii", (3, 3, 3), in_mm(affine))
    measured = Image(file, placement=placement.tolist()).functionals(space)
    plain = Image(file).functionals(space)
    assert np.allclose(measured.centres, plain.centres @ turn.T + [3.0, 0, 0])
    assert np.allclose(Image(file, placement=placement.tolist()).to_scene, placement)
    # Components are the scene's: rows differ in place alone.
    state = space.state(u=lambda x: x)
    assert np.allclose(measured(state), np.einsum("mi,mi->m", measured.directions, measured.centres))


def test_a_mask_leaves_voxels_out(make_space, tmp_path):
    space = make_space()
    affine = np.eye(4)
    affine[:3, 3] = 0.5
    file = save(tmp_path / "a.nii", (3, 3, 3), in_mm(affine))
    inside = np.zeros((3, 3, 3), np.uint8)
    inside[0, :, 2] = 1
    mask = save(tmp_path / "m.nii", None, in_mm(affine), inside)
    measured = Image(file, mask=mask).functionals(space)
    assert measured.n_sites == 3
    assert np.allclose(np.unique(measured.centres, axis=0), [[0.5, 0.5, 2.5], [0.5, 1.5, 2.5], [0.5, 2.5, 2.5]])


def test_the_content_of_the_files_is_what_counts(tmp_path):
    one = save(tmp_path / "a.nii", (3, 3, 3), np.eye(4))
    first = Image(one).fingerprint()
    same = save(tmp_path / "b.nii", (3, 3, 3), np.eye(4))
    assert Image(same).fingerprint() == first
    save(tmp_path / "a.nii", (3, 3, 4), np.eye(4))
    assert Image(one).fingerprint() != first
    with pytest.raises(ShapeError, match="cannot be read"):
        Image(tmp_path / "none.nii").fingerprint()


def test_what_is_refused(make_space, tmp_path):
    space = make_space()
    file = save(tmp_path / "a.nii", (3, 3, 3), in_mm(np.eye(4)))
    for settings_, words in (
        ({"coverage": 1.5}, "coverage"),
        ({"placement": ((1.0, 0, 0), (0, 1, 0))}, "expected 4 of 4"),
        ({"placement": np.diag([2.0, 1, 1, 1]).tolist()}, "not rigid"),
        ({"placement": np.diag([-1.0, 1, 1, 1]).tolist()}, "not rigid"),
    ):
        with pytest.raises(ShapeError, match=words):
            Image(file, **settings_)
    far = np.eye(4)
    far[0, 3] = 100.0
    with pytest.raises(ShapeError, match="lies outside the domain, from"):
        Image(file, placement=far.tolist()).functionals(space)
    with pytest.raises(StoreError, match="no such file"):
        Image(tmp_path / "none.nii").functionals(space)
    with pytest.raises(ShapeError, match="two dimensions"):
        Image(file).functionals(make_space(dim=2))
    empty = np.zeros((3, 3, 3), np.uint8)
    empty[0, 0, 0] = 1
    mask = save(tmp_path / "m.nii", None, in_mm(np.eye(4)), empty)
    with pytest.raises(ShapeError, match="no voxel of the mask"):
        Image(file, mask=mask).functionals(space)


@pytest.mark.parametrize("field", ["u", "p", "c"])
def test_an_oblique_image_keeps_every_promise_of_a_measurement(tmp_path, field):
    affine = np.eye(4)
    affine[:3, :3] = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]) * 0.7
    affine[:3, 3] = 1.5 - affine[:3, :3] @ np.full(3, 3.5)
    file = save(tmp_path / "a.nii.gz", (8, 8, 8), in_mm(affine))
    suite = observation_suite(Image(file, field=field, coverage=1.0), reproduces="linear")
    assert run(suite) == []
