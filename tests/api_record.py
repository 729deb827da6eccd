"""What of the plugin interface a plugin can lean on: names, signatures, fields. Records are kept in tests/data.

``python -m tests.api_record > tests/data/api-MAJOR.MINOR.json`` records the dacore that is imported, at its release.
"""

import dataclasses
import inspect
import json
import sys
from importlib import import_module

# Modules whose public names are the plugin interface (docs/versions.md says so).
MODULES = (
    "dacore.plugins", "dacore.plugins.spec", "dacore.errors",
    "dacore.core.discretization", "dacore.core.domain", "dacore.core.model", "dacore.core.observation",
    "dacore.core.quantity", "dacore.core.estimator", "dacore.core.solver", "dacore.core.space", "dacore.core.fespace",
    "dacore.core.fields", "dacore.core.mesh", "dacore.core.parameters", "dacore.core.timegrid",
    "dacore.core.background",
    "dacore.core.noise", "dacore.core.misfit", "dacore.core.uncertainty", "dacore.core.simplex",
    "dacore.algebra.linear_solver", "dacore.dynamics.profiles", "dacore.geometry.locate",
    "dacore.workflow.studies.study", "dacore.workflow.studies.bench", "dacore.testing",
)  # fmt: skip


def record(modules=MODULES, broad=False):
    """{module: {name: what it is}} of every public name that a module defines or exports; `broad`: or has."""
    return {module: _module(import_module(module), broad) for module in modules}


def _module(module, broad):
    exported = getattr(module, "__all__", None)
    out = {}
    for name, value in sorted(vars(module).items()):
        public = name in exported if exported is not None and not broad else not name.startswith("_")
        if not public or not (inspect.isclass(value) or inspect.isfunction(value)):
            continue
        if exported is None and not broad and value.__module__ != module.__name__:
            continue
        out[name] = _class(value) if inspect.isclass(value) else {"call": _signature(value)}
    return out


def _class(cls):
    members = {}
    for name in dir(cls):
        if name.startswith("_"):
            continue
        value = inspect.getattr_static(cls, name)
        if isinstance(value, staticmethod | classmethod):
            value = value.__func__
        members[name] = _signature(value) if inspect.isfunction(value) else None
    out = {"members": members, "abstract": sorted(getattr(cls, "__abstractmethods__", ()))}
    if dataclasses.is_dataclass(cls) or "__init__" in vars(cls):
        out["call"] = _signature(cls.__init__)
    return out


def _signature(function):
    """[name, kind, whether it has a default] of each parameter but self."""
    parameters = list(inspect.signature(function).parameters.values())
    return [[p.name, p.kind.name, p.default is not p.empty] for p in parameters if p.name not in ("self", "cls")]


def lost(old, new):
    """What a plugin of the old record could no longer rely on, a line each."""
    out = []
    for module, names in old.items():
        for name, before in names.items():
            now = new.get(module, {}).get(name)
            where = f"{module}.{name}"
            if now is None:
                out.append(f"{where} is gone")
                continue
            if "call" in before and "call" in now:
                out += [f"{where}{text}" for text in _narrower(before["call"], now["call"])]
            out += [
                f"{where}.{each} is abstract, so that old classes cannot be made"
                for each in now.get("abstract", ()) if each not in before.get("abstract", ())
            ]  # fmt: skip
            for member, call in before.get("members", {}).items():
                if member not in now["members"]:
                    out.append(f"{where}.{member} is gone")
                elif call is not None and now["members"][member] is not None:
                    out += [f"{where}.{member}{text}" for text in _narrower(call, now["members"][member])]
    return out


def _narrower(before, now):
    positional = ("POSITIONAL_ONLY", "POSITIONAL_OR_KEYWORD")
    old, new = ([p[0] for p in each if p[1] in positional] for each in (before, now))
    if new[: len(old)] != old:
        yield f" takes {new}, took {old}"
    names = {p[0]: p for p in before}
    for name, kind, default in now:
        if name not in names and not default and not kind.startswith("VAR"):
            yield f" wants {name}, which old calls do not give"
        elif name in names and names[name][2] and not default:
            yield f": {name} has no default any more"
    yield from (f" takes no {p[0]} any more" for p in before if p[0] not in {q[0] for q in now})


def added(old, new):
    """(class, name) of the members and fields that classes of the old record have now and had not."""
    for module, names in old.items():
        for name, before in names.items():
            now = new.get(module, {}).get(name, {})
            had = set(before.get("members", {})) | {p[0] for p in before.get("call", ())}
            has = set(now.get("members", {})) | {p[0] for p in now.get("call", ())}
            yield from ((name, each) for each in sorted(has - had))


if __name__ == "__main__":
    json.dump(record(), sys.stdout, indent=1, sort_keys=True)
