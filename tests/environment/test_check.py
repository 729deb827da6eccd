"""The check of the environment finds what it is there for, one line each."""

import json
import sys
from types import SimpleNamespace

import pytest

from tests.environment import check
from tests.environment.processes import ROOT, python


def answers(monkeypatch, **given):
    """Replace the processes that a check would start by their output, under the name of the code they run."""
    output = {getattr(check, name): text for name, text in given.items()}
    monkeypatch.setattr(check, "run", lambda code, **_: output[code])


@pytest.mark.parametrize(
    ("own", "system", "fits"),
    [("1.26.4", "1.24.2", True), ("2.4.0", "1.24.2", False), ("2.4.0", "2.2.4", True), ("1.26.4", "2.2.4", True)],
)
def test_numpy_2_does_not_fit_a_system_of_numpy_1(monkeypatch, own, system, fits):
    monkeypatch.setattr(sys, "_base_executable", "/usr/bin/python3")
    numpys = {sys.executable: own, "/usr/bin/python3": system}
    monkeypatch.setattr(check, "run", lambda code, python=sys.executable: numpys[python])
    lines = list(check.numpy_fits())
    assert lines == ([] if fits else [f"numpy is {own}, but the system's DOLFINx is compiled for numpy {system}; "
                                      "install numpy<2"])  # fmt: skip


def test_a_slow_blas_and_one_with_threads_of_its_own_are_found(monkeypatch):
    def library(path, api, threads):
        return {"filepath": path, "internal_api": api, "num_threads": threads}

    good = [library(f"{sys.prefix}/a.so", "openblas", 1), library("/usr/lib/b.so", "openblas", 1)]
    answers(monkeypatch, BLAS=json.dumps(good))
    assert list(check.blas()) == []
    answers(monkeypatch, BLAS=json.dumps([good[0], library("/usr/lib/b.so", "openblas", 4)]))
    assert list(check.blas()) == ["/usr/lib/b.so runs 4 threads, though OPENBLAS_NUM_THREADS is 1"]
    answers(monkeypatch, BLAS=json.dumps([good[0], library("/usr/lib/b.so", "reference", 1)]))
    assert list(check.blas()) == ["/usr/lib/b.so is reference, expected one of openblas, mkl, blis"]
    answers(monkeypatch, BLAS=json.dumps(good[:1]))
    (line,) = check.blas()
    assert line.startswith("PETSc's BLAS was not found; install libopenblas0-pthread")


def test_libraries_from_another_place_are_found(monkeypatch):
    here, system = sys.prefix, sys.base_prefix
    paths = dict.fromkeys(("numpy", "scipy", "h5py", "skfem", "mfem"), f"{here}/x.py")
    paths |= dict.fromkeys(("mpi4py", "petsc4py", "dolfinx"), f"{system}/lib/x.py")
    answers(monkeypatch, ORIGINS=json.dumps(paths))
    assert list(check.origins()) == []
    for name, path in (("mfem", "/home/me/.local/x.py"), ("dolfinx", f"{here}/x.py"), ("numpy", "/opt/x.py")):
        answers(monkeypatch, ORIGINS=json.dumps(paths | {name: path}))
        (line,) = check.origins()
        assert line.startswith(f"{name} is {path}, expected ")


def test_a_backend_that_is_not_ready_is_found(monkeypatch):
    answers(monkeypatch, PLUGINS=json.dumps({"skfem": "ready", "dolfinx": "missing dolfinx"}))
    assert list(check.ready()) == [
        "backend dolfinx is missing dolfinx, expected ready",
        "backend mfem is not declared by any plugin, expected ready",
    ]


def test_a_requirement_that_is_not_met_is_found(monkeypatch):
    needs = [
        "numpy>=99",
        "no-such-package",
        "scipy>=1",
        "matplotlib>=99; extra == 'figures'",
        "mypy>=99; extra == 'dev'",
    ]
    found = SimpleNamespace(metadata={"Name": "dacore"}, requires=needs)
    stranger = SimpleNamespace(metadata={"Name": "mfem"}, requires=["numba"])
    monkeypatch.setattr(check, "distributions", lambda: [found, stranger])
    lines = list(check.requirements())
    assert lines[0].startswith("dacore needs numpy>=99: got ")
    assert lines[1] == "dacore needs no-such-package: not installed"
    assert lines[2].startswith("dacore needs matplotlib>=99; extra == 'figures': got ")
    assert len(lines) == 3


def test_the_whole_check_on_a_broken_library_says_a_line_for_each_finding(tmp_path):
    (tmp_path / "mfem").mkdir()
    (tmp_path / "mfem/__init__.py").write_text("raise ImportError('libmfem.so: cannot open shared object file')\n")
    done = python((ROOT / "tests/environment/check.py").read_text(encoding="utf-8"), path=tmp_path)
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert all(line.startswith("environment: ") for line in lines), done.stderr
    orders = [line for line in lines if line.startswith("environment: importing ")]
    assert len(orders) == 6
    before_dolfinx = [line for line in orders if line.index("mfem") < line.index("dolfinx")]
    assert len(before_dolfinx) == 3
    assert all(line.endswith("ImportError: libmfem.so: cannot open shared object file") for line in before_dolfinx)
