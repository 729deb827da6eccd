"""NIfTI files as others write them (here nibabel): what they mean comes back, and what nobody can know is refused."""

import gzip

import nibabel as nib
import numpy as np
import pytest

from dacore.core.data import Asked, ImageData
from dacore.errors import DacoreError, ShapeError, StoreError
from dacore.testing import format_suite
from dacore_imaging.nifti import Nifti, read_grid

AFFINE = np.array([[10.0, 0, 0, -30], [0, 20, 0, 5], [0, 0, 5, 1], [0, 0, 0, 1]])
SHAPE = (4, 3, 2)


@pytest.fixture
def values():
    return np.random.default_rng(0).standard_normal((*SHAPE, 5, 3)).astype(np.float32)


def save(path, array, affine=AFFINE, units=("mm", "msec"), step=0.5, start=1.0, vector=None, text=""):
    image = nib.Nifti1Image(array, affine)
    image.header.set_xyzt_units(*units)
    if array.ndim > 3:
        image.header["pixdim"][4], image.header["toffset"] = step, start
    if vector if vector is not None else array.ndim == 5:
        image.header.set_intent("vector", (), "")
    image.header["descrip"] = text.encode()
    nib.save(image, path)
    return path


def read(*files, **asked):
    return Nifti().read(list(files), Asked(**asked))


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_five_dimensions(tmp_path, values, suffix):
    data = read(save(tmp_path / f"u{suffix}", values, text="displacement [um]"))
    assert np.array_equal(data.values, values)
    assert np.allclose(data.affine[:3], 0.1 * AFFINE[:3])
    assert np.allclose(data.times, 1e-3 * (1.0 + 0.5 * np.arange(5)))
    assert (data.components, data.unit, data.notes) == ((0, 1, 2), "um", ())


def test_a_file_a_component(tmp_path, values):
    files = [save(tmp_path / f"u_{axis}.nii.gz", values[..., k]) for k, axis in enumerate("xyz")]
    assert np.array_equal(read(*files).values, values)
    two = read(files[2], files[0], components=(2, 0))
    assert two.components == (2, 0)
    assert np.array_equal(two.values, values[..., [2, 0]])
    with pytest.raises(ShapeError, match="two components of three; is a file missing"):
        read(*files[:2])
    with pytest.raises(ShapeError, match=r"got the components \[0, 1\] for 3 volumes"):
        read(*files, components=(0, 1))
    with pytest.raises(StoreError, match="no such file"):
        read(*files[:2], tmp_path / "u_w.nii.gz")


def test_three_dimensions_and_vectors_of_four(tmp_path, values):
    one = read(save(tmp_path / "a.nii", values[..., 0, 1]))
    assert one.values.shape == (*SHAPE, 1, 1)
    assert one.times is None
    four = read(save(tmp_path / "b.nii", values[..., 0, :], vector=True))
    assert np.array_equal(four.values[..., 0, :], values[..., 0, :])
    assert "the fourth is taken for the components" in four.notes[0]


def test_complex_values_and_amplitude_with_phase(tmp_path, values):
    phasor = (values[..., :1, :] * np.exp(1j)).astype(np.complex64)
    data = read(save(tmp_path / "c.nii.gz", phasor), frequency=50.0)
    assert data.values.dtype.kind == "c"
    assert np.array_equal(data.values, phasor)
    amplitude = save(tmp_path / "m.nii", np.abs(phasor).astype(np.float32))
    phase = save(tmp_path / "p.nii", np.angle(phasor).astype(np.float32))
    data = read(amplitude, phase=(phase,))
    assert np.allclose(data.values, phasor, atol=1e-5)
    with pytest.raises(ShapeError, match="phases reach 4096, expected radians"):
        read(amplitude, phase=(save(tmp_path / "q.nii", np.full(phasor.shape, 4096.0, np.float32)),))
    with pytest.raises(ShapeError, match="amplitudes are negative"):
        read(save(tmp_path / "n.nii", np.real(phasor).astype(np.float32)), phase=(phase,))
    with pytest.raises(ShapeError, match="2 files, expected 1"):
        read(amplitude, phase=(phase, phase))
    with pytest.raises(ShapeError, match="complex already"):
        read(tmp_path / "c.nii.gz", phase=(phase,))


def test_integers_with_a_slope(tmp_path):
    counts = np.arange(24, dtype=np.int16).reshape(SHAPE)
    image = nib.Nifti1Image(counts, AFFINE)
    image.header.set_xyzt_units("mm", "sec")
    image.header.set_slope_inter(0.25, -3.0)
    nib.save(image, tmp_path / "i.nii")
    assert np.allclose(read(tmp_path / "i.nii").values[..., 0, 0], 0.25 * counts - 3.0)
    plain = nib.Nifti1Image(counts, AFFINE)
    plain.header.set_xyzt_units("mm", "sec")
    nib.save(plain, tmp_path / "j.nii")
    assert np.allclose(read(tmp_path / "j.nii").values[..., 0, 0], counts)


@pytest.mark.parametrize(("unit", "scale"), [("meter", 100.0), ("mm", 0.1), ("micron", 1e-4)])
def test_the_header_says_the_unit_of_lengths(tmp_path, values, unit, scale):
    data = read(save(tmp_path / "a.nii", values, units=(unit, "sec"), step=2.0, start=0.0))
    assert np.allclose(data.affine[:3], scale * AFFINE[:3])
    assert np.allclose(data.times, 2.0 * np.arange(5))


def test_a_header_that_does_not_say_units(tmp_path, values):
    data = read(save(tmp_path / "a.nii", values, units=("unknown", "unknown")))
    assert np.allclose(data.affine[:3], 0.1 * AFFINE[:3])
    assert "does not say the unit of its affine; taken as mm" in data.notes[0]
    assert data.times is None
    assert data.unit is None


def test_sform_and_qform(tmp_path, values):
    image = nib.Nifti1Image(values, AFFINE)
    image.header.set_xyzt_units("mm", "sec")
    other = AFFINE.copy()
    other[0, 3] += 7.0
    image.set_sform(AFFINE, code=1)
    image.set_qform(other, code=1)
    nib.save(image, tmp_path / "a.nii")
    data = read(tmp_path / "a.nii")
    assert np.allclose(data.affine[:3], 0.1 * AFFINE[:3])
    assert "sform and qform put voxels up to 0.7 voxels along i (7 mm) apart; the sform is taken" in data.notes[0]
    image.set_sform(None, code=0)
    nib.save(image, tmp_path / "a.nii")
    assert np.allclose(read(tmp_path / "a.nii").affine[:3], 0.1 * other[:3])
    image.set_qform(None, code=0)
    nib.save(image, tmp_path / "a.nii")
    with pytest.raises(ShapeError, match="neither sform nor qform"):
        read(tmp_path / "a.nii")


def test_a_mask(tmp_path, values):
    path = save(tmp_path / "u.nii", values)
    inside = np.zeros(SHAPE, np.uint8)
    inside[1:, :, 0] = 1
    mask = save(tmp_path / "mask.nii.gz", inside)
    data = read(path, mask=mask)
    assert np.array_equal(~np.isnan(data.values[..., 0, 0]), inside > 0)
    assert np.array_equal(data.values[inside > 0], values[inside > 0])
    with pytest.raises(ShapeError, match="4 × 3 × 1 voxels, expected 4 × 3 × 2"):
        read(path, mask=save(tmp_path / "b.nii", inside[..., :1]))
    shifted = AFFINE.copy()
    shifted[2, 3] += 1.0
    with pytest.raises(ShapeError, match=r"up to 0\.2 voxels along k \(1 mm\) away"):
        read(path, mask=save(tmp_path / "c.nii", inside, shifted))
    with pytest.raises(ShapeError, match="the mask is zero everywhere"):
        read(path, mask=save(tmp_path / "d.nii", 0 * inside))
    with pytest.raises(ShapeError, match="expected one volume"):
        read(path, mask=save(tmp_path / "e.nii", np.stack([inside, inside], axis=3)))


def test_files_that_do_not_fit_together(tmp_path, values):
    first = save(tmp_path / "x.nii", values[..., 0])
    turned = AFFINE.copy()
    turned[1, 3] += 10.0
    for other, words in (
        (save(tmp_path / "a.nii", values[..., 1], turned), r"up to 0\.5 voxels along j \(10 mm\) away"),
        (save(tmp_path / "b.nii", values[:3, ..., 1]), "3 × 3 × 2 voxels, expected 4 × 3 × 2"),
        (save(tmp_path / "c.nii", values[..., :4, 1]), "4 volumes, expected 5"),
        (save(tmp_path / "d.nii", values[..., 1], step=0.7), "other times"),
        (save(tmp_path / "e.nii", values[..., 1], text="u [mm]"), "in mm, those of x.nii in no unit"),
        (save(tmp_path / "f.nii", values), "several components"),
    ):
        with pytest.raises(ShapeError, match=words):
            read(first, other, components=(0, 1))


@pytest.mark.parametrize("kept", [40, 200, 0.3, 0.5, 0.99])
def test_a_truncated_gzip(tmp_path, values, kept):
    whole = save(tmp_path / "u.nii.gz", values).read_bytes()
    (tmp_path / "cut.nii.gz").write_bytes(whole[: int(kept * len(whole)) if kept < 1 else kept])
    with pytest.raises(StoreError, match="cut short"):
        read(tmp_path / "cut.nii.gz")


def test_files_that_are_something_else(tmp_path, values):
    (tmp_path / "a.nii").write_text("no image")
    with pytest.raises(StoreError, match="is no NIfTI image"):
        read(tmp_path / "a.nii")
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress(b"no image at all" * 100))
    with pytest.raises(StoreError, match="is no NIfTI image"):
        read(tmp_path / "b.nii.gz")
    for array, words in (
        (values[..., 0, 0, 0], "2 dimensions, expected an image of three"),
        (np.zeros((2, 2, 2, 1, 4), np.float32), "4 components, expected at most 3"),
        (np.zeros((2, 2, 2, 1, 1, 2), np.float32), "6 dimensions"),
        (np.full(SHAPE, np.nan, np.float32), "holds no value"),
        (np.full(SHAPE, np.inf, np.float32), "values are infinite"),
    ):
        with pytest.raises(DacoreError, match=words):
            read(save(tmp_path / "c.nii", array))
    colours = np.zeros(SHAPE, dtype=[("R", "u1"), ("G", "u1"), ("B", "u1")])
    nib.save(nib.Nifti1Image(colours, AFFINE), tmp_path / "d.nii")
    with pytest.raises(ShapeError, match="expected real or complex numbers"):
        read(tmp_path / "d.nii")


@pytest.mark.parametrize(("steps", "parts"), [(1, 1), (3, 1), (1, 3), (3, 3)])
def test_what_is_written_is_read_again(tmp_path, values, steps, parts):
    image = read(save(tmp_path / "u.nii", values))
    some = values[..., :steps, :parts].astype(float)
    some[0, 0, 0] = np.nan
    times = np.array([0.5, 1.0, 1.5])[:steps]
    path = Nifti().write_image(tmp_path / "out", some, image, "u", "cm", times)
    again = read(path)
    assert np.allclose(again.affine, image.affine)
    assert np.allclose(again.values, some, equal_nan=True, rtol=1e-6)
    assert again.unit == "cm"
    if steps > 1:
        assert np.allclose(again.times, times)
    assert path.read_bytes() == Nifti().write_image(tmp_path / "out", some, image, "u", "cm", times).read_bytes()
    assert read_grid(path)[1] == SHAPE


PARTS = np.random.default_rng(1).standard_normal((*SHAPE, 5, 3)).astype(np.float32)
IN_CM = np.vstack([0.1 * AFFINE[:3], AFFINE[3:]])
HELD = ImageData("any", PARTS, IN_CM, "um", (0, 1, 2), times=1e-3 * (1.0 + 0.5 * np.arange(5)))


def whole(folder):
    return save(folder / "u.nii.gz", PARTS, text="displacement [um]")


def in_parts(folder):
    return [save(folder / f"u_{axis}.nii", PARTS[..., k], text="displacement [um]") for k, axis in enumerate("xyz")]


test_one_file = format_suite(Nifti(), whole, HELD).as_test()
test_a_file_for_each_component = format_suite(Nifti(), in_parts, HELD).as_test()
