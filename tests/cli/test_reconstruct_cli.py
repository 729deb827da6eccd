"""``dacore reconstruct`` as a user meets it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dacore as package
from dacore.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
TOY = ROOT / "examples" / "toy" / "ball.toml"
SMALL = ("training.samples=8", "time.steps=2", "time.step=2e-3", "noise.levels=[0.0]", "validation.cases=2")


def dacore(*arguments):
    environment = {**os.environ, "COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", "from dacore.cli.main import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, check=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two files of sensors of an unseen case, and the cache of a trained scene."""
    folder = tmp_path_factory.mktemp("data")
    scene = package.open_scene(TOY, SMALL, cache=folder / "cache")
    f, data = scene.functionals, scene.functionals(scene.truth[0].states)
    for name, rows in (("a", slice(0, None, 2)), ("b", slice(1, None, 2))):
        np.savez(
            folder / f"{name}.npz", values=1e4 * data[rows], labels=np.array(f.labels)[rows], times=scene.model.times
        )
    _ = scene.background
    return folder


def reconstruct(folder, *arguments, out="out"):
    settings = [part for change in SMALL for part in ("--set", change)]
    return dacore(
        "reconstruct", TOY, *arguments, *settings, "--cache", folder / "cache", "--out", folder / out, "--workers", "1"
    )  # fmt: skip


def test_files_in_a_folder_of_results_out(folder):
    done = reconstruct(folder, "--data", folder / "a.npz", folder / "b.npz", "--unit", "um", "--noise", "0.5 um")
    assert done.returncode == 0, done.stderr
    assert "kept  background" in done.stdout
    assert "cavity pressure" in done.stdout
    assert "The data agree with the model" in done.stdout
    found = json.loads((folder / "out" / "reconstruction.json").read_text())
    assert found["command"].startswith("dacore ")
    assert [Path(each["file"]).name for each in found["data"]] == ["a.npz", "b.npz"]
    assert found["noise"]["largest"] == pytest.approx(0.5e-4)
    names = {str(each.relative_to(folder / "out")) for each in (folder / "out").rglob("*") if each.is_file()}
    assert {"report.html", "quantities.csv", "residuals.csv", "fields/estimate.xdmf", "fields/state.vtu"} <= names
    for name in ("report.html", "quantities.csv", "reconstruction.json"):
        assert str(folder / "out" / name) in done.stdout
    # Half of the data is a warning, and the earlier results are replaced.
    again = reconstruct(folder, "--data", folder / "a.npz", "--unit", "um", "--noise", "1%")
    assert again.returncode == 0, again.stderr
    assert "102 of 204 measurements of the scene have no value (50%)" in again.stdout
    assert json.loads((folder / "out" / "reconstruction.json").read_text())["measurements"]["used"] == 102
    assert not [each for each in folder.iterdir() if each.name.startswith(".")]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, ["--data", "missing"]),
        (["--data", "none.csv"], 1, ["none.csv", "no such file"]),
        (["--data", "a.npz"], 1, ["nobody says the unit", "--unit"]),
        (["--data", "a.npz", "--unit", "um"], 2, ["nobody says how much", "--noise"]),
        (["--data", "a.npz", "--unit", "mm", "--noise", "0"], 1, ["1,000 times larger", "--unit um"]),
        (["--data", "a.npz", "--unit", "kg", "--noise", "0"], 2, ["kg", "cm"]),
        (["--data", "a.npz", "a.npz", "--unit", "um", "--noise", "0"], 1, ["given twice"]),
        (["--data", "a.npz", "--unit", "um", "--noise", "loud"], 2, ["--noise loud"]),
        (["--data", "a.npz", "--times", "soon", "--noise", "0"], 2, ["--times", "soon"]),
        (["--data", "a.npz", "--components", "u,v"], 2, ["--components", "'u'"]),
        (["--data", "a.npz", "--frame", "scanner"], 2, ["--frame", "scanner"]),
        (["--data", "a.npz", "--mask", "a.npz"], 1, ["--mask and --phase", "NIfTI"]),
        (["--data", "a.npz", "--unit", "um", "--noise", "0", "--estimator", "magic"], 2, ["--estimator", "'magic'"]),
        (["--data", "scan.dcm"], 1, ["no format reads a file of this name", "nifti (.nii, .nii.gz)"]),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(folder, capsys, arguments, code, words):
    (folder / "scan.dcm").touch()
    files = [folder / each if each.endswith((".npz", ".csv", ".dcm")) else each for each in arguments]
    settings = [part for change in SMALL for part in ("--set", change)]
    with pytest.raises(SystemExit) as stop:
        main(
            ["reconstruct", str(TOY), *map(str, files), *settings, "--cache", str(folder / "cache"), "--out",
             str(folder / "never"), "--workers", "1"]
        )  # fmt: skip
    said = capsys.readouterr().err
    assert stop.value.code == code, said
    assert len(said.strip().splitlines()) == 1, said
    assert said.startswith("error: ")
    for word in words:
        assert word in said
    assert not (folder / "never").exists()
    assert not [each for each in folder.iterdir() if each.name.startswith(".")]


def test_a_folder_of_something_else_is_refused_before_any_work(folder, tmp_path):
    (tmp_path / "thesis.tex").write_text("years")
    done = dacore("reconstruct", TOY, "--data", folder / "a.npz", "--out", tmp_path, "--cache", tmp_path / "cache")
    assert done.returncode == 1
    assert "holds something else" in done.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["thesis.tex"]
