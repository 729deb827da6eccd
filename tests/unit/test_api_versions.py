"""Versions of the plugin interface: what was written for an older one runs, what wants a newer one is told so."""

import json
import os
import subprocess
import sys
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest

from dacore.plugins import API_VERSION, PluginSpec
from dacore.plugins.api import refused, text_of
from dacore.plugins.registry import load
from dacore.plugins.spec import HOOKS
from tests.api_record import MODULES, added, lost, record

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests/data"
OLD = json.loads((DATA / "api-1.0.json").read_text(encoding="utf-8"))
# Classes that plugins derive from, and values that they fill: what is new in one of them, an author must learn.
OF_AUTHORS = {
    "PluginSpec", "Backend", "Assembler", "Domain", "Physics", "ForwardModel", "AffineModel", "AffineTerm", "Load",
    "ObservationOperator", "Functionals", "QuantityOfInterest", "Estimator", "PreparedEstimator", "SolverMethod",
    "LinearSolver", "CorrectingSolver", "StateSpace", "Study", "Parameter", "Field",
}  # fmt: skip


def points(folder):
    found = [point for info in sorted(folder.glob("*.dist-info")) for point in PathDistribution(info).entry_points]
    assert found
    return found


def python(folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment)


def test_a_plugin_of_interface_1_0_runs_from_its_scene(tmp_path):
    """Every kind of plugin there was, in one distribution that nobody has touched since."""
    folder = DATA / "api_1_0"
    command = "from dacore.cli.main import main; main()"
    done = python(folder, "-c", command, "run", str(folder / "scene.toml"), "--out", str(tmp_path), "--workers", "1")
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["versions"]["dacore-bar"] == "0.3"
    errors = {o["estimator"]: o["errors"]["T"] for o in results["validation"] if o["noise"] == 0.0}
    for name in ("nearest", "minimum_variance"):
        assert errors[name]["mean"] < errors[name]["of_the_training_mean"]
    assert set(results["studies"]) == {"samples"}
    listed = python(folder, "-c", command, "plugins")
    assert "failed" not in listed.stdout
    assert listed.stdout.count("bar_") + listed.stdout.count(" bar ") >= 8


def test_its_whole_number_for_a_version_is_deprecated_where_it_stands():
    code = "import dacore_bar; specs = dacore_bar.dacore_models() + dacore_bar.dacore_observations()"
    done = python(DATA / "api_1_0", "-W", "always::DeprecationWarning", "-c", code)
    assert done.returncode == 0
    told = [line for line in done.stderr.splitlines() if "DeprecationWarning" in line]
    assert len(told) == 2
    assert "dacore_bar/__init__.py:14:" in told[0]
    assert "api = 1, a whole number is deprecated since plugin interface 1.1" in told[0]
    assert told[0].endswith('use api = "1.0"')


def test_plugins_of_later_interfaces_are_refused_and_stop_nobody(monkeypatch):
    monkeypatch.syspath_prepend(DATA / "api_2_0")
    registry = load(points(DATA / "api_2_0"))
    here = ".".join(map(str, API_VERSION))
    reasons = {(each.kind, each.name, each.source.distribution): each.reason for each in registry.failures}
    for kind, name, version in (("model", "later", "2.0"), ("domain", "soon", "1.99")):
        reason = f"written for plugin interface {version}, this dacore has {here}; update dacore"
        assert reasons[kind, name, "dacore-later"] == reason
    late = reasons["", "", "dacore-later2"]
    assert late.startswith("could not be loaded: ImportError: cannot import name 'Extension' from 'dacore.plugins'")
    assert late.endswith(f"it wants another plugin interface than {here}: update the older of the two")
    assert registry.declarations == ()


@pytest.mark.parametrize(
    ("api", "why"),
    [
        ("1.0", ""),
        (1, ""),
        (API_VERSION, ""),
        (f"1.{API_VERSION[1]}", ""),
        (f"1.{API_VERSION[1] + 1}", "update dacore"),
        ("2.0", "update dacore"),
        (99, "written for plugin interface 99.0"),
        ("0.9", "is not compatible; update the plugin"),
        ("1", "api: got '1', expected the version of the plugin interface as text"),
        ("1.x", "api: got '1.x'"),
        (1.0, "api: got 1.0"),
        (True, "api: got True"),
        (None, "api: got None"),
        ((1, 2, 3), "api: got (1, 2, 3)"),
    ],
)
def test_what_is_understood(api, why):
    reason = refused(api)
    assert "\n" not in reason
    assert why in reason
    assert bool(reason) == bool(why)


def test_saying_nothing_claims_the_least_of_this_major_version():
    assert text_of(PluginSpec("x", "a:B").api) == f"{API_VERSION[0]}.0"


def test_all_of_interface_1_0_is_there_still():
    """A minor version adds: nothing goes, no method wants more, and no class leaves more to its subclasses."""
    now = json.loads(json.dumps(record([*OLD], broad=True)))
    assert lost(OLD, now) == []


def test_the_record_finds_what_would_break_a_plugin():
    now = json.loads(json.dumps(record([*OLD], broad=True)))
    space, load = now["dacore.core.space"]["StateSpace"], now["dacore.core.model"]["Load"]
    del space["members"]["place"]
    space["abstract"].append("cells")
    load["call"].append(["extra", "POSITIONAL_OR_KEYWORD", False])
    load["call"][0][0] = "title"
    del now["dacore.errors"]["ShapeError"]
    found = "\n".join(lost(OLD, now))
    for each in ("StateSpace.place is gone", "StateSpace.cells is abstract", "Load wants extra", "Load takes no name",
                 "dacore.errors.ShapeError is gone"):  # fmt: skip
        assert each in found


def test_what_came_since_is_told_on_the_page_of_versions():
    page = (ROOT / "docs/versions.md").read_text(encoding="utf-8")
    new = [f"{name}.{each}" for name, each in added(OLD, record([*OLD])) if name in OF_AUTHORS]
    new += [hook for hook in HOOKS if hook not in OLD["dacore.plugins.spec"]["Hooks"]["members"]]
    assert not new or API_VERSION > (1, 0)
    untold = [each for each in new if f"`{each}`" not in page]
    assert not untold, f"docs/versions.md, What each version added: name {', '.join(untold)}"


def test_the_page_of_versions_says_what_is_public_and_which_version_this_is():
    page = (ROOT / "docs/versions.md").read_text(encoding="utf-8")
    assert f"is {'.'.join(map(str, API_VERSION))}" in page
    for module in MODULES:
        assert f"`{module}`" in page, module
