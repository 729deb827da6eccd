"""Every way in which measured data may be wrong: a clear error or a stated warning, and nothing half-written."""

import re

import numpy as np
import pytest

import dacore
from dacore.core.data import SensorData
from dacore.errors import DacoreError, SceneError, ShapeError, StoreError
from dacore.workflow.reconstruct import output
from tests.own_data import SMALL, SMALLER, TOY, close, save, shift, turned_by, volume, write_csv


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


TOO_LARGE = "about 1,000 times larger than anything in training.*in um, say --unit um"
TOO_SMALL = "about 1,000 times smaller than anything in training.*in um, say --unit um"
# What is done to the values and the affine of a right image.
AWRY = {
    "shifted": (lambda v, a: (v, a + shift(0, 3, 5.0)), r"along i by [+-]0\.50 voxels \([+-]5 mm\)"),
    "shifted aslant": (
        lambda v, a: (v, a + shift(0, 3, 1.0) + shift(2, 3, -2.0)), r"i by -0\.10.*k by \+0\.20 voxels \(\+2 mm\)",
    ),
    "coarser": (lambda v, a: (v, a + shift(0, 0, 2.0)), "edges of 12 × 10 × 10 mm, the scene's have edges of 10 × 10"),
    "affine in cm": (lambda v, a: (v, SMALLER @ a), "is its affine in cm?"),
    "exchanged": (lambda v, a: (v.transpose(2, 1, 0, 3, 4), a), r"axes in the order \(k, [ij], [ij]\) .* 100%"),
    "turned": (lambda v, a: (v, turned_by(0.1) @ a), r"turned or stretched.*5\.7, 5\.7, 0\.0 degrees"),
    "far away": (lambda v, a: (v, a + shift(0, 3, 500.0)), "lies where the scene measures nothing"),
    "one volume of 4-D": (lambda v, a: (v[..., :1, :], a), "values of one time, and nobody says when; the scene"),
    "3-D, one component": (lambda v, a: (v[..., 0, 0], a), "one volume, but u has 3 components; give a file for each"),
    "all missing": (lambda v, a: (np.full_like(v, np.nan), a), "holds no value"),
    "infinite": (lambda v, a: (np.where(v > 0, np.inf, v), a), "values are infinite"),
}  # fmt: skip
SAID = {
    "no unit": ({"unit": None}, "nobody says the unit.*give --unit"),
    "another unit": ({"unit": "kPa"}, "unit 'kPa', expected one that converts to 'cm'"),
    "a thousand times": ({"unit": "mm"}, TOO_LARGE),
    "a thousandth": ({"unit": "nm"}, TOO_SMALL),
    "other times": ({"times": (0.0, 1.0, 2.0, 3.0)}, "none of its times is one that the scene"),
    "too few times": ({"times": (0.0, 1.0)}, "2 times for 4 volumes"),
    "another field": ({"field": "p"}, "is of the field 'p', but the scene measures u"),
}


@pytest.mark.parametrize("name", [*AWRY, *SAID])
def test_what_is_wrong_with_an_image(scene, truth, tmp_path, name):
    make, words = AWRY.get(name, (lambda *given: given, ""))
    options, words = SAID.get(name, ({}, words))
    values, affine = make(*volume(scene, truth[1]))
    path = save(tmp_path / "u.nii.gz", values.astype(np.float32), affine, text="")
    with pytest.raises(DacoreError, match=words) as caught:
        scene.reconstruct(path, **{"noise": "1%", "unit": "um"} | options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda v: v.transpose(1, 0, 2, 3, 4), r"the array's axes read as \(j, i, k\)"),
        (lambda v: v[::-1], r"the array's axes read as \(-i, j, k\)"),
        (lambda v: v[..., [1, 0, 2]], r"its components read as \(y, x, z\)"),
        (lambda v: np.roll(v, 1, axis=0), r"its voxels shifted by [+-]1 along i"),
    ],
)
def test_an_image_that_fits_the_grid_and_is_read_wrongly(scene, truth, tmp_path, make, words):
    values, affine = volume(scene, truth[1], pad=2)
    noise = 0.02 * np.abs(values).max() * np.random.default_rng(0).standard_normal(values.shape)
    right = scene.reconstruct(save(tmp_path / "a.nii", (values + noise).astype(np.float32), affine), noise="2%")
    assert right.warnings == ()
    wrong = scene.reconstruct(save(tmp_path / "b.nii", make(values + noise).astype(np.float32), affine), noise="2%")
    assert re.search(words, wrong.warnings[0])
    assert wrong.estimate.misfit.alarm[0]
    assert "contradict" in wrong.verdict


def test_zeros_for_gaps_and_an_affine_in_another_unit(scene, truth, tmp_path):
    """An image that the scene observes itself: nothing but the data and its place tells that something is wrong."""
    values, affine = volume(scene, truth[1])
    right = values.astype(np.float32)
    save(tmp_path / "u.nii.gz", right, affine)
    text = TOY.read_text(encoding="utf-8")
    begin, end = text.index("[observation."), text.index("[quantity.")
    own = text[:begin] + '[observation.scan]\nkind = "image"\nfile = "u.nii.gz"\n\n' + text[end:]
    (tmp_path / "scene.toml").write_text(own, encoding="utf-8")
    image = dacore.open_scene(tmp_path / "scene.toml", SMALL, cache=tmp_path / "cache")
    inside = image.functionals.count // 3
    assert image.reconstruct(tmp_path / "u.nii.gz", noise="1%").warnings == ()
    gaps = right.copy()
    gaps[: right.shape[0] // 2] = 0.0
    zeroed = image.reconstruct(save(tmp_path / "gaps.nii.gz", gaps, affine), noise="1%")
    found = next(each for each in zeroed.warnings if "hold one number alone" in each)
    voxels = np.round(image.functionals.centres - image.functionals.centres.min(axis=0)).astype(int)[:inside]
    assert f": {(voxels[:, 0] + 1 < right.shape[0] // 2).sum()} of {inside} voxels" in found
    gaps[: right.shape[0] // 2] = 3e-4  # what zero is read as of scaled integers
    filled = image.reconstruct(save(tmp_path / "gaps.nii.gz", gaps, affine), noise="1%")
    assert found in filled.warnings
    # An oblique grid has no spacing along the scene's axes that could be compared.
    save(tmp_path / "u.nii.gz", right, turned_by(0.1) @ affine)
    oblique = dacore.open_scene(tmp_path / "scene.toml", SMALL, cache=tmp_path / "cache")
    for scale, times in ((1e-3, "1000"), (1e3, "0.001")):
        scaled = np.diag([scale, scale, scale, 1.0]) @ turned_by(0.1) @ affine
        with pytest.raises(DacoreError, match=f"all lengths of its affine times {times}:"):
            oblique.reconstruct(save(tmp_path / "far.nii.gz", right, scaled), noise="1%")


def test_a_fit_that_chance_hardly_gives_is_not_called_agreement(scene, truth):
    """Between agreement and alarm: the verdict, the report's card and the interval's digits."""
    _, data = truth
    f, draw = scene.functionals, np.random.default_rng(5).standard_normal(data.shape)
    sigma = 0.05 * np.abs(data).max()
    said = {}
    for factor in (1.0, 1.085, 2.0):
        sensors = SensorData(
            "mine",
            data + factor * sigma * draw,
            "cm",
            places=f.centres,
            directions=f.directions,
            times=scene.model.times,
        )
        result = scene.reconstruct(sensors, noise=f"{sigma} cm")
        assert result.doubtful == (factor > 1.0)
        said[factor] = (float(result.estimate.misfit.probability[0]), result.verdict)
    assert said[1.0][0] > 0.01
    assert said[1.0][1].startswith("The data agree")
    assert 1e-4 < said[1.085][0] < 0.01
    assert said[1.085][1].startswith("The data fit worse than they should")
    assert said[2.0][0] < 1e-4
    assert said[2.0][1].startswith("The data contradict")


def test_what_is_wrong_with_sensors(scene, truth, tmp_path):
    _, data = truth
    f = scene.functionals
    shared = {"directions": f.directions, "times": scene.model.times}

    def said(**changes):
        given = {"name": "mine", "values": data, "unit": "cm", "places": f.centres} | shared | changes
        with pytest.raises(DacoreError) as caught:
            scene.reconstruct(SensorData(**given), noise=0)
        return str(caught.value)

    assert "none of 204 sensors" in said(places=10 * f.centres)
    assert "they fit if positions are in mm" in said(places=10 * f.centres)
    assert "columns in the order y, x, z" not in said(places=f.centres + 0.3)
    assert "may be u_x" in said(directions=None)
    first = np.r_[0 : len(data) - 1, 0]
    assert "are the same measurement" in said(places=f.centres[first], directions=f.directions[first])
    assert "positions of 2 coordinates, expected 3" in said(places=f.centres[:, :2], directions=f.directions[:, :2])
    assert "they fit if they are in ms: say so in the file ('time [ms]'" in said(times=1e3 * scene.model.times)
    assert "give --times if they are counted otherwise" in said(times=1.0 + scene.model.times)
    names = tuple(f"S{k}" for k in range(len(data)))
    assert "the scene's labels are such as 'u_x @" in said(places=None, labels=names)
    assert "nobody says the unit" in said(unit=None)
    moved = f.centres.copy()
    moved[:3] += 0.2
    some = scene.reconstruct(SensorData("mine", data, "cm", places=moved, **shared), noise="1%")
    assert "3 of 204 sensors are none of the scene's and are left out" in some.warnings[0]
    near = scene.reconstruct(SensorData("mine", data, "cm", places=moved, **shared), noise="1%", tolerance=0.4)
    assert near.used.mask.all()
    twice = [SensorData("one", data, "cm", places=f.centres, **shared)] * 2
    with pytest.raises(ShapeError, match="is measured in one, too; give it once"):
        scene.reconstruct(twice, noise=0)
    halves = [write_csv(tmp_path / f"{k}.csv", scene, data, range(k, len(data), 2)) for k in (0, 1)]
    close(scene.reconstruct(halves, noise=0), data, 1e-14)


def test_noise_that_nobody_states(scene, truth, cache):
    _, data = truth
    f = scene.functionals
    values = SensorData("mine", data, "cm", places=f.centres, directions=f.directions, times=scene.model.times)
    with pytest.raises(SceneError, match="nobody says how much the data have; give --noise"):
        scene.reconstruct(values)
    known = dacore.open_scene(TOY, [*SMALL, "noise.levels=[0.05]"], cache=cache)
    result = known.reconstruct(values)
    assert result.sigma[0] == pytest.approx(0.05 * np.abs(data).max())
    assert "taken as the scene's 0.05 of the largest value" in result.notes[0]
    for text, expected in (("2 um", 2e-4), ("0.02", 0.02), ("10%", 0.1 * np.abs(data).max()), (1e-3, 1e-3)):
        assert scene.reconstruct(values, noise=text).sigma[0] == pytest.approx(expected)
    for wrong in ("much", "-1 um", "3 kg", "1e999"):
        with pytest.raises(SceneError, match="--noise"):
            scene.reconstruct(values, noise=wrong)
    with pytest.raises(SceneError, match="--estimator: got 'magic', expected one of pbdw_one_space"):
        scene.reconstruct(values, noise=0, estimator="magic")


def test_nothing_is_half_written(scene, truth, tmp_path, monkeypatch):
    _, data = truth
    path = write_csv(tmp_path / "a.csv", scene, data)
    result = scene.reconstruct(path, noise=0)
    out = tmp_path / "runs" / "out"
    for name in ("write_fields", "write_report", "write_json", "draw_all"):
        with monkeypatch.context() as patch:
            patch.setattr(output, name, _interrupt)
            with pytest.raises(KeyboardInterrupt):
                result.write(out)
        assert list(out.parent.iterdir()) == []
    result.write(out)
    before = {each: each.read_bytes() for each in out.rglob("*") if each.is_file()}
    with monkeypatch.context() as patch:
        patch.setattr(output, "write_json", _interrupt)
        with pytest.raises(KeyboardInterrupt):
            result.write(out)
    assert {each: each.read_bytes() for each in out.rglob("*") if each.is_file()} == before
    assert list(out.parent.iterdir()) == [out]
    other = tmp_path / "thesis"
    other.mkdir()
    (other / "chapter.tex").write_text("years of work")
    with pytest.raises(StoreError, match="holds something else"):
        result.write(other)
    assert (other / "chapter.tex").read_text() == "years of work"


def _interrupt(*_, **__):
    raise KeyboardInterrupt
