"""Check that one Python process can hold scikit-fem, DOLFINx and MFEM: one line for each problem, none if all is well.

Run by the Makefile with the environment's own interpreter, after the environment is made::

    .venv-all/bin/python tests/environment/check.py

Every finding is of a fresh process, so that no check decides for the next what was imported first.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, distribution, distributions
from itertools import permutations
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

LIBRARIES = {"skfem": "skfem", "dolfinx": "dolfinx", "mfem": "mfem.ser"}
"""What a backend imports, by the backend's name."""

FAST_BLAS = ("openblas", "mkl", "blis")

ORIGINS = """
import json, sys
from importlib import import_module
import h5py
made = {}
for name in ("numpy", "scipy", "h5py", "skfem", "mpi4py", "petsc4py", "dolfinx", "mfem"):
    made[name] = import_module(name).__file__
print(json.dumps(made))
"""

BLAS = """
import json
import numpy, scipy.linalg
import dolfinx, petsc4py.PETSc
from threadpoolctl import threadpool_info
print(json.dumps([each for each in threadpool_info() if each["user_api"] == "blas"]))
"""

HDF5 = """
import os, tempfile
import h5py
import dolfinx
import numpy as np
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, "a.h5")
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.arange(5.0), chunks=True, compression="gzip")
        file.attrs["unit"] = "cm"
    with h5py.File(path) as file:
        assert (file["x"][:] == np.arange(5.0)).all() and file.attrs["unit"] == "cm"
"""

PLUGINS = """
import json
from dacore.plugins.registry import load
print(json.dumps({row.name: row.status for row in load().table() if row.kind == "backend"}))
"""


class BrokenError(Exception):
    """A process that should have run did not; the text is its last line."""


def run(code: str, python: str = sys.executable, **variables: str) -> str:
    """Standard output of `code` in a fresh process; BrokenError if it fails."""
    command = [python, *(() if python == sys.executable else ("-I",)), "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **variables}, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise BrokenError(last)
    return done.stdout


def requirements() -> Iterator[str]:
    """Every declared dependency of dacore and its plugins is there, in a version that serves."""
    for found in distributions():
        name = found.metadata["Name"]
        if name != "dacore" and not name.startswith("dacore-"):
            continue
        for line in found.requires or ():
            needed = Requirement(line)
            extras = ("", "figures", "test") if name == "dacore" else ("",)
            if needed.marker and not any(needed.marker.evaluate({"extra": extra}) for extra in extras):
                continue
            try:
                has = distribution(needed.name).version
            except PackageNotFoundError:
                yield f"{name} needs {line}: not installed"
                continue
            if not needed.specifier.contains(has, prereleases=True):
                yield f"{name} needs {line}: got {has}"


def origins() -> Iterator[str]:
    """DOLFINx is the system's, MFEM is the environment's, and nothing comes from a third place."""
    paths = {name: Path(path).resolve() for name, path in json.loads(run(ORIGINS)).items()}
    here, system = Path(sys.prefix).resolve(), Path(sys.base_prefix).resolve()
    for name, path in paths.items():
        if name in ("mpi4py", "petsc4py", "dolfinx"):
            good, place = path.is_relative_to(system) and not path.is_relative_to(here), f"the system's ({system})"
        elif name == "mfem":
            good, place = path.is_relative_to(here), f"in {here}"
        else:
            good, place = path.is_relative_to(here) or path.is_relative_to(system), f"in {here} or {system}"
        if not good:
            yield f"{name} is {path}, expected {place}; is PYTHONPATH or PETSC_DIR set?"


def numpy_fits() -> Iterator[str]:
    """A library compiled for numpy 1 cannot run on numpy 2; a distribution compiles for the numpy it ships."""
    show = "import numpy; print(numpy.__version__)"
    own = run(show).strip()
    system = run(show, sys._base_executable).strip()  # type: ignore[attr-defined]
    if int(system.split(".")[0]) < 2 <= int(own.split(".")[0]):
        yield f"numpy is {own}, but the system's DOLFINx is compiled for numpy {system}; install numpy<2"


def blas() -> Iterator[str]:
    """Numpy, scipy and PETSc sit on a fast BLAS, and it keeps to one thread when told."""
    found: list[dict[str, Any]] = json.loads(run(BLAS, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1"))
    if not any(Path(each["filepath"]).resolve().is_relative_to("/usr") for each in found):
        yield "PETSc's BLAS was not found; install libopenblas0-pthread (the reference BLAS is ten times slower)"
    for each in found:
        if each["internal_api"] not in FAST_BLAS:
            yield f"{each['filepath']} is {each['internal_api']}, expected one of {', '.join(FAST_BLAS)}"
        elif each["num_threads"] != 1:
            yield f"{each['filepath']} runs {each['num_threads']} threads, though OPENBLAS_NUM_THREADS is 1"


def hdf5() -> Iterator[str]:
    """HDF5 files can be written and read beside DOLFINx, which brings an HDF5 of its own."""
    try:
        run(HDF5)
    except BrokenError as error:
        yield f"HDF5 after importing h5py, then dolfinx: {error}"


def orders() -> Iterator[str]:
    """The libraries share a process, whichever is imported first."""

    def attempt(order: tuple[str, ...]) -> str:
        try:
            run("import h5py, " + ", ".join(LIBRARIES[name] for name in order))
        except BrokenError as error:
            return f"importing {', then '.join(order)}: {error}"
        return ""

    with ThreadPoolExecutor(2) as pool:
        yield from filter(None, pool.map(attempt, permutations(LIBRARIES)))


def ready() -> Iterator[str]:
    """Every backend's plugin is declared and finds its library."""
    rows = json.loads(run(PLUGINS))
    for name in LIBRARIES:
        if rows.get(name) != "ready":
            yield f"backend {name} is {rows.get(name, 'not declared by any plugin')}, expected ready"


CHECKS = (requirements, numpy_fits, origins, blas, hdf5, orders, ready)


def problems() -> Iterator[str]:
    """What is wrong, a line each; a check that cannot be run is a problem too."""
    for check in CHECKS:
        try:
            yield from check()
        except BrokenError as error:
            yield f"{check.__name__}: {error}"


def main() -> int:
    """Print what is wrong, or what was found; 1 if anything is wrong."""
    wrong = list(problems())
    for line in wrong:
        print(f"environment: {line}", file=sys.stderr)
    if not wrong:
        names = ("numpy", "scipy", "h5py", "scikit-fem", "fenics-dolfinx", "petsc4py", "mfem")
        print("Checked: " + ", ".join(f"{name} {distribution(name).version}" for name in names))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
