"""The system's packages are installed only when something is missing, as root only, and failures are one line."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "system.sh"
PACKAGES = "python3-dolfinx python3-venv libopenblas0-pthread"
LACKS = "/usr/bin/python3 cannot import dolfinx (ModuleNotFoundError: No module named 'dolfinx')"
NEEDED = ("cat", "env", "grep", "mktemp", "rm", "tail", "touch", "true", "sh")


class Machine:
    """A folder that is the whole PATH: real small tools, and stand-ins for those that would change a system."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.calls = folder / "calls"
        for name in NEEDED:
            (folder / name).symlink_to(shutil.which(name))
        self.tool("python3", f'[ -e {folder}/installed ] || echo "lacking: {LACKS}"')
        self.tool("id", "echo 0")

    def tool(self, name: str, script: str) -> None:
        file = self.folder / name
        file.write_text(f"#!/bin/sh\n{script}\n")
        file.chmod(0o755)

    def apt(self, script: str) -> None:
        self.tool("apt-get", f'echo "$DEBIAN_FRONTEND $*" >>{self.calls}\n{script}')

    def run(self) -> subprocess.CompletedProcess[str]:
        environment = {"PATH": str(self.folder), "TMPDIR": str(self.folder)}
        return subprocess.run(
            [self.folder / "sh", SCRIPT, self.folder / "python3"], env=environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, check=False,
        )  # fmt: skip

    def apt_calls(self) -> list[str]:
        return self.calls.read_text().splitlines() if self.calls.exists() else []


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def refused(done):
    """Return the one line of a refusal, which names a way that always works."""
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.endswith("; the tests run without DOLFINx and MFEM by: make test REQUIRE=skfem\n")
    return done.stderr


INSTALLS = 'case "$*" in *" install "*) touch "${0%/*}/installed";; esac'


def test_nothing_is_done_where_all_is_there(machine):
    machine.tool("python3", "exit 0")
    machine.apt("exit 1")
    done = machine.run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert machine.apt_calls() == []


@pytest.mark.parametrize("root", [True, False], ids=["root", "sudo"])
def test_packages_are_installed_by_root_or_by_sudo(machine, root):
    machine.apt(INSTALLS)
    if not root:
        machine.tool("id", "echo 1000")
        machine.tool("sudo", f'echo sudo >>{machine.calls}\n[ "$1" = -n ] && shift\nexec "$@"')
    done = machine.run()
    assert done.returncode == 0, done.stderr
    assert LACKS in done.stdout
    update, install = (call for call in machine.apt_calls() if call != "sudo")
    assert update.startswith("noninteractive ")
    assert update.endswith(" update")
    assert install.startswith("noninteractive ")
    assert install.endswith(f" install --no-install-recommends {PACKAGES}")
    assert machine.apt_calls().count("sudo") == (0 if root else 3), "asked once, used twice"
    assert not list(machine.folder.glob("tmp.*")), "the log stayed"


@pytest.mark.parametrize("sudo", [None, "exit 1"], ids=["no sudo", "sudo wants a password and there is no terminal"])
def test_neither_root_nor_sudo(machine, sudo):
    machine.apt("exit 1")
    machine.tool("id", "echo 1000")
    if sudo:
        machine.tool("sudo", sudo)
    line = refused(machine.run())
    assert f"only root can install it: ask for apt-get install --no-install-recommends {PACKAGES}" in line
    assert machine.apt_calls() == []


def test_no_apt(machine):
    line = refused(machine.run())
    assert line.startswith(f"{LACKS}, and there is no apt-get")
    assert PACKAGES in line


def test_no_system_python_and_no_apt(machine):
    (machine.folder / "python3").unlink()
    assert refused(machine.run()).startswith(f"there is no {machine.folder}/python3, and there is no apt-get")


def test_python_too_old_is_not_mended_by_packages(machine):
    machine.tool("python3", 'echo "lacking: /usr/bin/python3 is Python 3.10, dacore needs 3.11 or newer"')
    machine.apt("exit 1")
    assert "is Python 3.10" in refused(machine.run())
    assert machine.apt_calls() == []


def test_an_import_that_ends_the_process_is_quoted(machine):
    """MPI does so if it cannot start; a warning before it is not the reason."""
    machine.tool("python3", 'echo "a warning" >&2\necho "Local abort before MPI_INIT completed" >&2\necho >&2\nexit 1')
    line = refused(machine.run())
    assert "python3 ended while it imported DOLFINx (Local abort before MPI_INIT completed), and there is no" in line


def test_a_warning_is_no_problem(machine):
    machine.tool("python3", 'echo "a warning" >&2')
    done = machine.run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_apt_fails(machine):
    machine.apt('case "$*" in *" install "*) echo "E: Unable to locate package python3-dolfinx"; exit 100;; esac')
    done = machine.run()
    assert done.returncode == 1
    reason, line = done.stderr.splitlines()
    assert reason == "E: Unable to locate package python3-dolfinx"
    assert line.startswith(f"apt-get could not install {PACKAGES}; ")


def test_an_update_that_fails_is_said_and_the_packages_are_tried(machine):
    machine.apt(INSTALLS + '\ncase "$*" in *update) echo "W: ignored"; exit 100;; esac')
    done = machine.run()
    assert done.returncode == 0
    assert done.stderr == "apt-get update: W: ignored\n"


def test_packages_that_do_not_help(machine):
    machine.apt("exit 0")
    assert refused(machine.run()).startswith(f"{PACKAGES} are installed, but {LACKS}; ")


def test_the_probe_itself(tmp_path):
    """On a Python without DOLFINx, the real probe names what cannot be imported."""
    environment = {**os.environ, "PATH": str(tmp_path)}
    bare = tmp_path / "bare"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", bare], check=True)
    done = subprocess.run(
        ["/bin/sh", SCRIPT, bare / "bin" / "python"], env=environment, capture_output=True, text=True, check=False
    )
    line = refused(done)
    assert f"{bare}/bin/python cannot import numpy (ModuleNotFoundError: No module named 'numpy')" in line
