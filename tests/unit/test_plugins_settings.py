"""Settings from tables of a scene: what is taken, what is refused, and in which words."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Optional

import numpy as np
import pytest
from annotated_types import Gt, MinLen
from hypothesis import given
from hypothesis import strategies as st

from dacore.errors import PluginError, SceneError, ShapeError
from dacore.plugins.settings import build


@dataclass(frozen=True)
class Pulse:
    amplitude: float
    side: Literal["front", "back"] = "back"

    def __post_init__(self) -> None:
        if self.amplitude == 0:
            raise ShapeError("amplitude: got 0, expected another number")


@dataclass(frozen=True)
class Everything:
    size: float
    count: int = 1
    flag: bool = False
    word: str = "word"
    kind: Literal["one", "two"] = "one"
    order: Literal[1, 2] = 1
    vector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    numbers: tuple[float, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    maybe: float | None = None
    old_maybe: Optional[int] = None  # noqa: UP045  plugins may write it so
    either: float | Literal["balanced"] = 1.0
    path: Path = Path("default.dat")
    paths: tuple[Path, ...] = ()
    maybe_path: Path | None = None
    pulse: Pulse | None = None
    pulses: tuple[Pulse, ...] = ()
    named: Mapping[str, Pulse] = field(default_factory=dict)
    names: Sequence[str] = ()
    positive: Annotated[float, Gt(0)] = 1.0
    some: Annotated[tuple[int, ...], MinLen(2)] = (1, 2)
    shape: "float | tuple[float, float]" = 1.0
    anything: Any = None
    constant: ClassVar[int] = 7
    derived: int = field(default=3, init=False)


def make(toml: str, base: Path | None = None) -> Everything:
    return build(Everything, tomllib.loads(toml), "demo.toml: model", base)


TAKEN = [
    ("size = 2", "size", 2.0),
    ("size = 1e-9", "size", 1e-9),
    ("count = 3", "count", 3),
    ("flag = true", "flag", True),
    ("kind = 'two'", "kind", "two"),
    ("order = 2", "order", 2),
    ("vector = [1, 2, 3.5]", "vector", (1.0, 2.0, 3.5)),
    ("numbers = []", "numbers", ()),
    ("numbers = [1]", "numbers", (1.0,)),
    ("weights = {u = 1, p = 2.5}", "weights", {"u": 1.0, "p": 2.5}),
    ("ranges = {E = [1e5, 1e6]}", "ranges", {"E": (1e5, 1e6)}),
    ("maybe = 2", "maybe", 2.0),
    ("old_maybe = 2", "old_maybe", 2),
    ("either = 'balanced'", "either", "balanced"),
    ("either = 1e-18", "either", 1e-18),
    ("pulse = {amplitude = 3}", "pulse", Pulse(3.0)),
    ("pulses = [{amplitude = 3}, {amplitude = 4, side = 'front'}]", "pulses", (Pulse(3.0), Pulse(4.0, "front"))),
    ("named = {a = {amplitude = 3}}", "named", {"a": Pulse(3.0)}),
    ("names = ['a', 'b']", "names", ["a", "b"]),
    ("positive = 2", "positive", 2.0),
    ("shape = [1, 2]", "shape", (1.0, 2.0)),
    ("anything = [1, 'a']", "anything", [1, "a"]),
]


@pytest.mark.parametrize(("line", "key", "value"), TAKEN)
def test_what_is_taken(line, key, value):
    got = getattr(make(line if line.startswith("size") else f"size = 1\n{line}"), key)
    assert got == value
    assert type(got) is type(value)
    if isinstance(value, tuple):
        assert [type(each) for each in got] == [type(each) for each in value]


def test_defaults_and_constants_stay():
    made = make("size = 1")
    assert (made.count, made.path, made.derived, Everything.constant) == (1, Path("default.dat"), 3, 7)


REFUSED = [
    ("size = true", ".size: got true, expected a number"),
    ("size = '1.0'", ".size: got '1.0', expected a number"),
    ("size = nan", ".size: got nan, expected a finite number"),
    ("size = inf", ".size: got inf, expected a finite number"),
    ("size = [1]", ".size: got [1], expected a number"),
    ("size = 1979-05-27", ".size: got a date, expected numbers, text, true or false, lists and tables"),
    ("count = 1.5", ".count: got 1.5, expected a whole number"),
    ("count = 1.0", ".count: got 1.0, expected a whole number"),
    ("count = false", ".count: got false, expected a whole number"),
    ("flag = 1", ".flag: got 1, expected true or false"),
    ("flag = 'yes'", ".flag: got 'yes', expected true or false"),
    ("word = 1", ".word: got 1, expected text in quotes"),
    ("kind = 'three'", ".kind: got 'three', expected 'one' or 'two'"),
    ("kind = 'onee'", ".kind: got 'onee', expected 'one' or 'two'; did you mean 'one'?"),
    ("order = 3", ".order: got 3, expected 1 or 2"),
    ("order = true", ".order: got true, expected 1 or 2"),
    ("order = 1.0", ".order: got 1.0, expected 1 or 2"),
    ("vector = 1", ".vector: got 1, expected a list"),
    ("vector = [1, 2]", ".vector: got [1, 2], expected a list of 3"),
    ("vector = []", ".vector: got [], expected a list of 3"),
    ("vector = [1, 2, 3, 4]", ".vector: got [1, 2, 3, 4], expected a list of at most 3"),
    ("vector = [1, 'x', 3]", ".vector[1]: got 'x', expected a number"),
    ("numbers = [1, true]", ".numbers[1]: got true, expected a number"),
    ("numbers = {a = 1}", ".numbers: got a table with a, expected a list"),
    ("weights = {u = 'x'}", ".weights.u: got 'x', expected a number"),
    ("weights = 3", ".weights: got 3, expected a table"),
    ("ranges = {E = [1]}", ".ranges.E: got [1], expected a list of 2"),
    ("maybe = 'x'", ".maybe: got 'x', expected a number"),
    ("old_maybe = 1.5", ".old_maybe: got 1.5, expected a whole number"),
    ("either = 'ballanced'", ".either: got 'ballanced', expected a number or 'balanced'"),
    ("path = 1", ".path: got 1, expected text in quotes"),
    ("maybe_path = true", ".maybe_path: got true, expected text in quotes"),
    ("paths = ['a', 2]", ".paths[1]: got 2, expected text in quotes"),
    ("pulse = 3", ".pulse: got 3, expected a table"),
    ("pulse = {}", ".pulse.amplitude: missing; expected a number"),
    ("pulse = {amplitude = 'x'}", ".pulse.amplitude: got 'x', expected a number"),
    (
        "pulse = {amplitude = 1, sid = 'x'}",
        ".pulse.sid: unknown key; did you mean 'side'?; allowed here: amplitude, side",
    ),
    ("pulse = {amplitude = 0}", ".pulse: amplitude: got 0, expected another number"),
    ("pulses = [{amplitude = 1}, {amplitude = true}]", ".pulses[1].amplitude: got true, expected a number"),
    (
        "named = {a = {amplitude = 1, side = 'fron'}}",
        ".named.a.side: got 'fron', expected 'front' or 'back'; did you mean 'front'?",
    ),
    ("names = 'abc'", ".names: got 'abc', expected a list"),
    ("positive = -1", ".positive: got -1, expected greater than 0"),
    ("some = [1]", ".some: got [1], expected a list of at least 2"),
    ("shape = 'x'", ".shape: got 'x', expected a number or a list"),
    ("shape = [1, 'x']", ".shape[1]: got 'x', expected a number"),
    ("named = {'a b' = 1}", ".named.'a b': got 1, expected a table"),
    ('"line\\nbreak" = 1', ".'line\\nbreak': unknown key"),
    ("sizze = 1", ".sizze: unknown key; did you mean 'size'?; allowed here: anything, count, either"),
    ("derived = 1", ".derived: unknown key; allowed here: "),
    ("constant = 1", ".constant: unknown key"),
]


@pytest.mark.parametrize(("line", "message"), REFUSED)
def test_what_is_refused_and_how(line, message):
    with pytest.raises(SceneError) as caught:
        make(line if line.startswith("size") else f"size = 1\n{line}")
    text = str(caught.value)
    assert text.startswith(f"demo.toml: model{message}")
    assert "\n" not in text
    assert len(text) < 320


def test_a_missing_key_says_what_it_wants():
    with pytest.raises(SceneError, match=r"^demo\.toml: model\.size: missing; expected a number$"):
        make("count = 1")


def test_the_classes_own_check_speaks_in_its_own_words():
    with pytest.raises(SceneError, match=r"^here: amplitude: got 0, expected another number$") as caught:
        build(Pulse, {"amplitude": 0}, "here")
    assert isinstance(caught.value.__cause__, ShapeError)


def test_an_unexpected_failure_of_the_class_is_not_disguised():
    @dataclass(frozen=True)
    class Buggy:
        size: float = 1.0

        def __post_init__(self) -> None:
            raise KeyError("bug")

    with pytest.raises(KeyError, match="bug"):
        build(Buggy, {}, "here")


def test_relative_paths_start_at_the_scene(tmp_path):
    made = make(f"size = 1\npath = 'a/b.dat'\npaths = ['c', '{tmp_path}/d']\nmaybe_path = 'e'", Path("/scenes"))
    assert made.path == Path("/scenes/a/b.dat")
    assert made.paths == (Path("/scenes/c"), tmp_path / "d")
    assert made.maybe_path == Path("/scenes/e")
    assert make("size = 1\npath = 'a'").path == Path("a")


def test_a_class_without_settings_takes_none():
    class Plain:
        pass

    assert isinstance(build(Plain, {}, "here"), Plain)
    with pytest.raises(SceneError, match=r"^here\.a: unknown key; allowed here: no keys at all$"):
        build(Plain, {"a": 1}, "here")


def test_an_annotation_no_scene_can_fill_blames_the_plugin():
    @dataclass(frozen=True)
    class Foreign:
        array: np.ndarray[Any, Any]

    with pytest.raises(PluginError, match=r"Foreign: field array is annotated .*ndarray.* plain types"):
        build(Foreign, {"array": [1.0]}, "here")


def test_the_table_is_left_alone():
    table = {"size": 1, "numbers": [1, 2], "weights": {"u": 1}}
    made = build(Everything, table, "here")
    assert table == {"size": 1, "numbers": [1, 2], "weights": {"u": 1}}
    assert made.weights is not table["weights"]


scalars = st.one_of(st.booleans(), st.integers(), st.floats(), st.text(max_size=5))
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
)


@given(st.sampled_from(list(Everything.__dataclass_fields__)), values)
def test_any_value_is_taken_or_refused_in_one_line(key, value):
    try:
        made = build(Everything, {"size": 1, key: value}, "here")
    except SceneError as error:
        message = str(error)
    else:
        got = getattr(made, key)
        assert isinstance(got, bool) == isinstance(value, bool)
        return
    assert message.startswith(f"here.{key}")
    assert len(message.splitlines()) == 1


class Undecorated:
    edge: float = 1.0


def test_a_setting_of_a_class_that_is_no_dataclass_says_what_is_missing():
    assert isinstance(build(Undecorated, {}, "scene: domain"), Undecorated)  # without settings it needs no decorator
    with pytest.raises(
        SceneError, match=r"domain\.edge: Undecorated has it, but is no dataclass; put @dataclass"
    ) as told:
        build(Undecorated, {"edge": 2.0}, "scene: domain")
    assert "\n" not in str(told.value)
    with pytest.raises(SceneError, match=r"domain\.size: unknown key"):
        build(Undecorated, {"size": 2.0}, "scene: domain")
