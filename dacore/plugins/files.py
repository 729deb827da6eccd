"""Plugin files that a scene names: their hooks count for this scene alone, and nothing is installed.

A file becomes a module of a name that holds a hash of its path and content, so that files of one name, and versions
of one file, live side by side in a process. Its classes are pickled by value, so that worker processes need not
find the file. Why so is in docs/adr/0017-plugin-files-of-a-scene.md.
"""

import hashlib
import re
import sys
import traceback
from collections.abc import Iterable
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from dacore.errors import PluginError
from dacore.plugins.declarations import Declaration, Failure, Source, declared, one_line
from dacore.plugins.modules import available
from dacore.plugins.registry import Registry
from dacore.plugins.versions import know_source


def import_file(path: str | Path) -> ModuleType:
    """Import a plugin file as a scene does; the same content at the same place is the same module.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    PluginError
        If the file is missing or fails; one line with the number of the line that fails.
    """
    module, _ = _loaded(Path(path))
    return module


def located(files: Iterable[str], base: Path) -> list[tuple[str, Path]]:
    """Return what a scene calls its plugin files, and where they are.

    Parameters
    ----------
    files : iterable of str
        Paths as the scene has them.
    base : Path
        Folder of the scene.
    """
    return [(each, base / Path(each).expanduser()) for each in files]


def with_files(registry: Registry, files: Iterable[tuple[str, Path]]) -> Registry:
    """Return a registry that has what plugin files declare, too.

    Parameters
    ----------
    registry : Registry
        What is installed.
    files : iterable of (str, Path)
        What to call each file, and where it is.

    Returns
    -------
    Registry
        What is wrong with a file is among its failures, whose `Source.file` is True; none is raised.
    """
    declarations, failures = list(registry.declarations), list(registry.failures)
    seen: set[Path] = set()
    for shown, path in files:
        if path.resolve() in seen:
            failures.append(Failure(Source(shown, "", str(path), file=True), "is named twice; name it once"))
            continue
        seen.add(path.resolve())
        good, bad = _read(shown, path)
        failures += bad
        for each in good:
            if owner := _owner(each, declarations, failures):
                reason = f"{each.kind} {each.spec.name!r} is declared by {owner} already; give it another name here"
                failures.append(Failure(each.source, reason, each.kind, each.spec.name))
            else:
                declarations.append(each)
    return Registry(tuple(declarations), tuple(failures))


def check_files(registry: Registry) -> None:
    """Raise PluginError with the first thing that is wrong in a plugin file: a scene that names it needs all of it."""
    for failure in registry.failures:
        if failure.source.file:
            raise PluginError(str(failure))


def _owner(found: Declaration, others: list[Declaration], failures: list[Failure]) -> str:
    for each in others:
        if (each.kind, each.spec.name) == (found.kind, found.spec.name):
            return str(each.source)
    for broken in failures:  # installed twice, or for another interface: it has the name all the same
        if (broken.kind, broken.name) == (found.kind, found.spec.name):
            return str(broken.source)
    return ""


def _read(shown: str, path: Path) -> tuple[list[Declaration], list[Failure]]:
    source = Source(shown, "", str(path), file=True)
    try:
        module, digest = _loaded(path)
    except PluginError as error:
        return [], [Failure(source, str(error))]
    good, bad = declared(module, replace(source, digest=digest))
    out = []
    for each in good:
        where, _, attribute = each.spec.target.partition(":")
        if where in (path.stem, module.__name__):
            if not hasattr(module, attribute):
                reason = f"target: the file has no {attribute}; expected the name of the class that it declares"
                bad.append(Failure(each.source, reason, each.kind, each.spec.name))
                continue
            each = replace(each, spec=replace(each.spec, target=f"{module.__name__}:{attribute}"))
        out.append(each)
    return out, bad


def _loaded(path: Path) -> tuple[ModuleType, str]:
    """The module of a file and the hash of its content."""
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise PluginError(
            "no such file; expected a Python file with hooks, its path from the scene's folder"
        ) from error
    except IsADirectoryError as error:
        raise PluginError(
            "is a folder; expected a Python file, or install a distribution and leave it out of plugins"
        ) from error
    except OSError as error:
        raise PluginError(f"cannot be read ({error.strerror}); expected a Python file with hooks") from error
    digest = hashlib.sha256(content).hexdigest()[:12]
    place = hashlib.sha256(str(path.resolve()).encode() + b"\0" + content).hexdigest()[:12]
    name = f"{re.sub(r'[^0-9A-Za-z_]', '_', path.stem)}_{place}"
    if not name.isidentifier():
        name = f"_{name}"
    if name in sys.modules:
        return sys.modules[name], digest
    spec = spec_from_file_location(name, path)
    if spec is None:
        raise PluginError("is no Python file; expected a name that ends with .py")
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        # The bytes that were hashed, and not what the file may hold a moment later.
        exec(compile(content, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise PluginError(f"{_line(error, path)}{one_line(_short(error))}{_advice(error, path)}") from error
    except BaseException:
        del sys.modules[name]
        raise
    know_source(name, digest)
    import cloudpickle

    cloudpickle.register_pickle_by_value(module)
    return module, digest


def _line(error: BaseException, path: Path) -> str:
    """Return "line N: " for the last line of the file that led to an error."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return f"line {error.lineno}: "
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return f"line {lines[-1]}: " if lines else ""


def _short(error: BaseException) -> BaseException:
    return SyntaxError(error.msg) if isinstance(error, SyntaxError) else error


def _advice(error: BaseException, path: Path) -> str:
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return ""
    absent = error.name.partition(".")[0]
    if (path.parent / f"{absent}.py").exists() or (path.parent / absent).is_dir():
        return (
            f"; {absent} lies beside it, but a plugin file stands alone: put all into this file, or make a "
            "distribution with dacore new-plugin"
        )
    return "" if available(absent) else f"; install what brings {absent}, for example with: pip install {absent}"
