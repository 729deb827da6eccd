"""Scenes: what is accepted, and one clear line for what is not."""

import pytest

from dacore.errors import SceneError
from dacore.io.scene import convert, read_scene

GOOD = """
title = "toy"
[domain]
kind = "ball"
[physics]
kind = "biot"
[parameters]
E = [1e5, 2e5]
nu = 0.4
[observation.slice]
kind = "voxels"
size = 1.0
[estimator.mv]
kind = "minimum_variance"
"""


def write(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_good_scene_has_defaults_and_plugin_tables_as_they_stand(tmp_path):
    scene = read_scene(write(tmp_path, GOOD))
    assert scene.training.samples == 64
    assert scene.observation["slice"].settings == {"size": 1.0}
    assert (scene.parameters["E"].low, scene.parameters["E"].high) == (1e5, 2e5)
    assert scene.parameters["nu"].low == scene.parameters["nu"].high == 0.4


def test_changes_are_toml_values_or_words(tmp_path):
    path = write(tmp_path, GOOD)
    scene = read_scene(
        path, ["training.samples=7", "time.start=steady", "noise.levels=[0.0, 0.05]", "observation.slice.size=0.5"]
    )
    assert scene.training.samples == 7
    assert scene.time.start == "steady"
    assert scene.noise.levels == [0.0, 0.05]
    assert scene.observation["slice"].settings["size"] == 0.5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("training.sample=3", r"training.sample: unknown key; did you mean 'samples'"),
        (
            "training.samples=1",
            r"training.samples: got 1, expected to be greater than or equal to 2|samples: got 1, expected",
        ),
        ("training.samples=2.5", r"training.samples: got 2.5"),
        ("training.samples=true", r"training.samples: got True"),
        ("time.step=-1.0", r"time.step: got -1.0, expected"),
        ("time.substeps=0", r"time.substeps: got 0, expected"),
        ("time.graded=31", r"time.graded: got 31, expected"),
        ("time.scheme='leapfrog'", r"time.scheme: got 'leapfrog', expected 'newmark' or 'generalized_alpha'"),
        ("time.rho_inf=0.5", r"time: rho_inf: of scheme = 'generalized_alpha', but the scheme is 'newmark'"),
        ("time.start='later'", r"time.start: got 'later', expected 'zero' or 'steady'"),
        ("noise.levels=[0.1, 0.1]", r"noise.levels: .*each level once"),
        ("noise.levels=[]", r"noise.levels"),
        ("parameters.E=[1e5]", r"E: got 1 values, expected \[low, high\]"),
        ("parameters.E={low=1e5}", r"parameters.E.high: missing"),
        ("tme.step=1e-3", r"tme: unknown key; did you mean 'time'"),
        ("validation.contrasts=[{field='p', mins='p_csf'}]", r"mins: unknown key; did you mean 'minus'"),
    ],
)
def test_a_bad_value_names_the_key_what_was_given_and_what_is_allowed(tmp_path, change, message):
    path = write(tmp_path, GOOD)
    with pytest.raises(SceneError, match=message) as caught:
        read_scene(path, [change])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("table", ["physics", "observation", "estimator"])
def test_a_missing_table_is_named(tmp_path, table):
    lines, keep = [], True
    for line in GOOD.splitlines():
        if line.startswith("["):
            keep = not line.startswith(f"[{table}")
        if keep:
            lines.append(line)
    with pytest.raises(SceneError, match=table):
        read_scene(write(tmp_path, "\n".join(lines)))


def test_files_that_are_no_scenes(tmp_path):
    with pytest.raises(SceneError, match="no such file"):
        read_scene(tmp_path / "nowhere.toml")
    with pytest.raises(SceneError, match="not valid TOML"):
        read_scene(write(tmp_path, "title = "))
    with pytest.raises(SceneError, match="cannot be read"):
        read_scene(tmp_path)
    with pytest.raises(SceneError, match="key=value"):
        read_scene(write(tmp_path, GOOD), ["training.samples"])
    with pytest.raises(SceneError, match="title is not a table"):
        read_scene(write(tmp_path, GOOD), ["title.deep=3"])


def test_units_are_converted_or_refused(tmp_path):
    pytest.importorskip("pint")
    scene = read_scene(write(tmp_path, GOOD), ["parameters.E={low=10, high=100, unit='kPa'}"])
    assert convert(scene.parameters["E"], "dyn/cm^2", "E") == pytest.approx((1e5, 1e6))
    wrong = read_scene(write(tmp_path, GOOD), ["parameters.E={low=10, high=100, unit='m'}"])
    with pytest.raises(SceneError, match=r"parameters.E: got the unit 'm', expected one that converts to 'dyn/cm\^2'"):
        convert(wrong.parameters["E"], "dyn/cm^2", "parameters.E")
    nonsense = read_scene(write(tmp_path, GOOD), ["parameters.E={low=10, high=100, unit='furlongs per jiffy'}"])
    with pytest.raises(SceneError, match="got the unit"):
        convert(nonsense.parameters["E"], "dyn/cm^2", "parameters.E")


@pytest.mark.parametrize("keys", [["beta=0.3"], ["gamma=0.5", "first_order=newmark"]])
def test_numbers_of_another_scheme_are_refused_by_name(tmp_path, keys):
    changes = ["time.scheme=generalized_alpha", *(f"time.{key}" for key in keys)]
    names = ", ".join(key.partition("=")[0] for key in keys)
    with pytest.raises(
        SceneError, match=f"time: {names}: of scheme = 'newmark', but the scheme is 'generalized_alpha'"
    ):
        read_scene(write(tmp_path, GOOD), changes)
