"""A process loads the finite element library it was told to use, when it uses it, and no other."""

import pytest

from tests.environment.processes import FAMILIES, LIBRARIES, LOADED, SMALL, TOY, backends, dacore, last_line, python

BUILD = f"""{LOADED}
from dacore import open_scene
session = open_scene({str(TOY)!r}, ["discretization.backend=" + sys.argv[1], *{list(SMALL)!r}], cache=sys.argv[2])
model = session.model
"""


@pytest.mark.parametrize("name", backends())
def test_a_scene_loads_its_own_library_and_no_other(name, tmp_path):
    loaded = last_line(python(BUILD + "print(loaded())", name, tmp_path))
    assert FAMILIES[name] & loaded
    assert not (LIBRARIES - FAMILIES[name]) & loaded


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["plugins"], ["run", "--help"]])
def test_commands_that_compute_nothing_load_no_library(arguments):
    assert not last_line(dacore(*arguments)) & LIBRARIES


@pytest.mark.parametrize("name", backends())
def test_a_plan_loads_no_library(name, tmp_path):
    done = dacore("plan", TOY, "--set", f"discretization.backend={name}", "--out", tmp_path)
    assert "training" in done.stdout
    assert not last_line(done) & LIBRARIES


@pytest.mark.parametrize("name", backends())
def test_a_worker_loads_no_library(name, tmp_path):
    """It gets the model by pickle and solves; the matrices are in the pickle, the forms' library is not needed."""
    write = "import pickle\nwith open(sys.argv[3], 'wb') as stream:\n    pickle.dump(model, stream)\nprint(loaded())"
    assert last_line(python(BUILD + write, name, tmp_path, tmp_path / "model")) & FAMILIES[name]
    read = f"""{LOADED}
import pickle
with open(sys.argv[1], "rb") as stream:
    model = pickle.load(stream)
middle = {{p.name: 0.5 * (p.low + p.high) for p in model.parameters.parameters}}
assert abs(model.solve(middle).states).max() > 0
print(loaded())
"""
    assert not last_line(python(read, tmp_path / "model")) & LIBRARIES


@pytest.mark.parametrize("name", backends())
def test_results_can_be_written_and_read_beside_the_library(name, tmp_path):
    """DOLFINx brings an HDF5 library of its own; the one that writes trajectories has to stay whole."""
    code = BUILD + "assert abs(session.truth[0].states).max() > 0\nprint(loaded())"
    assert FAMILIES[name] & last_line(python(code, name, tmp_path))
    assert list(tmp_path.rglob("*.h5"))
