"""The project's frame: what a run of the tests demands, and what make says on a machine that lacks something."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(command: list[str], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS", "PYTEST"))}
    return subprocess.run(
        command, cwd=folder, env={**inherited, **environment}, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize(("required", "code"), [("", 0), ("no_such_backend", 4)])
def test_a_required_backend_that_is_missing_fails_the_run(required, code):
    command = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/unit/test_frame.py",
    ]
    result = run(command, ROOT, DACORE_REQUIRE=required)
    assert result.returncode == code
    assert (
        "DACORE_REQUIRE names no_such_backend: backend 'no_such_backend' is not installed" in result.stderr
    ) == bool(code)


@pytest.fixture
def machine(tmp_path):
    """An empty checkout and a folder of commands that hold only what a test puts there, beside the shell's own."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    shutil.copy(ROOT / "Makefile", tmp_path)
    commands = tmp_path / "commands"
    commands.mkdir()
    for name in ("make", "sh", "rm", "touch"):
        (commands / name).symlink_to(shutil.which(name))
    return tmp_path


def install_python(machine: Path, name: str, tampering: str) -> None:
    """A Python whose ``-c`` first runs `tampering`, and whose ``-m venv`` only writes down that it was called."""
    script = machine / "commands" / name
    script.write_text(
        "#!/bin/sh\n"
        f'if [ "$1" = -c ]; then exec {sys.executable} -c "import sys\n{tampering}\n$2"; fi\n'
        f'echo "{name} $*" >> calls\n'
    )
    script.chmod(script.stat().st_mode | stat.S_IXUSR)


def make_environment(machine: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run(["make", ".venv-made", *arguments], machine, PATH=str(machine / "commands"))


NO_VENV = "sys.modules['ensurepip'] = None"
TOO_OLD = "sys.version_info = (3, 9, 2)"


def test_no_python_at_all(machine):
    result = make_environment(machine)
    assert result.returncode != 0
    assert "No Python >= 3.11 among: python3.13 python3.12 python3.11 python3" in result.stderr


def test_a_python_that_is_too_old(machine):
    install_python(machine, "python3", TOO_OLD)
    assert "No Python >= 3.11" in make_environment(machine).stderr
    result = make_environment(machine, "PYTHON=python3")
    assert result.returncode != 0
    assert "is Python 3.9; dacore needs 3.11 or newer" in result.stderr


def test_a_python_without_venv(machine):
    install_python(machine, "python3", NO_VENV)
    for arguments in ((), ("PYTHON=python3",)):
        result = make_environment(machine, *arguments)
        assert result.returncode != 0
        assert "sudo apt install python3-venv" in result.stderr
        assert not (machine / "calls").exists()


def test_the_first_python_that_can_do_it_is_taken(machine):
    install_python(machine, "python3.13", "sys.exit(127)")  # a shim of a version manager, with nothing behind it
    install_python(machine, "python3.12", NO_VENV)
    install_python(machine, "python3.11", "")
    install_python(machine, "python3", TOO_OLD)
    result = make_environment(machine)
    assert result.returncode == 0, result.stderr
    assert (machine / "calls").read_text().splitlines()[-1] == "python3.11 -m venv --clear .venv"


def test_a_python_that_cannot_be_run(machine):
    result = make_environment(machine, "PYTHON=/no/such/python")
    assert result.returncode != 0
    assert "PYTHON=/no/such/python cannot be run" in result.stderr


def test_help_lists_every_target(machine):
    for name in ("sed", "awk"):
        (machine / "commands" / name).symlink_to(shutil.which(name))
    listed = [line.split()[1] for line in run(["make"], machine, PATH=str(machine / "commands")).stdout.splitlines()]
    phony = next(line for line in (ROOT / "Makefile").read_text().splitlines() if line.startswith(".PHONY: help"))
    assert sorted(listed) == sorted(phony.split()[1:])
