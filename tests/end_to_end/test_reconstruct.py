"""Measured data, written by others, back into the state they came from; and every way in which they may be wrong."""

import csv
import json
import re
from xml.etree import ElementTree

import h5py
import meshio
import nibabel as nib
import numpy as np
import pytest

import dacore
from dacore.core.data import SensorData
from dacore.errors import ShapeError
from tests.own_data import SMALL, SMALLER, TOY, close, error_of, save, turned_by, volume, write_csv


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def scene(cache):
    return dacore.open_scene(TOY, SMALL, cache=cache)


@pytest.fixture(scope="module")
def truth(scene):
    """States of a case that the training never saw, and what is measured of it [cm]."""
    states = scene.truth[0].states
    return states, scene.functionals(states)


def test_sensors_in_every_format_give_what_the_validation_gives(scene, truth, tmp_path):
    states, data = truth
    f = scene.functionals
    plain = scene.prepared("minimum_variance").estimate(data[:, :, None], 0.0).state(series=0)
    labels = list(f.labels)
    np.savez(tmp_path / "b.npz", values=1e4 * data, labels=labels, unit="um", times=scene.model.times)
    with h5py.File(tmp_path / "c.h5", "w") as file:
        file["values"], file["positions"], file["directions"] = 0.01 * data, f.centres, f.directions
        file["times"], file.attrs["unit"] = scene.model.times, "m"
    for path in (write_csv(tmp_path / "a.csv", scene, data), tmp_path / "b.npz", tmp_path / "c.h5"):
        result = scene.reconstruct(path, noise=0)
        close(result, data, 1e-14)
        assert np.allclose(result.states, plain, rtol=1e-9, atol=1e-12 * np.abs(plain).max())
        assert result.warnings == result.notes == ()
    values = SensorData("mine", data, "cm", places=f.centres, directions=f.directions, times=scene.model.times)
    close(scene.reconstruct(values, noise=0), data, 0.0)
    # Errors are those of the validation: the same estimator of the same exact data of case 1.
    outcome = scene.validation.outcome("minimum_variance", 0.0)
    mass = scene.model.space.field_product("u")
    block = scene.model.space.layout.block("u")
    gap = (result.states - states)[block]
    size = np.sqrt(np.einsum("it,it->", gap, mass @ gap) / np.einsum("it,it->", states[block], mass @ states[block]))
    assert size == pytest.approx(outcome.space_time["u"][0], rel=1e-3)


def test_a_direction_turned_round_changes_the_sign(scene, truth):
    _, data = truth
    f = scene.functionals
    values = SensorData("mine", -data, "cm", places=f.centres, directions=-f.directions, times=scene.model.times)
    close(scene.reconstruct(values, noise=0), data, 0.0)


@pytest.mark.parametrize("how", ["one", "components", "oriented", "scaled"])
def test_images_of_any_kind_give_the_values_back(scene, truth, tmp_path, how):
    _, data = truth
    values, affine = volume(scene, data)
    tolerance = 1e-6
    if how == "components":
        files = [save(tmp_path / f"u_{axis}.nii", values[..., k], affine) for k, axis in enumerate("xyz")]
    elif how == "oriented":
        # Stored right to left and with other axes first, as scanners do, with the affine that says so.
        turned = values[::-1].transpose(1, 0, 2, 3, 4)
        other = affine @ np.array([[0, -1, 0, len(values) - 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        files = [save(tmp_path / "u.nii.gz", turned, other)]
    elif how == "scaled":
        step = float(np.abs(values).max() / 30000)
        image = nib.Nifti1Image(np.round(values / step).astype(np.int16), affine)
        image.header.set_slope_inter(step, 0.0)
        image.header.set_xyzt_units("mm", "msec")
        image.header["pixdim"][4], image.header["toffset"] = 2.0, 2.0
        nib.save(image, tmp_path / "u.nii.gz")
        files, tolerance = [tmp_path / "u.nii.gz"], 1e-4
    else:
        files = [save(tmp_path / "u.nii.gz", values, affine)]
    result = scene.reconstruct(files, noise="1%", unit="um")
    close(result, data, tolerance)
    assert result.used.mask.all()
    assert result.warnings == ()


def test_vectors_along_the_images_own_axes(scene, truth, tmp_path):
    _, data = truth
    values, affine = volume(scene, data)
    turned = values[::-1, :, :, :, :] * np.array([-1, 1, 1], np.float32)
    other = affine @ np.array([[-1, 0, 0, len(values) - 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    path = save(tmp_path / "u.nii", turned, other)
    close(scene.reconstruct(path, noise=0, frame="voxel"), data, 1e-6)
    wrong = scene.reconstruct(path, noise="1%")
    assert "its components read as (-x, y, z)" in wrong.warnings[0]


def test_complex_data_are_taken_at_the_scenes_times(scene, truth, tmp_path):
    _, data = truth
    times = scene.model.times
    omega = 2 * np.pi * 40.0
    rng = np.random.default_rng(0)
    phasor = data[:, 1] * np.exp(1j * rng.uniform(0, 0.1, len(data)))
    expected = np.real(phasor[:, None] * np.exp(1j * omega * times))
    f = scene.functionals
    values = SensorData("mine", phasor[:, None], "cm", places=f.centres, directions=f.directions, frequency=40.0)
    close(scene.reconstruct(values, noise="1%"), expected, 1e-14)
    with pytest.raises(ShapeError, match="nobody says of which frequency; give --frequency in Hz"):
        scene.reconstruct(SensorData("mine", phasor[:, None], "cm", places=f.centres, directions=f.directions), noise=0)


def test_a_model_of_one_frequency_takes_amplitude_and_phase(tmp_path):
    """Its two recorded times hold Re v and −Im v; the frequency is known, and another one is refused."""
    changes = ("training.samples=12", "validation.cases=2")
    harmonic = dacore.open_scene(TOY.with_name("harmonic.toml"), changes, cache=tmp_path / "cache")
    data = harmonic.functionals(harmonic.truth[0].states)
    f, phasor = harmonic.functionals, (data[:, 0] - 1j * data[:, 1])[:, None]
    shared = {"places": f.centres, "directions": f.directions}
    result = harmonic.reconstruct(SensorData("mine", phasor, "cm", **shared), noise="1%")
    assert "taken as the scene's, 50 Hz" in result.notes[0]
    close(result, data, 1e-12)
    with pytest.raises(ShapeError, match="is of 60 Hz, but the scene's model is of 50 Hz"):
        harmonic.reconstruct(SensorData("mine", phasor, "cm", frequency=60.0, **shared), noise="1%")
    # As images of amplitude and phase, from files.
    low = f.centres.min(axis=0)
    index = np.round(f.centres - low).astype(int)
    values = np.zeros((*(index.max(axis=0) + 1), 1, 3), complex)
    values[(*index.T, 0, f.directions.argmax(axis=1))] = 1e4 * phasor[:, 0]
    affine = np.diag([10.0, 10, 10, 1])
    affine[:3, 3] = 10 * low
    amplitude = save(tmp_path / "amplitude.nii.gz", np.abs(values).astype(np.float32), affine)
    phase = save(tmp_path / "phase.nii.gz", np.angle(values).astype(np.float32), affine)
    close(harmonic.reconstruct(amplitude, phase=[phase], noise="1%"), data, 1e-5)
    both = save(tmp_path / "complex.nii.gz", values.astype(np.complex64), affine)
    close(harmonic.reconstruct(both, noise="1%", frequency=50.0), data, 1e-5)


def test_half_of_the_slice_is_missing(scene, truth, tmp_path):
    states, data = truth
    values, affine = volume(scene, data)
    half = values.copy()
    half[: len(half) // 2] = np.nan
    result = scene.reconstruct(save(tmp_path / "u.nii", half, affine), noise="1%")
    assert 0.4 < result.used.mask.mean() < 0.6
    assert re.search(r"\d+ of \d+ measurements of the scene have no value", result.warnings[0])
    assert error_of(scene, result.states, states, "u") < 0.2
    mask = (np.arange(len(half)) >= len(half) // 2)[:, None, None] * np.ones(values.shape[:3])
    save(tmp_path / "m.nii", mask.astype(np.uint8), affine)
    again = scene.reconstruct(save(tmp_path / "v.nii", values, affine), noise="1%", mask=tmp_path / "m.nii")
    assert np.array_equal(again.used.mask, result.used.mask)
    # The other half is not in the file at all.
    part = affine.copy()
    part[0, 3] += 10.0 * (len(half) // 2)
    cut = scene.reconstruct(save(tmp_path / "w.nii", values[len(half) // 2 :], part), noise="1%")
    assert np.array_equal(cut.used.mask, result.used.mask)
    assert "lie outside the image" in cut.warnings[0]


def test_gaps_in_time_and_place(scene, truth):
    _, data = truth
    f = scene.functionals
    gaps = data.copy()
    gaps[:, 2] = np.nan  # a step of which nothing is there
    gaps[5, 0] = np.nan  # and one value
    values = SensorData("mine", gaps, "cm", places=f.centres, directions=f.directions, times=scene.model.times)
    result = scene.reconstruct(values, noise="1%")
    assert result.used.steps.tolist() == [0, 1, 3]
    assert not result.used.mask[5]
    assert result.used.mask.sum() == len(data) - 1
    assert "3 of the 4 steps" in result.warnings[0]
    assert "2 of" in result.warnings[1]  # the other values of the sensor with a gap
    assert result.fit.shape == (len(data), 3)


def test_deviations_of_each_sensor_are_used(scene, truth):
    _, data = truth
    f = scene.functionals
    bad = np.arange(len(data)) % 2 == 0
    rng = np.random.default_rng(0)
    size = np.abs(data).max()
    noisy = data + np.where(bad, 0.5, 0.005)[:, None] * size * rng.standard_normal(data.shape)
    shared = {"places": f.centres, "directions": f.directions, "times": scene.model.times}
    sigma = np.broadcast_to(np.where(bad, 0.5, 0.005)[:, None] * size, data.shape)
    known = scene.reconstruct(SensorData("mine", noisy, "cm", sigma=sigma, **shared))
    alike = scene.reconstruct(SensorData("mine", noisy, "cm", **shared), noise="35%")
    errors = [error_of(scene, r.states, truth[0], "u") for r in (known, alike)]
    assert errors[0] < 0.5 * errors[1]
    assert 0.8 < known.ratio < 1.2
    assert not known.estimate.misfit.alarm[0]


def test_the_folder_of_results(scene, truth, tmp_path):
    states, data = truth
    values, affine = volume(scene, data)
    path = save(tmp_path / "u.nii.gz", values, affine)
    result = scene.reconstruct(path, noise="1%")
    out = tmp_path / "out"
    files = result.write(out)
    assert all(each.exists() for each in files)
    found = json.loads((out / "reconstruction.json").read_text())
    assert found["data"][0]["sha256"] == result.sources[0].sha256
    pressure = found["quantities"][0]
    true = scene.quantities["cavity_pressure"].functionals(scene.model.space)(states).mean()
    low, high = pressure["interval"]
    assert low < true < high
    with (out / "quantities.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[0]["value"]) == pressure["value"]
    with (out / "residuals.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == data.size
    assert all(float(r["residual"]) == pytest.approx(float(r["value"]) - float(r["fit"])) for r in rows)
    # Fields as ParaView reads them.
    mesh = meshio.read(out / "fields/state.vtu")
    assert {"estimate_u", "estimate_p", "deviation_u", "deviation_p"} == set(mesh.point_data)
    assert (mesh.point_data["deviation_p"] >= 0).all()
    assert len(ElementTree.parse(out / "fields/estimate.xdmf").findall(".//Time")) == 4
    # Images: what is measured of the estimate, on the grid of the data, in its world.
    image = nib.load(out / "images/u.nii.gz")
    assert image.shape == values.shape
    assert np.allclose(image.affine, affine)
    assert image.header.get_intent()[0] == "vector"
    f = scene.functionals
    index = np.round(f.centres - f.centres.min(axis=0) + [1, 1, 0]).astype(int)
    picked = np.asarray(image.dataobj)[(*index.T, slice(None), f.directions.argmax(axis=1))]
    # In the unit of the data, which were in um.
    assert np.abs(picked - 1e4 * result.fit).max() < 1e-6 * np.abs(1e4 * result.fit).max()
    assert b"[um]" in image.header["descrip"].item()
    assert b"[dyn/cm^2]" in nib.load(out / "images/p.nii.gz").header["descrip"].item()
    assert nib.load(out / "images/p_deviation.nii.gz").shape == values.shape[:4]
    assert np.isnan(np.asarray(image.dataobj)[0, 0]).all()
    text = (out / "report.html").read_text()
    assert "Does it fit?" in text
    assert result.sources[0].sha256 in text


def test_an_image_observation_takes_its_own_image(scene, truth, cache, tmp_path):
    """An oblique image placed in the scene: measured by its own voxels, and data on it reconstructed."""
    turn = turned_by(0.3)
    turn[:3, 3] = [0.4, -0.2, 0.1]
    inverse = np.linalg.inv(turn)
    inner = np.diag([12.0, 9.0, 15.0, 1.0])
    inner[:3, 3] = [-50.0, -45.0, 25.0]
    affine = np.diag([10.0, 10, 10, 1]) @ inverse @ SMALLER @ turned_by(0.2) @ inner
    shape = (9, 11, 4)
    grid = save(tmp_path / "grid.nii", np.zeros(shape, np.uint8), affine)
    rows = [[float(x) for x in row] for row in turn]
    changes = [*SMALL, f"observation.slice={{ kind = 'image', file = '{grid}', placement = {rows} }}"]
    other = dacore.open_scene(TOY, changes, cache=cache)
    f = other.functionals
    assert f.spacing == ()
    data = f(truth[0])
    values = np.full((*shape, 4, 3), np.nan, np.float32)
    whole = turn @ SMALLER @ affine
    numbers = np.round(np.linalg.solve(whole[:3, :3], (f.centres - whole[:3, 3]).T).T).astype(int)
    # Vectors of the image are along its world's axes, which are turned against the scene's.
    scene_vectors = np.zeros((*shape, 4, 3))
    for k in range(f.count):
        scene_vectors[tuple(numbers[k])][:, f.directions[k].argmax()] = data[k]
    there = np.zeros(shape, bool)
    there[tuple(numbers.T)] = True
    values[there] = 1e4 * (scene_vectors @ turn[:3, :3])[there]
    path = save(tmp_path / "u.nii.gz", values, affine)
    result = other.reconstruct(path, noise="1%")
    close(result, data, 1e-5)
    assert result.warnings == ()
    out = tmp_path / "out"
    result.write(out)
    image = np.asarray(nib.load(out / "images/u.nii.gz").dataobj) @ turn[:3, :3].T
    picked = 1e-4 * image[(*numbers.T, slice(None), f.directions.argmax(axis=1))]
    assert np.abs(picked - result.fit).max() < 1e-5 * np.abs(result.fit).max()
    # Other content of the file is another measurement: nothing stale comes from the cache.
    key = other.runner.pipeline.key("functionals")
    save(grid, np.zeros((9, 11, 3), np.uint8), affine)
    again = dacore.open_scene(TOY, changes, cache=cache)
    assert again.runner.pipeline.key("functionals") != key
