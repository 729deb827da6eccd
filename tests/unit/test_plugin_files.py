"""Plugin files that a scene names: they count for this scene alone, and what is wrong with them is one line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dacore import open_scene
from dacore.cli.main import main
from dacore.errors import SceneError
from dacore.io.scene import read_scene
from dacore.plugins.files import import_file
from dacore.plugins.registry import load
from dacore.workflow.build import Builder
from tests.workers import cluster

ROOT = Path(__file__).resolve().parents[2]
EPIDEMIC = ROOT / "examples/epidemic"
SMALL = ["training.samples=24", "validation.cases=4", "physics.towns=9", "physics.weeks=6",
         "observation.doctors.towns=[0,3,7]", "quantity.infected.town=5", "quantity.immune.town=5",
         "estimator.pbdw.n=2"]  # fmt: skip

QUANTITY = """
from dataclasses import dataclass
import numpy as np
from scipy.sparse import csr_array
from dacore.core.observation import Functionals
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.plugins import PluginSpec, hookimpl

FACTOR = {factor}

def scaled(values):
    return [FACTOR * value for value in values]

@dataclass(frozen=True)
class Sum(QuantityOfInterest):
    over_time: Over = "mean"

    def functionals(self, space):
        row = csr_array(np.array([scaled(np.ones(space.n_dofs))]))
        return Functionals(row, ("sum",), "1/1000", np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, dtype=int))

@hookimpl
def dacore_quantities():
    return [PluginSpec("{name}", "{target}")]
"""


def quantity(factor=1.0, name="all_together", target="more:Sum"):
    return QUANTITY.format(factor=factor, name=name, target=target)


@pytest.fixture
def folder(tmp_path):
    """A copy of the example, to which files can be added."""
    for name in ("epidemic.py", "epidemic.toml"):
        (tmp_path / name).write_text((EPIDEMIC / name).read_text(encoding="utf-8"), encoding="utf-8")
    return tmp_path


def asked(folder, *changes, files='plugins=["epidemic.py", "more.py"]', cache="cache"):
    extra = ['quantity.sum={kind="all_together"}', files]
    return open_scene(folder / "epidemic.toml", [*SMALL, *extra, *changes], folder / cache)


def total(session):
    return session.runner["measured"].quantities["sum"]


def test_a_file_counts_for_its_scene_alone(folder):
    (folder / "more.py").write_text(quantity())
    session = asked(folder)
    registry = session.builder.registry
    assert registry.get("model", "sir").__name__ == "SIR"
    assert registry.get("quantity", "all_together").__name__ == "Sum"
    assert "sir" not in [spec.name for spec in load().specs("model")]
    rows = {(row.kind, row.name): row for row in registry.table()}
    assert (rows["model", "sir"].distribution, rows["model", "sir"].status) == ("epidemic.py", "ready")
    versions = session.builder.versions()
    assert versions["epidemic.py"].startswith("source ")
    assert "not installed" not in versions.values()


def test_files_of_one_name_and_versions_of_one_file_do_not_mix(folder, tmp_path_factory):
    (folder / "more.py").write_text(quantity(1.0))
    other = tmp_path_factory.mktemp("other")
    for name in ("epidemic.py", "epidemic.toml"):
        (other / name).write_text((folder / name).read_text())
    (other / "more.py").write_text(quantity(3.0))
    first, second = asked(folder), asked(other)
    assert first.builder.quantities["sum"].functionals.__globals__["FACTOR"] == 1.0
    np.testing.assert_allclose(total(second), 3.0 * total(first))
    # Edited: what was opened before stays what it was, its key too, and what is opened now is new.
    (folder / "more.py").write_text(quantity(5.0))
    edited = asked(folder)
    np.testing.assert_allclose(total(edited), 5.0 * total(first))
    assert asked(folder).builder.registry.get("quantity", "all_together") is edited.builder.registry.get(
        "quantity", "all_together"
    )


def keys(session):
    pipeline = session.runner.pipeline
    return {stage.name: pipeline.key(stage.name) for stage in pipeline.stages}


def test_the_content_of_a_file_is_in_the_keys_of_what_it_declares_and_its_place_is_not(folder, tmp_path_factory):
    (folder / "more.py").write_text(quantity())
    before = keys(asked(folder))
    (folder / "more.py").write_text(quantity() + "\n# another\n")
    changed = {name for name, key in keys(asked(folder)).items() if key != before[name]}
    assert "measured" in changed
    assert not changed & {"model", "functionals", "training", "truth", "prepared.pbdw"}
    elsewhere = tmp_path_factory.mktemp("moved") / "below"
    elsewhere.mkdir()
    for name in ("epidemic.py", "epidemic.toml"):
        (elsewhere / name).write_text((folder / name).read_text())
    (elsewhere / "renamed.py").write_text(quantity(target="renamed:Sum"))
    (folder / "renamed.py").write_text(quantity(target="renamed:Sum"))
    names = 'plugins=["epidemic.py", "renamed.py"]'
    assert keys(asked(elsewhere, files=names)) == keys(asked(folder, files=names))


def test_what_was_kept_is_found_again(folder):
    (folder / "more.py").write_text(quantity())
    made = total(asked(folder))
    again = asked(folder)
    assert np.array_equal(total(again), made)
    assert again.runner.states["measured"] == "cached"


def test_worker_processes_have_its_classes(folder):
    """Models travel by value: workers import no file, and need none."""
    alone = open_scene(folder / "epidemic.toml", SMALL, folder / "alone")
    two = open_scene(folder / "epidemic.toml", SMALL, folder / "two", workers=2)
    for one, other in zip(alone.runner["training"], two.runner["training"], strict=True):
        np.testing.assert_array_equal(one.states, other.states)


def test_workers_of_a_cluster_have_its_classes_and_no_file(folder, tmp_path_factory):
    alone = open_scene(folder / "epidemic.toml", SMALL, folder / "alone")
    with cluster(tmp_path_factory.mktemp("cluster"), 1) as made:
        there = open_scene(folder / "epidemic.toml", SMALL, folder / "there", scheduler=str(made.file))
        solved = there.runner["training"]
    for one, other in zip(alone.runner["training"], solved, strict=True):
        np.testing.assert_array_equal(one.states, other.states)


STUDY = """
from dataclasses import dataclass
import numpy as np
from dacore.plugins import PluginSpec, hookimpl
from dacore.workflow.report_parts import Table
from dacore.workflow.studies.study import Exhibit, Findings, Study, Variant

@dataclass(frozen=True)
class Sizes(Study):
    heading = "Sizes"
    towns: int

    def variants(self, scene):
        return {"other": Variant({"physics.towns": self.towns}, ("training",))}

    def run(self, bench):
        sessions = (bench.session, bench.variant("other"))
        return Findings({"dofs": np.array([each.model.space.n_dofs for each in sessions])})

    def show(self, found, canvas):
        return Exhibit("How large.", [Table(["here", "there"], [[str(n) for n in found.arrays["dofs"]]], "dofs")])

@hookimpl
def dacore_studies():
    return [PluginSpec("sizes", f"{__name__}:Sizes")]
"""


def test_run_with_studies_in_processes_of_their_own_and_variants(folder, capsys):
    (folder / "more.py").write_text(STUDY)
    out = folder / "out"
    changes = [*SMALL, 'plugins=["epidemic.py", "more.py"]', 'study.some={kind="sizes", towns=10}',
               'study.others={kind="sizes", towns=12}']  # fmt: skip
    arguments = [part for change in changes for part in ("--set", change)]
    scene = str(folder / "epidemic.toml")
    with pytest.raises(SystemExit) as left:
        main(["run", scene, "--out", str(out), "--workers", "2", *arguments])
    assert left.value.code in (0, None), capsys.readouterr().err
    results = json.loads((out / "results.json").read_text())
    assert results["versions"]["more.py"].startswith("source ")
    assert results["mesh"] is None
    found = open_scene(scene, changes, out / "cache").runner["study.others"].arrays["dofs"]
    assert found.tolist() == [27, 36]


def test_a_comparison_in_processes_of_their_own(folder):
    command = "from dacore.cli.main import main; main()"
    changes = [part for change in SMALL for part in ("--set", change)]
    done = subprocess.run(
        [sys.executable, "-c", command, "compare", "epidemic.toml", "--vary", "physics.seed=0,1", "--rounds", "1",
         "--workers", "1", "--out", "out", *changes], capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((folder / "out/comparison.json").read_text())
    assert len(found["variants"]) == 2


def test_stress_asks_a_model_that_steps_by_itself_what_can_be_asked(folder):
    command = "from dacore.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", command, "stress", "epidemic.toml", "--out", "out", "--themes", "data"],
        capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    found = json.loads((folder / "out/stress.json").read_text())
    verdicts = {case["name"]: case["verdict"] for case in found["cases"]}
    assert "crashed" not in verdicts.values(), done.stderr
    assert "stable" in verdicts.values()


FAULTS = {
    "missing": (None, "no such file; expected a Python file with hooks"),
    "syntax": ("x = 1\ndef broken(:\n", "line 2: SyntaxError: invalid syntax"),
    "import": ("import os\nimport no_such_library\n", "line 2: ModuleNotFoundError: No module named 'no_such_library'; "
               "install what brings no_such_library"),
    "beside": ("import helper\n", "line 1: ModuleNotFoundError: No module named 'helper'; helper lies beside it, but a "
               "plugin file stands alone"),
    "raises": ("def f():\n    return {}['x']\nf()\n", "line 2: KeyError: 'x'"),
    "exits": ("raise SystemExit(3)\n", "line 1: SystemExit: 3"),
    "nothing": ("x = 1\n", "declares nothing; expected at least one of the hooks"),
    "no class": (quantity(target="more:Summ"), "target: the file has no Summ"),
    "taken": (quantity(name="boundary_mean"), "quantity 'boundary_mean' is declared by dacore-imaging 0.1.0 already"),
    "taken here": (quantity(name="in_town"), "quantity 'in_town' is declared by epidemic.py already"),
    "unmarked": ("def dacore_models():\n    return []\n", "function dacore_models is not marked with @hookimpl"),
    "misspelt": ("from dacore.plugins import hookimpl\n@hookimpl\ndef dacore_model():\n    return []\n",
                 "hook dacore_model does not exist (did you mean dacore_models?)"),
    "future": (quantity().replace('"more:Sum")', '"more:Sum", api="1.99")'),
               "written for plugin interface 1.99, this dacore has 1."),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_what_is_wrong_with_a_file_is_one_line(folder, case, capsys):
    content, message = FAULTS[case]
    (folder / "helper.py").write_text("")
    if content is not None:
        (folder / "more.py").write_text(content)
    modules = set(sys.modules)
    with pytest.raises(SceneError) as error:
        asked(folder)
    text = str(error.value)
    assert text.startswith(f"{folder / 'epidemic.toml'}: plugins: more.py: {message}")
    assert "\n" not in text
    assert not [
        name for name in set(sys.modules) - modules if name.startswith("more_") and case in ("syntax", "raises")
    ]
    # The list says it too, beside all that is sound, and does not stop.
    (folder / "listed.toml").write_text('title = "x"\nplugins = ["epidemic.py", "more.py"]\n')
    with pytest.raises(SystemExit) as left:
        main(["plugins", str(folder / "listed.toml")])
    assert left.value.code in (0, None)
    said = " ".join(capsys.readouterr().out.split())
    assert "epidemic.py" in said
    assert "more.py" in said
    assert "failed:" in said


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ('plugins=["epidemic.py", "./epidemic.py"]', "plugins: ./epidemic.py: is named twice"),
        ('plugins=["."]', "plugins: .: is a folder"),
        ('plugins=["epidemic.toml"]', "plugins: epidemic.toml: is no Python file"),
        ('plugins="epidemic.py"', "plugins: got 'epidemic.py', expected a valid list"),
        ("plugins=[]", "model 'sir' is not installed"),
    ],
)
def test_what_is_wrong_with_the_list_is_one_line(folder, given, message):
    with pytest.raises(SceneError) as error:
        open_scene(folder / "epidemic.toml", [given])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_path_starts_from_the_folder_of_the_scene(folder, monkeypatch):
    (folder / "below").mkdir()
    (folder / "epidemic.py").rename(folder / "below/epidemic.py")
    monkeypatch.chdir(folder / "below")
    builder = Builder(read_scene(Path("../epidemic.toml"), ['plugins=["below/epidemic.py"]']), "scene", Path(".."))
    builder.check()
    assert builder.physics.towns == 30


def test_a_file_can_be_imported_for_its_tests(folder):
    module = import_file(folder / "epidemic.py")
    assert module is import_file(str(folder / "epidemic.py"))
    session = open_scene(folder / "epidemic.toml", SMALL, folder / "cache")
    assert session.builder.registry.get("model", "sir") is module.SIR
