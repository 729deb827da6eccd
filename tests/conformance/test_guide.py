"""The plugin of docs/plugins.md is written as the page says, declared, passes the suites; the lists are complete."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from annotated_types import Gt

from dacore import testing
from dacore.core.discretization import Discretization
from dacore.errors import SceneError
from dacore.plugins import spec
from dacore.plugins.declarations import KINDS
from dacore.plugins.registry import BASES
from dacore.plugins.settings import EXPECTED, build
from dacore.scaffold import kinds as scaffold

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/plugins.md").read_text(encoding="utf-8")
# What is marked "py" is a file of the distribution; "python" is run as it stands.
FILES = dict(
    zip(
        (
            "__init__.py", "seepage.py", "test_seepage.py", "gauge.py", "test_gauge.py", "peak.py", "test_peak.py",
            "solver.py", "test_solver.py", "nearest.py", "test_nearest.py",
        ),
        re.findall(r"^```py\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL),
        strict=True,
    )
)  # fmt: skip
TOML = re.findall(r"^```TOML\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
PIECES = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The distribution of the page, its tests beside its package."""
    folder = tmp_path_factory.mktemp("dacore-gauge")
    _, toml = TOML
    (folder / "pyproject.toml").write_text(toml, encoding="utf-8")
    for name, text in FILES.items():
        place = folder / "tests" if name.startswith("test_") else folder / "src/dacore_gauge"
        place.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return folder


def run(package, *command):
    path = f"import sys; sys.path.insert(0, {str(package / 'src')!r}); "
    return subprocess.run([sys.executable, "-c", path + command[0]], capture_output=True, text=True, cwd=package)


def test_the_declarations_name_classes_that_are_there_and_the_door_takes_them(package):
    toml = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))
    assert toml["project"]["entry-points"][spec.GROUP] == {"dacore_gauge": "dacore_gauge"}
    done = run(
        package,
        "from importlib.metadata import EntryPoint; import dacore_gauge\n"
        "assert 'scipy.sparse' not in sys.modules\n"
        "from dacore.plugins.registry import load\n"
        "registry = load([EntryPoint('gauge', 'dacore_gauge', 'dacore')])\n"
        "assert not registry.failures, registry.failures\n"
        "print(*(registry.get(each.kind, each.spec.name).__name__ for each in registry.declarations))\n",
    )
    assert sorted(done.stdout.split()) == sorted(
        ["Seepage", "AtPoint", "StrainGauge", "MinimalResiduals", "Nearest"]
    ), done.stderr


@pytest.mark.parametrize(
    ("name", "least"),
    [("seepage", 16), ("gauge", 14), ("peak", 15), ("solver", 15), ("nearest", 24)],
)
def test_the_tests_of_the_page_pass(package, name, least):
    done = run(
        package, f"import pytest; sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', 'tests/test_{name}.py']))"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= least
    assert "skipped" not in done.stdout


def test_the_scene_with_a_plugin_file_is_that_of_the_example():
    example = (ROOT / "examples/epidemic/epidemic.toml").read_text(encoding="utf-8")
    shown, whole = tomllib.loads(TOML[0]), tomllib.loads(example)
    assert shown == {key: whole[key] for key in shown}
    assert "plugins" in shown


def test_the_pieces_of_a_model_a_domain_and_a_backend_are_right(package):
    fields, domain, block, study = PIECES
    for piece in (fields, domain, block):
        done = run(package, "\n" + piece)
        assert done.returncode == 0, done.stderr
    done = run(package, f"\n{study}\nprint(*(spec.name for spec in dacore_studies()))")
    assert done.stdout.split() == ["dropout"], done.stderr


def section(heading):
    return re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]


def rows(text):
    cells = [re.split(r"(?<!\\)\|", line.strip("|\n")) for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip().replace(r"\|", "|") for cell in row] for row in cells]


def test_every_hook_is_documented_with_its_base_class_and_its_suite():
    found = {row[0].strip("`"): row for row in rows(section("The nine hooks")) if row[0].startswith("`dacore_")}
    assert set(found) == set(spec.HOOKS)
    assert len(spec.HOOKS) == 9, "the heading counts them"
    suites = {name for name in testing.__all__ if name.endswith("_suite")}
    for kind, hook in KINDS.items():
        _, _, base, suite = found[hook]
        assert base == f"`{BASES[kind].replace(':', '.')}`"
        if f"{kind}_suite" in suites:
            assert suite == f"`{kind}_suite`"
            suites.discard(f"{kind}_suite")
        else:
            assert suite.startswith("none: ")
    assert suites == {"space_suite"}, "a suite that no hook's row names"
    assert "`space_suite`" in PAGE


def test_every_form_that_a_physics_may_ask_for_is_listed():
    members = {name for name in vars(Discretization) if not name.startswith("_")} - {"release"}
    members |= {"mesh", "layout"}
    listed = {name for row in rows(section("A PDE")) for name in re.findall(r"`(?:layout\.|mesh\.)?(\w+)", row[0])}
    assert members - {"backend", "fields"} <= listed


def test_every_kind_has_a_section_and_a_template():
    headings = " ".join(re.findall(r"^## (.*)$", PAGE, re.MULTILINE))
    words = {
        "model": "A PDE", "quantity": "A number of interest", "format": "A file format", "solver": "A linear solver",
        "backend": "A finite element backend", "observation": "An observation", "estimator": "An estimator",
    }  # fmt: skip
    for kind in KINDS:
        assert words.get(kind, f"A {kind}") in headings
    templates = {row[0].strip("`") for row in rows(section("Begin with `dacore new-plugin`"))[2:]}
    assert templates == set(scaffold.KINDS)


def test_every_field_of_a_declaration_is_documented():
    text = section("The nine hooks")
    found = [row[0].strip("`") for row in rows(text[text.index("| field |") :])[2:]]
    assert found == list(spec.PluginSpec.__dataclass_fields__)
    assert f"`PluginSpec({', '.join(found)})`" in text


@dataclass(frozen=True)
class Inner:
    width: float


NAMES = {"Path": Path, "Literal": Literal, "Mapping": Mapping, "Annotated": Annotated, "Gt": Gt, "Inner": Inner}
SETTINGS = rows(section("Settings"))[2:]


@pytest.mark.parametrize("row", SETTINGS, ids=lambda row: row[0])
def test_each_kind_of_setting_takes_and_refuses_what_the_page_says(row):
    annotation, taken, refused = row
    hint = eval(re.match(r"`(.*?)`", annotation)[1], dict(NAMES))
    cls = make_dataclass("Settings", [("key", hint)], frozen=True)
    for example in re.findall(r"`(.*?)`", taken):
        assert build(cls, tomllib.loads(f"key = {example}"), "scene").key is not None
    for example in re.findall(r"`(.*?)`", refused):
        with pytest.raises(SceneError, match=r"scene\.key") as told:
            build(cls, tomllib.loads(f"key = {example}"), "scene")
        assert "\n" not in str(told.value)


def test_no_kind_of_setting_is_left_out():
    """Every kind of value that messages have a word for, and everything that settings are made of."""
    text = " ".join(row[0] for row in SETTINGS)
    of = {"bool_type": "bool", "dict_type": "Mapping", "mapping_type": "Mapping", "finite_number": "float",
          "float_type": "float", "frozen_set_type": "frozenset", "set_type": "frozenset", "int_type": "int",
          "list_type": "list", "none_required": "None", "path_type": "Path", "string_type": "str",
          "tuple_type": "tuple"}  # fmt: skip
    assert set(of) == set(EXPECTED)
    for word in {*of.values(), "Literal", "Annotated", "Inner", "tuple[str, ...]", "|"}:
        assert word in text, word
