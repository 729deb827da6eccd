"""A library that is missing or broken is one line, and stops no other."""

import pytest

from dacore.plugins.registry import load
from tests.environment.processes import FAMILIES, SMALL, TOY, backends, dacore, python

SETTINGS = [part for change in SMALL for part in ("--set", change)]

HIDDEN = """
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in %r:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hidden())
"""

FAULTS = {
    "a native library is gone": (
        'raise ImportError("libpetsc_real.so.3.18: cannot open shared object file: No such file or directory")',
        "ImportError: libpetsc_real.so.3.18: cannot open shared object file",
    ),
    "compiled for another numpy": (
        'raise ValueError("numpy.dtype size changed, may indicate binary incompatibility. '
        'Expected 96 from C header, got 88 from PyObject")',
        "ValueError: numpy.dtype size changed",
    ),
    "fails in its own way": (
        'raise RuntimeError("MPI_Init failed\\n  on two lines")',
        "RuntimeError: MPI_Init failed on two lines",
    ),
    "another part of it is missing": ("import a_part_that_nobody_has", "No module named 'a_part_that_nobody_has'"),
    "cannot be read": ("def broken(:", "SyntaxError"),
}


def scene(command, name, out):
    return [command, TOY, *SETTINGS, "--set", f"discretization.backend={name}", "--out", out]


def one_error(done):
    """The one line that a run which stopped says."""
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


@pytest.mark.parametrize("command", ["plan", "run"])
@pytest.mark.parametrize("spec", load().specs("backend"), ids=lambda spec: spec.name)
def test_a_missing_library_is_one_line_that_says_what_to_install(spec, command, tmp_path):
    done = dacore(*scene(command, spec.name, tmp_path / "out"), before=HIDDEN % FAMILIES[spec.name])
    assert done.returncode == 2
    line = one_error(done)
    assert f"backend {spec.name!r} needs " in line
    assert line.endswith(f"install it with: {spec.install}")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", FAMILIES)
def test_plugins_says_what_is_missing_and_how_to_get_it(name):
    code = (
        "import sys\n" + HIDDEN % FAMILIES[name] + "from dacore.plugins.registry import load\n"
        f"row, = (r for r in load().table() if (r.kind, r.name) == ('backend', {name!r}))\n"
        "print(row.status, '|', row.install)"
    )
    done = python(code)
    assert done.returncode == 0, done.stderr
    status, install = done.stdout.strip().split(" | ")
    assert status.startswith("missing ")
    assert install


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", backends())
def test_a_broken_library_is_one_line_that_names_the_backend(name, fault, tmp_path):
    source, reason = FAULTS[fault]
    break_library(tmp_path, name, source)
    line = one_error(dacore(*scene("run", name, tmp_path / "out"), path=tmp_path))
    assert f"backend {name} could not be loaded" in line
    assert reason in line
    assert "choose another backend" in line


@pytest.mark.parametrize("name", backends())
def test_a_broken_library_stops_no_other(name, tmp_path):
    """Two are broken and the third runs: found, listed, built."""
    for other in set(FAMILIES) - {name}:
        break_library(tmp_path, other, FAULTS["a native library is gone"][0])
    assert dacore("plugins", path=tmp_path).returncode == 0
    code = (
        "import sys\nfrom dacore import open_scene\n"
        "changes = ['discretization.backend=' + sys.argv[2], *sys.argv[4:]]\n"
        "print(open_scene(sys.argv[1], changes, cache=sys.argv[3]).model.space.n_dofs)"
    )
    done = python(code, TOY, name, tmp_path / "cache", *SMALL, path=tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 100


def break_library(folder, name, source):
    """Put a library that fails at import before the real one."""
    package = folder / name
    package.mkdir()
    (package / "__init__.py").write_text(source + "\n")
    (package / "ser.py").write_text("")
