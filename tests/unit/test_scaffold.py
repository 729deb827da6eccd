"""`dacore new-plugin`: what it writes is sound for every kind; what cannot be written leaves nothing but one line."""

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest

from dacore import open_scene
from dacore.cli.main import main
from dacore.errors import PluginError, StoreError
from dacore.plugins.declarations import KINDS as ALL
from dacore.plugins.registry import load
from dacore.plugins.spec import HOOKS
from dacore.scaffold.kinds import DEFAULT, KINDS
from dacore.scaffold.write import new_plugin, word
from dacore.studies.outcomes import PRIOR
from dacore.workflow import build

ROOT = Path(__file__).resolve().parents[2]
TOGETHER = [(kind,) for kind in KINDS] + [DEFAULT, ("domain", "model"), ("backend", "quantity"), tuple(KINDS)]


def name_of(kinds):
    return f"dacore-t{'-'.join(kind[:2] for kind in kinds)}"


def test_there_is_a_template_for_every_kind_of_plugin():
    assert set(KINDS) == set(ALL)
    assert [KINDS[kind].hook for kind in ALL] == list(ALL.values())
    assert {one.hook for one in KINDS.values()} == set(HOOKS)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    place = tmp_path_factory.mktemp("written")
    return {kinds: new_plugin(name_of(kinds), kinds, place) for kinds in TOGETHER}


@pytest.fixture
def installed(folders, monkeypatch):
    """Makes one of the packages known, as an installation would."""

    def install(kinds):
        package = name_of(kinds).replace("-", "_")
        monkeypatch.syspath_prepend(str(folders[kinds] / "src"))
        points = [*entry_points(group="dacore"), EntryPoint(package, package, "dacore")]
        monkeypatch.setattr(build, "load", lambda: load(points))
        return folders[kinds]

    yield install
    for name in [name for name in sys.modules if name.startswith("dacore_t")]:
        del sys.modules[name]


@pytest.mark.parametrize("kinds", TOGETHER, ids="+".join)
def test_its_scene_runs_whatever_kinds_there_are(installed, kinds, tmp_path):
    folder = installed(kinds)
    scene = open_scene(folder / "scene.toml", ["training.samples=24", "validation.cases=3"], tmp_path)
    registry, stem = scene.builder.registry, name_of(kinds).removeprefix("dacore-").replace("-", "_")
    for kind in kinds:
        cls = registry.get(kind, word(stem, kind))
        assert cls.__module__.startswith("dacore_t")
    used = {table.kind for group in ("observation", "quantity", "estimator", "study")
            for table in getattr(scene.scene, group).values()}  # fmt: skip
    used |= {scene.scene.physics.kind, scene.scene.domain.kind, scene.scene.discretization.backend}
    used.add(scene.scene.solver.kind)
    assert {word(stem, kind) for kind in kinds if kind != "format"} <= used
    outcome, guess = (scene.validation.outcome(name, 0.0) for name in ("minimum_variance", PRIOR))
    field = "c" if "model" in kinds else "u"
    assert outcome.space_time[field].mean() < 0.5 * guess.space_time[field].mean()
    if "study" in kinds:
        assert scene.runner["study.samples"].arrays["errors"].shape[0] == 2


def test_all_of_it_is_formatted_and_passes_the_linter_with_its_own_settings(folders):
    for command in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "--no-cache", *(str(each) for each in folders.values())],
            capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr


def test_all_of_it_passes_mypy_strict(folders, tmp_path):
    folder = folders[tuple(KINDS)]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path), "src"], capture_output=True, text=True, cwd=folder
    )
    assert done.returncode == 0, done.stdout
    assert f"{len(KINDS) + 1} source files" in done.stdout


@pytest.mark.parametrize("kinds", [DEFAULT, tuple(KINDS)], ids=["default", "all"])
def test_it_holds_what_a_distribution_needs(folders, kinds):
    folder, package = folders[kinds], name_of(kinds).replace("-", "_")
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["name"] == name_of(kinds)
    assert project["project"]["entry-points"]["dacore"] == {package: package}
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {
        "pyproject.toml", "README.md", ".gitignore", "scene.toml", "tests/test_declared.py", "tests/test_scene.py",
        f"src/{package}/__init__.py", f"src/{package}/py.typed",
        *(f"src/{package}/{kind}.py" for kind in kinds), *(f"tests/test_{kind}.py" for kind in kinds),
    }  # fmt: skip
    everything = "\n".join(path.read_text(encoding="utf-8") for path in folder.rglob("*") if path.is_file())
    assert "TODO" not in everything
    assert "${" not in everything
    readme = (folder / "README.md").read_text(encoding="utf-8")
    for command in ("pip install -e '.[test]'", "pytest", "dacore run scene.toml"):
        assert command in readme


NAMES = {
    "": "expected the name of a distribution",
    "-x": "expected the name of a distribution",
    "a b": "expected the name of a distribution",
    "a/b": "expected the name of a distribution",
    "../a": "expected the name of a distribution",
    "größe": "expected the name of a distribution",
    "1st": "Python would have to make the name '1st'",
    "dacore-2d": "Python would have to make the name '2d'",
    "class": "is no keyword",
    "dacore-lambda": "Python would have to make the name 'lambda'",
    "json": "is a module of Python or dacore",
    "dacore": "is a module of Python or dacore",
    "numpy": "is installed already",
    "dacore-biot": "is installed already",
    "dacore_biot": "is installed already",
    "dacore.biot": "is installed already",
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_cannot_be_is_refused_in_one_line(name, tmp_path):
    with pytest.raises(PluginError, match=NAMES[name]) as told:
        new_plugin(name, out=tmp_path)
    assert "\n" not in str(told.value)
    assert str(told.value).startswith(f"NAME: got {name!r}")
    assert not list(tmp_path.iterdir())


def test_a_module_or_a_kind_that_is_there_already_is_refused(tmp_path, monkeypatch):
    (tmp_path / "path").mkdir()
    (tmp_path / "path/lonely_neighbour.py").touch()
    monkeypatch.syspath_prepend(tmp_path / "path")
    with pytest.raises(PluginError, match="a module lonely_neighbour is there already"):
        new_plugin("lonely-neighbour", out=tmp_path / "out")
    with pytest.raises(PluginError, match=r"the model 'biot' is declared by dacore-biot 0\.1\.0 already"):
        new_plugin("biot", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    # The word is free for another kind.
    assert new_plugin("biot", ("quantity",), tmp_path / "out").name == "biot"


@pytest.mark.parametrize(
    ("kinds", "says"),
    [
        (["modell"], "--kind: got modell, expected some of model, observation"),
        ([], "--kind: got none"),
        (["model", "model"], "--kind: got model, model, expected each kind once"),
    ],
)
def test_a_kind_that_is_none_is_refused(kinds, says, tmp_path):
    with pytest.raises(PluginError) as told:
        new_plugin("dacore-x", kinds, tmp_path)
    assert str(told.value).startswith(says)
    assert not list(tmp_path.iterdir())


def test_nothing_that_is_there_is_touched(tmp_path):
    (tmp_path / "dacore-x").mkdir()
    (tmp_path / "dacore-y").symlink_to(tmp_path / "nowhere")
    (tmp_path / "dacore-z").write_text("mine")
    for name in ("dacore-x", "dacore-y", "dacore-z"):
        with pytest.raises(StoreError, match="is there already; choose another NAME or --out, or move it away"):
            new_plugin(name, out=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dacore-x", "dacore-y", "dacore-z"]
    assert not list((tmp_path / "dacore-x").iterdir())


def test_it_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    written = []

    def fail(self, text, **options):
        written.append(self.name)
        if len(written) == 5:
            raise OSError(28, "No space left on device")
        return len(text)

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(StoreError, match=r"dacore-x: cannot be written \(No space left on device\)"):
        new_plugin("dacore-x", out=tmp_path)
    assert len(written) == 5
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="cannot be written"):
        new_plugin("dacore-x", out=tmp_path / "file" / "below")


def test_the_command_says_what_to_do_next(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["new-plugin", "dacore-x"])
    assert left.value.code in (0, None)
    said = capsys.readouterr().out
    assert "dacore-x: a plugin with model, observation. Next:" in said
    assert "pip install -e '.[test]'" in said
    assert "Other kinds" in said
    with pytest.raises(SystemExit) as left:
        main(["new-plugin", "dacore-x", "--kind", "solver,domain", "--kind", "study"])
    assert left.value.code == 1
    assert (
        capsys.readouterr().err == "error: dacore-x: is there already; choose another NAME or --out, or move it away\n"
    )
    with pytest.raises(SystemExit):
        main(["new-plugin", "dacore-y", "--kind", "solver,domain", "--kind", "study", "--out", "deep/down"])
    assert "with solver, domain, study" in capsys.readouterr().out
    assert (tmp_path / "deep/down/dacore-y/src/dacore_y/study.py").exists()
