"""What is installed: every plugin's declarations, and the class behind each at first use."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from dacore.core.display import Card, Displayed, Rows, count
from dacore.errors import DacoreError, MissingDependencyError, PluginError
from dacore.plugins.declarations import KINDS, Declaration, Failure, one_line, read
from dacore.plugins.modules import available
from dacore.plugins.spec import GROUP, PluginSpec

BASES = {
    "backend": "dacore.core.discretization:Backend",
    "domain": "dacore.core.domain:Domain",
    "model": "dacore.core.model:Physics",
    "observation": "dacore.core.observation:ObservationOperator",
    "quantity": "dacore.core.quantity:QuantityOfInterest",
    "estimator": "dacore.core.estimator:Estimator",
    "solver": "dacore.core.solver:SolverMethod",
    "format": "dacore.core.data:DataFormat",
    "study": "dacore.workflow.studies.study:Study",
}


@dataclass(frozen=True)
class Row:
    """One line of ``dacore plugins``.

    Parameters
    ----------
    kind, name : str
        "-" where a broken plugin does not say.
    distribution, version : str
        The installed package it comes from.
    status : str
        "ready", "missing X" or "failed: why".
    install : str
        What to type to install what is missing; empty if nothing is.
    summary : str
    """

    kind: str
    name: str
    distribution: str
    version: str
    status: str
    install: str
    summary: str


@dataclass(frozen=True, repr=False)
class Registry(Displayed):
    """Declarations that can be used and failures that cannot.

    Parameters
    ----------
    declarations : tuple of Declaration
        No kind has a name twice.
    failures : tuple of Failure
    """

    declarations: tuple[Declaration, ...]
    failures: tuple[Failure, ...] = ()

    def _card(self) -> Card:
        names = {kind: ", ".join(spec.name for spec in self.specs(kind)) for kind in KINDS}
        facts = (
            ("plugins", count(len(self.declarations))),
            *((kind, found) for kind, found in names.items()),
            ("refused", count(len(self.failures)) if self.failures else ""),
        )
        rows = tuple((row.kind, row.name, row.distribution, row.status, row.summary) for row in self.table())
        return Card("Registry", facts, notebook=(Rows(("kind", "name", "package", "status", "what it is"), rows),))

    def specs(self, kind: str) -> tuple[PluginSpec, ...]:
        """Return what is declared of a kind, sorted by name, whether or not its libraries are installed.

        Parameters
        ----------
        kind : str

        Returns
        -------
        tuple of PluginSpec

        Raises
        ------
        PluginError
            If there is no such kind.
        """
        _check_kind(kind)
        found = [each.spec for each in self.declarations if each.kind == kind]
        return tuple(sorted(found, key=lambda spec: spec.name))

    def get(self, kind: str, name: str) -> type[Any]:
        """Import the class called `name`.

        Parameters
        ----------
        kind : {"backend", "domain", "model", "observation", "quantity", "estimator"}
        name : str

        Returns
        -------
        type

        Raises
        ------
        MissingDependencyError
            If a library it needs is not installed; says what to install.
        PluginError
            If no plugin has that name or two have, the import fails, or the class is not what its
            kind promises.
        """
        declaration = self._find(kind, name)
        spec = declaration.spec
        missing = _missing(spec)
        if missing:
            raise MissingDependencyError(f"{kind} {name!r} needs {', '.join(missing)}; {_install_line(spec, missing)}")
        cls = _import(spec.target, f"{kind} {name!r} of {declaration.source}", spec)
        module, _, attribute = BASES[kind].partition(":")
        base = getattr(import_module(module), attribute)
        who = f"{kind} {name!r} of {declaration.source}: {spec.target}"
        if not isinstance(cls, type) or not issubclass(cls, base):
            base_name = BASES[kind].replace(":", ".")
            raise PluginError(f"{who} is not a subclass of {base_name}; derive it from that")
        abstract = sorted(getattr(cls, "__abstractmethods__", ()))
        if abstract:
            raise PluginError(f"{who} leaves {', '.join(abstract)} abstract; implement every abstract method")
        if kind != "backend" and (loose := _loose(cls)):
            raise PluginError(
                f"{who} has the setting {', '.join(loose)}, but is no dataclass; put @dataclass(frozen=True) above it"
            )
        return cls

    def version(self, kind: str, name: str) -> str:
        """Version of the distribution that declares a plugin; PluginError if none does.

        Parameters
        ----------
        kind, name : str

        Returns
        -------
        str

        Raises
        ------
        PluginError
            If nobody declares it.
        """
        return self._find(kind, name).source.version

    def table(self) -> tuple[Row, ...]:
        """Every plugin, ready or not, by kind and name; imports no plugin class.

        Returns
        -------
        tuple of Row
        """
        rows = [_row(each) for each in self.declarations] + [_failed(each) for each in self.failures]
        order = {kind: number for number, kind in enumerate(KINDS)}
        return tuple(sorted(rows, key=lambda row: (order.get(row.kind, len(order)), row.name, row.distribution)))

    def _find(self, kind: str, name: str) -> Declaration:
        _check_kind(kind)
        for each in self.declarations:
            if each.kind == kind and each.spec.name == name:
                return each
        broken = [failure for failure in self.failures if failure.kind == kind and failure.name == name]
        if broken:
            raise PluginError(f"{kind} {name!r} cannot be used: {broken[0]}")
        names = [spec.name for spec in self.specs(kind)]
        close = get_close_matches(name, names, n=3)
        hint = f" (did you mean {' or '.join(map(repr, close))}?)" if close else ""
        count = len({failure.source for failure in self.failures})
        failed = f"; {count} plugin(s) failed to load, see `dacore plugins`" if count else ""
        raise PluginError(f"{kind} {name!r} is not installed{hint}; there is {', '.join(names) or 'none'}{failed}")


def load(points: Iterable[EntryPoint] | None = None) -> Registry:
    """Read the declarations of every installed plugin; a broken plugin never stops the others.

    Parameters
    ----------
    points : iterable of EntryPoint, optional
        Instead of those installed in the group ``dacore``.

    Returns
    -------
    Registry
        A value; nothing is kept between calls.
    """
    found = entry_points(group=GROUP) if points is None else points
    declarations: list[Declaration] = []
    failures: list[Failure] = []
    for point in sorted(found, key=lambda each: (each.name, each.value)):
        good, bad = read(point)
        declarations += good
        failures += bad
    unique, refused = _refuse_duplicates(declarations)
    return Registry(tuple(unique), tuple(failures + refused))


def _refuse_duplicates(declarations: list[Declaration]) -> tuple[list[Declaration], list[Failure]]:
    """Set aside every declaration whose name another one of its kind has too: neither may win in silence."""
    groups: dict[tuple[str, str], list[Declaration]] = defaultdict(list)
    for each in declarations:
        groups[each.kind, each.spec.name].append(each)
    unique = [group[0] for group in groups.values() if len(group) == 1]
    refused = []
    for (kind, name), group in groups.items():
        if len(group) > 1:
            owners = " and ".join(f"{each.source} ({each.spec.target})" for each in group)
            reason = f"the name {name!r} is declared more than once, by {owners}; uninstall all but one"
            refused += [Failure(each.source, reason, kind, name) for each in group]
    return unique, refused


def _check_kind(kind: str) -> None:
    if kind not in KINDS:
        raise PluginError(f"plugin kind: got {kind!r}, expected one of {', '.join(KINDS)}")


def _loose(cls: type[Any]) -> list[str]:
    """Names that a class annotates and never sets: it was to be a dataclass. Others may do without."""
    if "__dataclass_fields__" in vars(cls) or "__init__" in vars(cls):
        return []
    annotated = vars(cls).get("__annotations__", {})
    return [name for name, hint in annotated.items() if "ClassVar" not in str(hint) and not hasattr(cls, name)]


def _missing(spec: PluginSpec) -> list[str]:
    return [module for module in spec.requires if not available(module)]


def _install_line(spec: PluginSpec, missing: list[str]) -> str:
    return f"install it with: {spec.install or 'pip install ' + ' '.join(missing)}"


def _import(target: str, who: str, spec: PluginSpec) -> Any:
    module, attribute = target.split(":")
    try:
        value: Any = import_module(module)
    except DacoreError:
        raise
    except ImportError as error:
        absent = (error.name or "").partition(".")[0]
        if absent and not available(absent):
            line = _install_line(spec, [absent])
            raise MissingDependencyError(f"{who} needs {absent}, which it does not declare; {line}") from error
        named = "" if error.name not in _parents(module) else "; PluginSpec names it, so correct that or the file"
        raise PluginError(f"{who}: {module} could not be imported: {one_line(error)}{named}") from error
    except Exception as error:
        raise PluginError(f"{who}: {module} could not be imported: {one_line(error)}") from error
    if not hasattr(value, attribute):
        raise PluginError(f"{who}: {module} has no {attribute}; PluginSpec names it, so correct that or the class")
    return getattr(value, attribute)


def _parents(module: str) -> list[str]:
    parts = module.split(".")
    return [".".join(parts[:k]) for k in range(1, len(parts) + 1)]


def _row(each: Declaration) -> Row:
    spec = each.spec
    missing = _missing(spec)
    module = spec.target.partition(":")[0]
    if missing:
        status, install = f"missing {', '.join(missing)}", spec.install or f"pip install {' '.join(missing)}"
    elif not available(module):
        status, install = f"failed: module {module} does not exist", ""
    else:
        status, install = "ready", ""
    return Row(each.kind, spec.name, each.source.distribution, each.source.version, status, install, spec.summary)


def _failed(each: Failure) -> Row:
    source = each.source
    return Row(
        each.kind or "-", each.name or "-", source.distribution, source.version, f"failed: {each.reason}", "", ""
    )
