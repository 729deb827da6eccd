"""Data whose numbers are right and whose meaning is not: units, frames, phases and noise that nothing else notices."""

import nibabel as nib
import numpy as np
import pytest

import dacore
from dacore.core.data import SensorData
from dacore.errors import SceneError, ShapeError
from tests.own_data import SMALL, SMALLER, TOY, save, turned_by

GAUGE = "observation.gauge={kind='points', field='p', positions=[[3.0, 1.0, 5.0], [-3.0, 1.0, 6.0]]}"


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def parts(scene, states):
    """Displacements [um] and pressures [dyn/cm²] of a scene that measures both."""
    data, f, times = scene.functionals(states), scene.functionals, scene.model.times
    u = np.array([label.startswith("u") for label in f.labels])

    def some(name, rows, unit, scale):
        labels = tuple(np.array(f.labels)[rows])
        return SensorData(name, scale * data[rows], unit, labels=labels, times=times)

    return some("u", u, "um", 1e4), some("p", ~u, "dyn/cm^2", 1.0), u, data


def test_noise_of_several_units(cache):
    """5% of pressures of 10⁴ dyn/cm² were 500 cm for displacements, and 0.2 was 0.2 cm and 0.2 dyn/cm²."""
    scene = dacore.open_scene(TOY, [*SMALL, GAUGE], cache=cache)
    displacement, pressure, u, data = parts(scene, scene.truth[0].states)
    result = scene.reconstruct([displacement, pressure], noise="5%")
    assert result.sigma[u] == pytest.approx(0.05 * np.abs(data[u]).max())
    assert result.sigma[~u] == pytest.approx(0.05 * np.abs(data[~u]).max())
    assert "of the largest value of each unit" in result.notes[0]
    with pytest.raises(SceneError, match=r"0\.2: a number without a unit, and the data are in several"):
        scene.reconstruct([displacement, pressure], noise=0.2)
    assert not scene.reconstruct([displacement, pressure], noise=0).sigma.any()
    # What is not measured needs no noise in its unit.
    assert scene.reconstruct(displacement, noise="2 um").sigma[u] == pytest.approx(2e-4)
    assert scene.reconstruct(displacement, noise=2.0).sigma[u] == pytest.approx(2e-4)


def test_a_number_of_no_unit_where_files_have_two(cache):
    scene = dacore.open_scene(TOY, SMALL, cache=cache)
    data, f = scene.functionals(scene.truth[0].states), scene.functionals
    half = len(data) // 2
    times = scene.model.times
    one = SensorData("one", 10 * data[:half], "mm", labels=f.labels[:half], times=times)
    two = SensorData("two", 1e4 * data[half:], "um", labels=f.labels[half:], times=times)
    with pytest.raises(SceneError, match=r"as '0\.02 cm'"):
        scene.reconstruct([one, two], noise=0.02)
    assert scene.reconstruct([one, two], noise="20 um").sigma == pytest.approx(2e-3)


def oblique(scene_of, tmp_path):
    """A scene that measures an oblique image, the measured vectors (x, y, z, t, c) [um], and the affine [mm]."""
    affine = np.diag([10.0, 10.0, 10.0, 1.0])
    affine[:3, 3] = [-45.0, -40.0, 35.0]
    tilt = np.eye(4)
    tilt[1:3, 1:3] = turned_by(0.35)[:2, :2]
    affine = turned_by(0.35) @ tilt @ affine
    shape = (9, 9, 4)
    grid = save(tmp_path / "grid.nii", np.zeros(shape, np.uint8), affine)
    scene = scene_of(f"observation.slice={{ kind = 'image', file = '{grid}' }}")
    f, data = scene.functionals, scene.functionals(scene.truth[0].states)
    whole = SMALLER @ affine
    numbers = np.round(np.linalg.solve(whole[:3, :3], (f.centres - whole[:3, 3]).T).T).astype(int)
    values = np.full((*shape, data.shape[1], 3), np.nan)
    values[(*numbers.T, slice(None), f.directions.argmax(axis=1))] = 1e4 * data
    return scene, values, affine


def test_vectors_along_an_oblique_images_own_axes_are_noticed(cache, tmp_path):
    scene, values, affine = oblique(lambda change: dacore.open_scene(TOY, [*SMALL, change], cache=cache), tmp_path)
    noise = 0.01 * np.nanmax(np.abs(values)) * np.random.default_rng(0).standard_normal(values.shape)
    world = save(tmp_path / "world.nii", (values + noise).astype(np.float32), affine)
    own = save(
        tmp_path / "own.nii", ((values + noise) @ (affine[:3, :3] / 10.0)).astype(np.float32), affine
    )  # components of v along unit vectors a_k: v · a_k
    assert scene.reconstruct(world, noise="1%").warnings == ()
    assert scene.reconstruct(own, noise="1%", frame="voxel").warnings == ()
    assert "along the image's own axes (--frame voxel)" in scene.reconstruct(own, noise="1%").warnings[0]
    assert "along the world's axes" in scene.reconstruct(world, noise="1%", frame="voxel").warnings[0]


def test_phases_of_the_other_sign_are_noticed(tmp_path):
    """A scanner that writes e^{−iωt}: waves that are damped run away from where they are made, not towards it."""
    changes = ("training.samples=12", "validation.cases=2")
    scene = dacore.open_scene(TOY.with_name("harmonic.toml"), changes, cache=tmp_path / "cache")
    data, f = scene.functionals(scene.truth[0].states), scene.functionals
    phasor = (data[:, :1] - 1j * data[:, 1:]) * (1 + 0j)
    rng = np.random.default_rng(0)
    phasor = phasor + 0.02 * np.abs(phasor).max() * (rng.standard_normal((len(data), 1, 2)) @ [1, 1j])
    shared = {"places": f.centres, "directions": f.directions, "frequency": 50.0}
    right = scene.reconstruct(SensorData("mine", phasor, "cm", **shared), noise="2%")
    assert right.warnings == ()
    wrong = scene.reconstruct(SensorData("mine", phasor.conj(), "cm", **shared), noise="2%")
    assert "phases of the other sign (complex conjugate)" in wrong.warnings[0]


def test_steps_of_one_phasor_have_one_noise(cache):
    """Many steps are made of two numbers a place: said, with how much too small deviations may be."""
    scene = dacore.open_scene(TOY, SMALL, cache=cache)
    f, data = scene.functionals, scene.functionals(scene.truth[0].states)
    times = scene.model.times  # 2, 4, 6, 8 ms: a period of 8 ms has D'D = 2 I
    values = SensorData("mine", data[:, 1:2] + 0j, "cm", places=f.centres, directions=f.directions, frequency=125.0)
    np.testing.assert_allclose(times, [2e-3, 4e-3, 6e-3, 8e-3])
    result = scene.reconstruct(values, noise="5%")
    assert any(
        "4 steps are made of one phasor" in line and "up to 1.4 times too small" in line for line in result.warnings
    )
    quarter = dacore.open_scene(TOY, [*SMALL, "observed.steps=[1, 2]"], cache=cache)
    assert not any("made of one phasor" in line for line in quarter.reconstruct(values, noise="5%").warnings)


def test_one_component_in_an_array_is_not_taken_for_x(cache, tmp_path):
    """As with NIfTI: one volume of a vector field may be any component."""
    scene = dacore.open_scene(TOY, SMALL, cache=cache)
    f = scene.functionals
    low = f.centres.min(axis=0)
    affine = np.eye(4)
    affine[:3, 3] = low
    shape = tuple(np.round(f.centres.max(axis=0) - low).astype(int) + 1)
    times = scene.model.times
    np.savez(tmp_path / "one.npz", values=np.ones((*shape, 4, 1)), affine=affine, unit="um", times=times)
    with pytest.raises(ShapeError, match="one volume, but u has 3 components"):
        scene.reconstruct(tmp_path / "one.npz", noise="1%")
    np.savez(tmp_path / "two.npz", values=np.ones((*shape, 4, 2)), affine=affine, unit="um", times=times)
    with pytest.raises(ShapeError, match="2 components of 3; say which in an array 'components'"):
        scene.reconstruct(tmp_path / "two.npz", noise="1%")


def test_a_displacement_image_of_four_dimensions(tmp_path):
    """Its intent says that the fourth are components, be it "vector" or "displacement vector"."""
    pytest.importorskip("dacore_imaging")
    from dacore.core.data import Asked
    from dacore_imaging.nifti import Nifti

    image = nib.Nifti1Image(np.arange(24.0).reshape(2, 2, 2, 3), np.eye(4))
    image.header.set_intent("displacement vector")
    nib.save(image, tmp_path / "u.nii")
    data = Nifti().read([tmp_path / "u.nii"], Asked(unit="mm"))
    assert data.values.shape == (2, 2, 2, 1, 3)
    assert data.components == (0, 1, 2)


def test_data_with_a_mean_where_the_scene_takes_it_away(cache):
    """Half a static displacement passes every other check where the training set's motion is as large."""
    scene = dacore.open_scene(TOY, [*SMALL, "observed.less_mean=['u']"], cache=cache)
    f, rng = scene.functionals, np.random.default_rng(0)
    data = f(scene.truth[0].states)
    assert np.abs(data.mean(axis=1)).max() < 1e-9 * np.abs(data).max()
    sigma = 0.1 * np.abs(data).max()
    noisy = data + sigma * rng.standard_normal(data.shape)

    def said(values):
        given = SensorData("mine", values, "cm", labels=f.labels, times=scene.model.times)
        return [line for line in scene.reconstruct(given, noise=f"{sigma} cm").warnings if "less_mean" in line]

    assert not said(noisy)
    (line,) = said(noisy + 0.5 * noisy.std(axis=1)[:, None])
    assert "u has a mean over the steps, 0.49 times as large" in line  # the noise has a mean, too


def test_what_stands_beside_a_label_counts(cache):
    """A direction turned round beside a label was ignored: the value kept its sign."""
    scene = dacore.open_scene(TOY, SMALL, cache=cache)
    f, data = scene.functionals, scene.functionals(scene.truth[0].states)
    shared = {"labels": f.labels, "times": scene.model.times}
    back = SensorData("mine", -data, "cm", directions=-f.directions, places=f.centres, **shared)
    result = scene.reconstruct(back, noise="1%")
    np.testing.assert_allclose(result.used.values, data, rtol=1e-12)
    for changes, words in (
        ({"directions": np.roll(f.directions, 1, axis=1)}, "not measured along the direction that the scene measures"),
        ({"places": f.centres + 0.2}, "0.346 cm from where the scene has it"),
        ({"fields": ("p",) * len(data)}, "is of p, the scene's of u"),
    ):
        with pytest.raises(ShapeError, match=words):
            scene.reconstruct(SensorData("mine", data, "cm", **(shared | changes)), noise="1%")
    moved = SensorData("mine", data, "cm", places=f.centres + 0.2, **shared)
    assert scene.reconstruct(moved, noise="1%", tolerance=0.4).used.mask.all()
