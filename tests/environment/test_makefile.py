"""Which environment a target uses, and that the demo's has nothing of the system's in it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.environment.processes import LIBRARIES, ROOT

DEMO = {"dacore-skfem", "dacore-biot", "dacore-imaging"}
PLUGINS = {path.parent.name for path in ROOT.glob("plugins/*/pyproject.toml")}


def make(*arguments, cwd=ROOT):
    """Run make as from a terminal: without what an outer make, which may have started this test, passes on."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    environment |= {"PYTHONPATH": "/somewhere", "PETSC_DIR": "/elsewhere", "PYTHONNOUSERSITE": ""}
    for name in ("REQUIRE", "WORKERS", "PYTHON"):
        environment.pop(name, None)
    return subprocess.run(
        ["make", "--no-print-directory", *map(str, arguments)], capture_output=True, text=True, cwd=cwd,
        env=environment, check=False,
    )  # fmt: skip


@pytest.fixture
def clone(tmp_path):
    """What make looks at, in a place without environments."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    for file in (ROOT / "pyproject.toml", *ROOT.glob("plugins/*/pyproject.toml"), *ROOT.glob("tests/environment/*.*")):
        target = tmp_path / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)
    return tmp_path


def plan(clone, *arguments):
    done = make("-n", *arguments, cwd=clone)
    assert done.returncode == 0, done.stderr
    return done.stdout


def installs(lines):
    """Into which environments pip would install."""
    return {words[0].split("/")[0] for words in map(str.split, lines.splitlines()) if {"pip", "install"} <= set(words)}


def test_the_demo_needs_nothing_of_the_system(clone):
    lines = plan(clone, "demo")
    for word in ("system", "apt-get", ".venv-all", *LIBRARIES - {"skfem"}, *PLUGINS - DEMO):
        assert word not in lines, word
    for name in DEMO:
        assert f"-e ./plugins/{name}" in lines


def test_the_demos_environment_sees_no_system_package(clone):
    done = make(".venv-made", cwd=clone)
    assert done.returncode == 0, done.stderr
    assert "include-system-site-packages = false" in (clone / ".venv" / "pyvenv.cfg").read_text()
    code = f"from importlib.util import find_spec; print([n for n in {sorted(LIBRARIES)} if find_spec(n)])"
    found = subprocess.run([clone / ".venv/bin/python", "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"


def test_check_has_every_plugin_and_no_library_of_the_others(clone):
    lines = plan(clone, "check")
    assert ".venv-all" not in lines
    without = next(line for line in lines.splitlines() if "--no-deps" in line)
    assert {word.rpartition("/")[2] for word in without.split() if word.startswith("./")} == PLUGINS - DEMO


@pytest.mark.parametrize("target", ["test", "slow", "bench"])
def test_tests_run_where_all_three_libraries_are(clone, target):
    lines = plan(clone, target)
    assert "DACORE_REQUIRE=skfem,dolfinx,mfem .venv-all/bin/python -m pytest" in lines
    for name in PLUGINS:
        assert f"-e ./plugins/{name}" in lines
    alone = plan(clone, target, "REQUIRE=skfem")
    assert "DACORE_REQUIRE=skfem .venv/bin/python -m pytest" in alone
    assert ".venv-all" not in alone


def test_nothing_is_made_twice_and_a_changed_project_is_installed_again(clone):
    """Stamps are written as the recipes would: then make has nothing to do until a pyproject.toml changes."""
    for stamp in (".venv/.demo", ".venv/.dev", ".venv-all/.dev"):
        (clone / stamp).parent.mkdir(exist_ok=True)
        (clone / stamp).touch()
    assert installs(plan(clone, "check", "test", "demo")) == set()
    future = (clone / ".venv-all/.dev").stat().st_mtime + 10
    for name in sorted(PLUGINS):
        file = clone / "plugins" / name / "pyproject.toml"
        before = file.stat().st_mtime
        os.utime(file, (future, future))
        assert installs(plan(clone, "check")) == {".venv"}
        assert installs(plan(clone, "test")) == {".venv-all"}
        assert installs(plan(clone, "demo")) == ({".venv"} if name in DEMO else set()), name
        os.utime(file, (before, before))


def test_what_lies_elsewhere_on_the_machine_does_not_count(clone):
    (clone / "show.mk").write_text("include Makefile\nshow:\n\t@env\n")
    lines = make("-f", "show.mk", "show", cwd=clone).stdout.splitlines()
    assert "PYTHONNOUSERSITE=1" in lines
    assert not [line for line in lines if line.startswith(("PYTHONPATH=", "PETSC_DIR=", "PYTHONHOME="))]


def test_a_system_that_cannot_serve_stops_make_in_one_line(clone):
    """No stamp is left, so the next make tries again."""
    python = Path(sys.executable).parent / "no-such-python"
    tools = clone / "tools"
    tools.mkdir()
    for name in ("make", "sh", "sed", "id", "mktemp"):
        (tools / name).symlink_to(shutil.which(name))
    done = subprocess.run(
        ["make", "--no-print-directory", "test", f"SYSTEM_PYTHON={python}"], cwd=clone, capture_output=True,
        text=True, env={"PATH": str(tools)}, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    first, last = done.stderr.splitlines()
    assert first.startswith(f"there is no {python}, and there is no apt-get")
    assert first.endswith("make test REQUIRE=skfem")
    assert last.startswith("make: ***")
    assert not (clone / ".venv-all" / ".dev").exists()
