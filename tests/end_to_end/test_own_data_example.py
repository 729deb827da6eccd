"""examples/own-data does what it says, from files as they are in the repository."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dacore

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "own-data"


def script(folder, *arguments):
    command = [sys.executable, str(FOLDER / "make_data.py"), *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows(text):
    return list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("own-data")


def test_the_file_of_sensors_is_what_the_script_makes(folder):
    made, kept = rows(script(folder, "--sensors")), rows((FOLDER / "sensors.csv").read_text())
    assert [row[:5] for row in made] == [row[:5] for row in kept]
    values = [np.array([row[5:] for row in table[1:]], dtype=float) for table in (made, kept)]
    assert np.abs(values[0] - values[1]).max() <= 2e-3


@pytest.mark.parametrize("kind", ["sensors", "scan"])
def test_the_pressure_of_the_truth_is_found(folder, kind):
    cache = folder / "runs" / "own-data" / "cache"
    if kind == "sensors":
        scene = dacore.open_scene(FOLDER / "sensors.toml", cache=cache)
        result = scene.reconstruct(FOLDER / "sensors.csv")
    else:
        said = script(folder, folder / "runs" / "own-data")
        assert "216 voxels, 8 times" in said
        files = {name: folder / "runs" / "own-data" / f"{name}.nii.gz" for name in ("scan", "mask")}
        scene = dacore.open_scene(folder / "runs" / "own-data" / "scan.toml", cache=cache)
        result = scene.reconstruct(files["scan"], mask=files["mask"], noise="5%")
        assert "6 of 648 measurements" in result.warnings[0]
    true = scene.quantities["cavity_pressure"].functionals(scene.model.space)(scene.truth[0].states).mean()
    (number,) = result.numbers
    assert abs(number.value - true) < 3 * number.deviation
    assert number.deviation < 150
    assert not result.estimate.misfit.alarm[0]
    out = folder / kind
    result.write(out)
    assert json.loads((out / "reconstruction.json").read_text())["misfit"]["alarm"] is False
