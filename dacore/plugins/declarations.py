"""Read what one entry point declares, and say what is wrong with the rest of it.

Every entry point gets a plugin manager of its own. A shared one stops at the first plugin that
fails to import or to match a hook, and its check for unknown hooks names one plugin only.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import EntryPoint
from types import FunctionType

import pluggy

from dacore.plugins.api import API_VERSION, refused
from dacore.plugins.spec import GROUP, HOOKS, Hooks, PluginSpec

KINDS = {
    "backend": "dacore_backends",
    "domain": "dacore_domains",
    "model": "dacore_models",
    "observation": "dacore_observations",
    "quantity": "dacore_quantities",
    "estimator": "dacore_estimators",
    "solver": "dacore_solvers",
    "format": "dacore_formats",
    "study": "dacore_studies",
}

_HERE = f"plugin interface {'.'.join(map(str, API_VERSION))}"


@dataclass(frozen=True)
class Source:
    """Where a declaration comes from.

    Parameters
    ----------
    distribution, version : str
        Of the installed package; name of the file and nothing for a file that a scene names.
    entry_point : str
        ``name = module`` as the package has it, or the path of the file.
    file : bool
        Whether it is a file that a scene names, and not installed.
    digest : str
        Hash of the file's content; empty for an installed package.
    """

    distribution: str
    version: str
    entry_point: str
    file: bool = False
    digest: str = ""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()


@dataclass(frozen=True)
class Declaration:
    """A plugin that was declared as it should be.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    spec : PluginSpec
    source : Source
    """

    kind: str
    spec: PluginSpec
    source: Source


@dataclass(frozen=True)
class Failure:
    """A plugin, or a part of one, that cannot be used.

    Parameters
    ----------
    source : Source
    reason : str
        One line.
    kind, name : str
        What was declared, as far as it is known; empty if the whole entry point failed.
    """

    source: Source
    reason: str
    kind: str = ""
    name: str = ""

    def __str__(self) -> str:
        return f"{self.source}: {self.reason}"


def one_line(error: BaseException) -> str:
    """Type and text of an error on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")


def read(entry_point: EntryPoint) -> tuple[list[Declaration], list[Failure]]:
    """Load one entry point and call its hooks. Raises nothing, whatever the plugin does.

    Returns
    -------
    declarations : list of Declaration
    failures : list of Failure
        One for each thing that is wrong; what is right is still declared.
    """
    source = _source(entry_point)
    try:
        plugin = entry_point.load()
    except (Exception, SystemExit) as error:  # noqa: BLE001  a stranger's module may raise anything
        return [], [Failure(source, f"could not be loaded: {one_line(error)}{_outdated(error)}")]
    return declared(plugin, source)


def declared(plugin: object, source: Source) -> tuple[list[Declaration], list[Failure]]:
    """Call the hooks of a module. Raises nothing, whatever the plugin does.

    Returns
    -------
    declarations : list of Declaration
    failures : list of Failure
        One for each thing that is wrong; what is right is still declared.
    """
    manager = pluggy.PluginManager(GROUP)
    manager.add_hookspecs(Hooks)
    try:
        manager.register(plugin)
    except Exception as error:  # noqa: BLE001  pluggy asks a stranger's module for its attributes
        return [], [Failure(source, f"could not be loaded: {one_line(error)}")]
    failures = [Failure(source, reason) for reason in (*_unknown(manager, plugin), *_unmarked(plugin))]
    declarations: list[Declaration] = []
    implemented = 0
    for kind, hook in KINDS.items():
        for implementation in getattr(manager.hook, hook).get_hookimpls():
            implemented += 1
            try:
                specs = implementation.function()
            except (Exception, SystemExit) as error:  # noqa: BLE001
                failures.append(Failure(source, f"hook {hook} raised {one_line(error)}{_outdated(error)}", kind))
                continue
            good, bad = _judge(specs, kind, hook, source)
            declarations += good
            failures += bad
    if not implemented and not failures:
        failures.append(Failure(source, f"declares nothing; expected at least one of the hooks {', '.join(HOOKS)}"))
    return declarations, failures


def _outdated(error: BaseException) -> str:
    """Say that a plugin asks dacore for something that it does not have: a sign of another interface."""
    asked = isinstance(error, ImportError) and (error.name or "").partition(".")[0] == "dacore"
    if asked or (isinstance(error, TypeError) and "PluginSpec" in str(error)):
        return f"; it wants another plugin interface than {_HERE.rpartition(' ')[2]}: update the older of the two"
    return ""


def _source(entry_point: EntryPoint) -> Source:
    text = f"{entry_point.name} = {entry_point.value}"
    try:
        distribution = entry_point.dist
        name, version = (distribution.name, distribution.version) if distribution else (entry_point.name, "")
    except Exception:  # noqa: BLE001  damaged metadata must not hide the plugin
        name, version = entry_point.name, ""
    return Source(str(name), str(version or ""), text)


def _unknown(manager: pluggy.PluginManager, plugin: object) -> Iterator[str]:
    """Hooks that a plugin marks and dacore does not have: most often a misspelling."""
    for caller in manager.get_hookcallers(plugin) or []:
        if not caller.has_spec():
            yield f"hook {caller.name} does not exist{_meant(caller.name)}; {_HERE} has the hooks {', '.join(HOOKS)}"


def _unmarked(plugin: object) -> Iterator[str]:
    """Functions that carry a hook's name, or nearly, but not its mark, so that they are never called."""
    for name, value in vars(plugin).items() if hasattr(plugin, "__dict__") else ():
        if not isinstance(value, FunctionType) or hasattr(value, f"{GROUP}_impl"):
            continue
        if get_close_matches(name, HOOKS, n=1, cutoff=0.85):
            yield f"function {name} is not marked with @hookimpl and is never called; mark it or rename it"


def _meant(word: str) -> str:
    close = get_close_matches(word, HOOKS, n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def _judge(specs: object, kind: str, hook: str, source: Source) -> tuple[list[Declaration], list[Failure]]:
    if not isinstance(specs, list | tuple):
        reason = f"hook {hook} returned {type(specs).__name__}, expected a list of PluginSpec"
        return [], [Failure(source, reason, kind)]
    good: list[Declaration] = []
    bad: list[Failure] = []
    for spec in specs:
        if not isinstance(spec, PluginSpec):
            reason = f"hook {hook} returned a list with {type(spec).__name__} in it, expected PluginSpec only"
            bad.append(Failure(source, reason, kind))
            continue
        reason = _wrong(spec)
        if reason:
            bad.append(Failure(source, reason, kind, str(spec.name)))
        else:
            good.append(Declaration(kind, spec, source))
    return good, bad


def _wrong(spec: PluginSpec) -> str:
    """Return why `spec` cannot be used, or nothing."""
    if reason := refused(spec.api):
        return reason
    if not isinstance(spec.name, str) or not spec.name.isidentifier():
        return f"name: got {spec.name!r}, expected one word of letters, digits and underscores"
    module, _, attribute = spec.target.partition(":") if isinstance(spec.target, str) else ("", "", "")
    if not attribute.isidentifier() or not all(part.isidentifier() for part in module.split(".")):
        return f"target: got {spec.target!r}, expected 'package.module:Class'"
    if not isinstance(spec.requires, tuple | list) or not all(isinstance(name, str) for name in spec.requires):
        return f"requires: got {spec.requires!r}, expected a tuple of module names such as ('skfem',)"
    if not isinstance(spec.install, str) or not isinstance(spec.summary, str):
        return f"install and summary: got {spec.install!r} and {spec.summary!r}, expected text"
    return ""
