"""Whether a module is there, found without importing it or anything above it."""

import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec


def available(module: str) -> bool:
    """Whether `module` (dotted or not) can be found, without running a line of it.

    `importlib.util.find_spec` imports the parents of a dotted name; asking the finders part by part
    does not, so that a solver behind ``package.solver`` stays unloaded.
    """
    first, *rest = module.split(".")
    spec = _top(first)
    if spec is None:
        return first in sys.modules and not rest
    name = first
    for part in rest:
        if spec.submodule_search_locations is None:
            return False
        name = f"{name}.{part}"
        spec = _below(name, list(spec.submodule_search_locations))
        if spec is None:
            return False
    return True


def _top(name: str) -> ModuleSpec | None:
    try:
        return find_spec(name)
    except (ImportError, ValueError):  # ValueError: loaded by hand, without a spec
        return None


def _below(name: str, path: list[str]) -> ModuleSpec | None:
    for finder in sys.meta_path:
        find = getattr(finder, "find_spec", PathFinder.find_spec)
        spec: ModuleSpec | None = find(name, path)
        if spec is not None:
            return spec
    return None
