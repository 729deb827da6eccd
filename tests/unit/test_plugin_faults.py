"""Faults of a plugin's own code are one line that names the plugin, and a wrong solver is not believed."""

from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.algebra.linear_solver import CorrectingSolver, prepared
from dacore.algebra.solvers import Direct
from dacore.core.discretization import Backend
from dacore.core.observation import ObservationOperator
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ConvergenceError, PluginError, SceneError
from dacore.io.scene import read_scene
from dacore.plugins import PluginSpec, hookimpl
from dacore.plugins.registry import load
from dacore.workflow import build
from dacore.workflow.build import Builder, source_hash
from dacore.workflow.stages import scene_pipeline

TOY = Path(__file__).resolve().parents[2] / "examples/toy/ball.toml"


class Needy(Backend):
    name = "needy"

    def __init__(self, what):
        self.what = what

    def assembler(self, mesh):
        raise NotImplementedError

    def version(self):
        return "1"


class Other(Needy):
    name = "somebody"

    def __init__(self):
        pass


class Versionless(Other):
    name = "versionless"

    def version(self):
        raise OSError("no such file")


class Nothing(Other):
    name = "nothing"

    def assembler(self, mesh):
        class Empty:
            def __getattr__(self, form):
                return lambda *given: None

        return Empty()


@dataclass(frozen=True)
class Broken(ObservationOperator):
    def functionals(self, space):
        return [][3]


@dataclass(frozen=True)
class Off(SolverMethod):
    """Right but for a factor."""

    factor: float = 1.01

    def prepare(self, matrix, definite, tolerance, analysis=None):
        class Solver(LinearSolver):
            name = "off"

            def solve(self, rhs, guess=None):
                return factor * inner.solve(rhs, guess)

        factor, inner = self.factor, Direct().prepare(matrix, definite, tolerance, analysis)
        return Solver()


@dataclass(frozen=True)
class Taken(Off):
    tolerance: float = 1e-3


@hookimpl
def dacore_backends():
    return [PluginSpec(name, f"tests.unit.test_plugin_faults:{cls}") for name, cls in BACKENDS.items()]


@hookimpl
def dacore_observations():
    return [PluginSpec("broken", "tests.unit.test_plugin_faults:Broken")]


@hookimpl
def dacore_solvers():
    return [PluginSpec(name, f"tests.unit.test_plugin_faults:{name.title()}") for name in ("off", "taken")]


BACKENDS = {"needy": "Needy", "other": "Other", "versionless": "Versionless", "nothing": "Nothing"}


@pytest.fixture
def builder(monkeypatch):
    points = [*entry_points(group="dacore"), EntryPoint("faults", "tests.unit.test_plugin_faults", "dacore")]
    monkeypatch.setattr(build, "load", lambda: load(points))
    return lambda *changes: Builder(read_scene(TOY, ["domain.edge=2.5", *changes]), "toy", TOY.parent)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("discretization.backend='needy'", r"discretization.backend: its plugin failed \(TypeError: .*what"),
        ("discretization.backend='other'", "backend 'other' calls itself 'somebody'"),
        ("discretization.backend='versionless'", r"discretization.backend: its plugin failed \(OSError: no such file"),
        ("discretization.backend='nothing'", "backend nothing gave mass as NoneType, expected a sparse matrix"),
        ("observation.slice={kind='broken'}", r"observation.slice: its plugin failed \(IndexError"),
        ("solver={kind='taken'}", "solver 'taken' has a setting 'tolerance', a key of the scene itself"),
    ],
)
def test_faults_of_a_plugin_are_one_line_that_names_its_place(builder, change, message):
    made = builder(change)

    def work():
        made.check()
        scene_pipeline(made)
        made.functionals(made.model(made.domain.mesh()).space)

    with pytest.raises(SceneError, match=message) as caught:
        work()
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("toy: ")


def test_a_solver_that_is_wrong_and_silent_is_found_out(builder):
    model = builder("solver={kind='off'}", "time.steps=2").model(builder().domain.mesh())
    parameters = {p.name: p.low for p in model.parameters.parameters}
    with pytest.raises(ConvergenceError, match=r"off: the relative residual of column 0 is .*it is at fault"):
        model.solve(parameters)


def test_answers_of_another_solver_are_checked_and_its_own_are_not_checked_twice():
    matrix, definite = csr_array(np.diag([2.0, 1.0, -1.0])), np.array([True, True, False])
    assert isinstance(prepared(Direct(), matrix, definite, 1e-10), CorrectingSolver)
    right = prepared(Off(1.0), matrix, definite, 1e-10)
    np.testing.assert_allclose(right.solve(np.ones((3, 2))), np.array([[0.5, 1.0, -1.0]] * 2).T)
    assert right.solve(np.zeros(3)).shape == (3,)
    for factor in (1.01, np.nan):
        with pytest.raises(ConvergenceError, match="column 0"):
            prepared(Off(factor), matrix, definite, 1e-10).solve(np.ones(3))


def test_a_correction_of_the_wrong_shape_is_said():
    class Flat(CorrectingSolver):
        name = "flat"

        def correct(self, residual, goal):
            return residual[:, 0]

    with pytest.raises(PluginError, match=r"flat: correct gave shape \(2,\), expected \(2, 1\)"):
        Flat(csr_array(np.eye(2)), np.ones(2, dtype=bool), 1e-8).solve(np.ones(2))


def test_the_source_of_what_a_plugin_builds_on_counts_too(builder, monkeypatch):
    made = builder()
    before = made.version_of("solver", "taken")
    assert before.count("+") >= 1
    asked = []
    monkeypatch.setattr(build, "source_hash", lambda name: asked.append(name) or "x")
    made.version_of("backend", "skfem")
    assert asked == ["dacore_skfem"]


def test_a_module_without_a_package_is_hashed_alone(tmp_path, monkeypatch):
    (tmp_path / "lonely_module.py").write_text("x = 1\n")
    (tmp_path / "neighbour.py").write_text("y = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = source_hash("lonely_module")
    source_hash.cache_clear()
    (tmp_path / "neighbour.py").write_text("y = 2\n")
    assert source_hash("lonely_module") == before
