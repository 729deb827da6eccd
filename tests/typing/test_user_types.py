"""Types as users meet them: their scripts and plugins pass mypy --strict, and py.typed is in every wheel."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import dacore

ROOT = Path(__file__).parents[2]
DATA = Path(__file__).parent / "data"
PROJECTS = [ROOT, *sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml"))]


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What mypy --strict says of the files, from a folder that has nothing of dacore: line by line, for each file."""
    pytest.importorskip("mypy")
    folder = tmp_path_factory.mktemp("mypy")
    names = sorted(path.name for path in DATA.glob("*.py"))
    for name in names:
        (folder / name).write_text((DATA / name).read_text(encoding="utf-8"), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--no-pretty",
        "--config-file=",
        f"--cache-dir={folder}/cache",
        *names,
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.stderr == ""
    found = {name: [] for name in names}
    for line in done.stdout.splitlines():
        match = re.match(r"(\w+\.py):(\d+): (\w+): (.*)", line)
        if match:
            name, number, kind, text = match.groups()
            found[name].append((int(number), kind, text))
    return found


@pytest.mark.parametrize("name", ["user_script.py", "user_plugin.py"])
def test_a_users_code_is_strictly_typed(name, said):
    text = (DATA / name).read_text(encoding="utf-8")
    assert "type: ignore" not in text
    assert [each for each in said[name] if each[1] == "error"] == []
    revealed = {number: each for number, kind, each in said[name] if each.startswith("Revealed")}
    wanted = {k: line.split("# R: ")[1] for k, line in enumerate(text.splitlines(), 1) if "# R: " in line}
    assert revealed.keys() == wanted.keys()
    for number, expected in wanted.items():
        assert 'Any"' not in revealed[number]
        # A class is named with its module: the last part is enough.
        assert expected in re.sub(r"(\w+\.)+(?=[A-Za-z])", "", revealed[number]), (number, revealed[number])


def test_mistakes_are_found(said):
    lines = (DATA / "user_mistakes.py").read_text(encoding="utf-8").splitlines()
    wanted = {k + 1: line.split("E: ")[1] for k, line in enumerate(lines, 1) if line.startswith("# E: ")}
    found = {number: text for number, kind, text in said["user_mistakes.py"] if kind == "error"}
    assert found.keys() == wanted.keys()
    for number, code in wanted.items():
        assert f"[{code}]" in found[number]


def test_what_dacore_offers_at_the_top_is_there():
    assert sorted(dacore.__all__) == dacore.__all__
    for name in dacore.__all__:
        assert getattr(dacore, name) is not None
        assert name in dir(dacore)
    assert {"open_scene", "Session", "DacoreError"} <= set(dacore.__all__)
    with pytest.raises(AttributeError, match="open_scnee"):
        _ = dacore.open_scnee


@pytest.mark.parametrize("project", PROJECTS, ids=lambda path: path.name)
def test_the_wheel_says_that_it_is_typed(project, tmp_path):
    from hatchling.builders.wheel import WheelBuilder

    settings = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = next(WheelBuilder(str(project)).build(directory=str(tmp_path), versions=["standard"]))
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    for package in settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert f"{Path(package).name}/py.typed" in names
    assert not [name for name in names if name.startswith(("tests/", "runs/", "docs/"))]
