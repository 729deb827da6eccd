"""What values show of themselves: short, true, escaped, and nothing is computed for it."""

import importlib
import pkgutil
from dataclasses import dataclass, fields, is_dataclass
from html.parser import HTMLParser
from importlib.metadata import EntryPoint, entry_points

import numpy as np
import pytest

import dacore
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.display import Card, Displayed, Rows, brief, count, moments, number, percent, unit_text
from dacore.core.estimator import BackgroundSpace, Estimate, ParameterEstimate, PreparedEstimator
from dacore.core.misfit import Misfit
from dacore.core.model import AffineModel, Trajectory
from dacore.core.noise import WhiteNoise
from dacore.core.timegrid import TimeGrid
from dacore.core.uncertainty import Uncertainty
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.estimators.minimum_variance import MinimumVariance
from dacore.estimators.pbdw import PBDW
from dacore.io.scene import Scene
from dacore.plugins.registry import load
from dacore.testing.backgrounds import random_background, random_functionals
from dacore.testing.spaces import Chain
from dacore.workflow import build
from dacore.workflow.session import Session
from tests.rods import rod

EVIL = "<script>alert('x')</script> & \"co\""

# Wide enough for a table of a validation with several errors, and not for an array.
LINES, WIDTH = 22, 130


class Reader(HTMLParser):
    """Text and tags of a piece of HTML."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.words, self.open = set(), [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        assert self.open == []
        return " ".join(self.words)


def shown(value, *facts):
    """The text and the table of a value hold `facts`, and are as short and as plain as they should be."""
    text, html = repr(value), value._repr_html_()
    assert len(text.split("\n")) <= LINES
    assert max(map(len, text.split("\n"))) <= WIDTH
    assert "array([" not in text
    assert " object at 0x" not in text
    read = Reader(html)
    assert read.tags <= {"div", "strong", "table", "thead", "tbody", "tr", "th", "td"}
    assert "color:inherit" in html or "<table" not in html
    for fact in facts:
        assert fact in text
        assert fact in read.text
    return text


@pytest.fixture(scope="module")
def stand():
    rng = np.random.default_rng(0)
    space = Chain(8)
    background = random_background(rng, space, 12)
    functionals = random_functionals(rng, space, 9)
    data = functionals.matrix @ background.lift(background.coefficients[:, :, 0])
    prepared = MinimumVariance().prepare(background, functionals, WhiteNoise())
    return background, functionals, prepared, prepared.estimate(data, 0.1)


SCENE = """
title = "TITLE"
[physics]
kind = "ring"
[training]
samples = 12
[observation.some]
kind = "thermometers"
[quantity.far]
kind = "tank"
[noise]
levels = [0.0, 0.01]
[estimator.pbdw]
kind = "pbdw"
spaces = "cycle"
centring = "none"
n = 2
[estimator.mv]
kind = "minimum_variance"
[validation]
cases = 4
"""


@pytest.fixture
def session(tmp_path, monkeypatch):
    points = [*entry_points(group="dacore"), EntryPoint("tanks", "tests.graph_plugin", "dacore")]
    monkeypatch.setattr(build, "load", lambda: load(points))
    path = tmp_path / "ring.toml"
    path.write_text(SCENE.replace("TITLE", EVIL.replace('"', '\\"')))
    return dacore.open_scene(path, cache=tmp_path / "cache")


def refuse(*_):
    raise AssertionError("a stage was asked for")


def test_a_session_tells_its_stages_and_computes_none(session, monkeypatch):
    from dacore.pipeline.runner import Runner

    with monkeypatch.context() as patch:
        patch.setattr(Runner, "_make", refuse)
        patch.setattr(Runner, "_load_or_compute", refuse)
        text = shown(session, "thermometers", "far (tank)", "mv (minimum_variance)", "12 samples", "0%, 1%")
        assert "stages not yet" in text
        assert "stages made" not in text
        shown(session.scene, "some (thermometers)")
        assert str(session.scene) == repr(session.scene)
    assert session.background.n_samples == 12
    text = shown(session, "stages made", "background")
    again = dacore.open_scene(session.builder.where, cache=session.runner.cache)
    assert "stages kept" in repr(again)
    assert "training" in repr(again).split("stages kept")[1].split("\n")[0]
    assert again.runner.timings == {}


def test_a_session_whose_stages_would_fail_shows_itself(session):
    stage = session.runner.pipeline.stages[0]
    object.__setattr__(stage, "compute", refuse)
    with pytest.raises(AssertionError, match="asked for"):
        session.runner[stage.name]
    shown(session, "stages not yet")


def test_titles_are_escaped(session):
    for value in (session, session.scene):
        html = value._repr_html_()
        assert "<script>" not in html
        assert EVIL in Reader(html).text


def test_results_show_themselves(session):
    text = shown(session.validation, "training mean", "pbdw", "mv", "rms of far", "error of T", "1%")
    assert len(text.split("\n")) == 4 + 1 + 2 * 2
    outcome = session.validation.outcome("mv", 0.01)
    shown(outcome, "mv", "1%", "far")
    shown(outcome.quantities["far"], "rms error")
    shown(session.judged("pbdw"), "dimensions", "pbdw")
    shown(session.truth, "4")
    shown(session.background, "12 trajectories", "T")
    shown(session.model.space, "capabilities")
    shown(session.model)


def test_estimates_tell_series_fields_and_what_the_data_say(stand):
    background, functionals, prepared, estimate = stand
    shown(estimate, "series", "no alarm", "u [", "uncertainty")
    shown(prepared, "MinimumVariance", "9 at 9 places", "12 trajectories")
    shown(background, "12 trajectories", "u", "modes")
    shown(functionals, "9 at 9 places")
    shown(estimate.misfit, "no alarm")
    shown(estimate.uncertainty)
    space = (
        PBDW(n=3, spaces="cycle", centring="none", weights={"p": 1.0})
        .prepare(background, functionals, WhiteNoise())
        .spaces()[0]
    )
    shown(space, "3 of at most")


def test_misfits_count_alarms():
    good, bad = Misfit(np.array([9.0]), np.array([10.0])), Misfit(np.array([900.0]), np.array([10.0]))
    shown(good, "no alarm", "0.949")
    shown(bad, "the data contradict", "9.49")
    shown(Misfit(np.array([9.0, 900.0, 8.0]), np.full(3, 10.0)), "1 alarm of 3 series", "9.49")


def test_parameters_are_a_table():
    space = rod(10).parameters
    text = shown(space, "modulus", "80", "fixed", "uniform", "8, 4 of them free")
    assert text.index("modulus") < text.index("alpha")  # those that vary first
    found = ParameterEstimate(
        ("E", "nu"), np.array([[2.0], [0.4]]), np.array([np.diag([0.25, 0.01])]), np.array([1.0, 0.1])
    )
    shown(found, "2 ± 0.5", "0.4 ± 0.1", "75%", "0%")


def test_models_meshes_and_trajectories():
    model = rod(10)
    shown(model, "u, p", "inflow", "storage", "3 prescribed")
    shown(MarchedModel(model, TimeGrid(0.01, 20)), "20, 10 to 200 ms", "inflow", "Auto")
    shown(Trajectory(np.zeros((20, 4)), np.arange(1.0, 5.0)), "4, 1 to 4 s", "20")
    shown(model.zeroth_order[0], "modulus", "20 × 20")
    mesh = Box(divisions=(2, 2, 2)).mesh()
    shown(mesh, "27 nodes", "tetrahedra", "facets", "x 0 to 1")
    shown(Box((0.0, 0.0), (1.0, 1.0), (2, 2)).mesh(), "9 nodes", "triangles", "edges")


def test_no_value_of_the_core_prints_arrays():
    """Whatever holds an array in the core or in the results of studies has a representation of its own."""
    left = []
    for package in ("dacore.core", "dacore.studies", "dacore.reduction"):
        root = importlib.import_module(package)
        for info in pkgutil.iter_modules(root.__path__):
            module = importlib.import_module(f"{package}.{info.name}")
            for name, cls in vars(module).items():
                mine = isinstance(cls, type) and cls.__module__ == module.__name__ and is_dataclass(cls)
                held = mine and any("Array" in str(each.type) or each.type is Array for each in fields(cls))
                if held and not name.startswith("_") and not issubclass(cls, Displayed):
                    left.append(f"{module.__name__}.{name}")
    assert left == []


@pytest.mark.parametrize(
    "cls", [Session, Scene, Background, Estimate, ParameterEstimate, Misfit, Uncertainty, PreparedEstimator,
            BackgroundSpace, AffineModel, MarchedModel, Trajectory],
)  # fmt: skip
def test_every_value_for_users_shows_itself(cls):
    assert issubclass(cls, Displayed)
    assert cls.__repr__ is Displayed.__repr__


def test_the_default_shows_arrays_by_shape_and_cuts_long_text():
    @dataclass(frozen=True, repr=False)
    class Own(Displayed):
        values: object
        name: str
        nothing: object = None
        many: tuple = ()

    text = shown(Own(np.zeros((3, 4)), "x" * 500, many=tuple(range(1000))), "array 3 × 4")
    assert "nothing" not in text
    assert "(1,000)" in text or "1000" in text


def test_a_long_fact_goes_on_below_itself():
    words = " ".join(f"word{k}" for k in range(30))
    text = Card("Long", (("said", words), ("endless", "on and on " * 500))).text()
    assert all(f"word{k}" in text for k in range(30))
    assert max(map(len, text.split("\n"))) < 110
    assert text.endswith("…")
    assert len(text.split("\n")) < 12


def test_long_tables_are_cut():
    rows = tuple((str(k), "x") for k in range(500))
    text = Card("Long", (), (Rows(("n", "x"), rows),)).text()
    assert "… and 476 more" in text
    assert len(text.split("\n")) < 30
    html = Card("Long", (), (Rows(("n", "x"), rows),)).html()
    assert html.count("<tr>") == 41
    assert "… and 460 more" in html


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (number(1e6), "1e6"), (number(1e5), "1e5"), (number(10132.5), "10132.5"), (number(1e-9), "1e-9"),
        (number(0.0), "0"), (percent(0.00127), "0.13%"), (percent(0.0), "0%"), (percent(42.0), "4200%"),
        (percent(1e5), "1e7%"), (percent(np.nan), "–"), (count(1, "mode"), "1 mode"),
        (count(5147, "node"), "5,147 nodes"), (unit_text("dyn/cm^2"), "dyn/cm²"), (unit_text("1"), "–"),
        (moments([0.0005]), "1, 500 µs"), (moments([]), "none"), (brief(None), ""),
        (brief({"a": 1, "b": 2}), "a, b"), (brief([1.5, 2]), "1.5, 2"), (brief(print), "print"),
    ],
)  # fmt: skip
def test_numbers_and_words(made, text):
    assert made == text
