"""What a backend is without a mesh: its name, its version, its making."""

import os
import pickle
import subprocess
import sys
from importlib import import_module
from typing import Any

from dacore.core.discretization import Backend
from dacore.plugins.registry import load
from dacore.testing.suite import fail, require


def made_without_arguments(backend: Backend) -> None:
    """The class is made without arguments and keeps no state, also not in use."""
    cls = type(backend)
    try:
        again = cls()
    except TypeError as error:
        fail(f"{cls.__name__}: cannot be made without arguments: {error}")
    again.version()
    kept = getattr(again, "__dict__", {})
    require(not kept, f"backend {again.name}: keeps {', '.join(kept)}; what depends on a mesh belongs to the assembler")


def named_as_declared(backend: Backend) -> None:
    """`name` is an identifier, and the one under which the plugin declares the class."""
    cls = type(backend)
    name: Any = getattr(backend, "name", None)
    good = isinstance(name, str) and name.isidentifier()
    require(good, f"{cls.__name__}: name is {name!r}, expected an identifier such as 'skfem'")
    target = f"{cls.__module__}:{cls.__qualname__}"
    declared = {spec.name: spec.target for spec in load().specs("backend")}
    for word, of in declared.items():
        if of == target:
            require(word == name, f"{cls.__name__}: name is {name!r}, but the plugin declares it as {word!r}")
        else:
            require(word != name, f"{cls.__name__}: name is {name!r}, which is the declared name of {of}")


def tells_its_version(backend: Backend) -> None:
    """`version` is a string that is not empty, the same each time."""
    version: Any = backend.version()
    good = isinstance(version, str) and bool(version.strip())
    require(good, f"backend {backend.name}: version() is {version!r}, expected the version of the library as a string")
    require(backend.version() == version, f"backend {backend.name}: version() changes from call to call")


def can_be_pickled(backend: Backend) -> None:
    """The backend itself can be pickled: discretisations are sent to worker processes."""
    try:
        copy = pickle.loads(pickle.dumps(backend))
    except Exception as error:  # noqa: BLE001  pickle raises many kinds
        fail(f"backend {backend.name}: cannot be pickled: {type(error).__name__}: {error}")
    require(type(copy) is type(backend), f"backend {backend.name}: the copy is a {type(copy).__name__}")


def the_library_is_loaded_late(backend: Backend) -> None:
    """Importing the module and making the backend loads dacore, numpy, scipy and the plugin's own package alone."""
    cls = type(backend)
    if cls.__module__ == "__main__" or import_module(cls.__module__).__dict__.get(cls.__name__) is not cls:
        fail(f"{cls.__name__}: is not a class of an importable module, so that its imports cannot be checked; move it")
    own = cls.__module__.partition(".")[0]
    # Whatever dacore loads is its own affair.
    code = (
        "import sys, importlib\n"
        "import dacore.testing, scipy.sparse.linalg\n"
        "before = set(sys.modules)\n"
        f"importlib.import_module({cls.__module__!r}).{cls.__qualname__}()\n"
        "print(*sorted({name.partition('.')[0] for name in set(sys.modules) - before}))\n"
    )
    path = os.pathsep.join(entry for entry in sys.path if entry)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    require(done.returncode == 0, f"backend {backend.name}: importing it fails: {done.stderr.strip()[-300:]}")
    allowed = {own, "dacore", "numpy", "scipy", *sys.stdlib_module_names}
    loaded = [name for name in done.stdout.split() if name not in allowed and not name.startswith("_")]
    require(
        not loaded,
        f"backend {backend.name}: importing {cls.__module__} loads {', '.join(loaded)}; import the library in "
        "assembler() and version(), so that processes that only solve never load it",
    )


CHECKS = (made_without_arguments, named_as_declared, tells_its_version, can_be_pickled, the_library_is_loaded_late)
