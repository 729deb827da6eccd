"""Which versions of dacore and of its plugins are installed, by name and by their very source."""

import hashlib
import sys
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from dacore.plugins.spec import GROUP


@cache
def versions() -> dict[str, str]:
    """Version of dacore and of each installed distribution that brings plugins; imports none of them."""
    found = {point.dist.name: point.dist.version for point in entry_points(group=GROUP) if point.dist is not None}
    return dict(sorted({"dacore": "unknown", **found}.items()))


@cache
def fingerprints() -> dict[str, str]:
    """`versions`, each with a hash of its Python source.

    Two installations whose fingerprints agree compute the same thing, even where somebody edits the
    source without changing the version. Imports no plugin; reads a few hundred files, once.
    """
    packages: dict[str, set[str]] = {"dacore": {"dacore"}}
    for point in entry_points(group=GROUP):
        if point.dist is not None:
            packages.setdefault(point.dist.name, set()).add(_package(point))
    hashes = {name: "+".join(map(source_hash, sorted(each))) for name, each in packages.items()}
    return {name: f"{version}+{hashes[name]}" for name, version in versions().items()}


def _package(point: EntryPoint) -> str:
    return point.value.partition(":")[0].partition(".")[0]


_known: dict[str, str] = {}


def know_source(module: str, digest: str) -> None:
    """Remember the hash of a module that was made of one file, as it was when it was read."""
    _known[module] = digest


@cache
def source_hash(module: str, folders: tuple[str, ...] = ("",)) -> str:
    """Hash of the Python source of a module's package, or of some folders of it; imports nothing.

    Parameters
    ----------
    module : str
        Any module of the package.
    folders : tuple of str
        Folders below the package's; "" for all of it.
    """
    if module in _known:
        return _known[module]
    content = hashlib.sha256()
    sources = _sources(module.partition(".")[0])
    for folder in folders:
        for path, name in sources:
            if not folder or name.startswith(f"{folder}/"):
                content.update(name.encode() + b"\0" + path.read_bytes())
    return content.hexdigest()[:12]


def _sources(package: str) -> list[tuple[Path, str]]:
    """Each Python file of a package with its name inside the package."""
    module = sys.modules.get(package)
    spec = getattr(module, "__spec__", None) or PathFinder.find_spec(package)
    if spec is None:
        return []
    if spec.submodule_search_locations is None:
        return [(Path(spec.origin), Path(spec.origin).name)] if spec.origin else []
    roots = [Path(root) for root in spec.submodule_search_locations]
    return [(path, path.relative_to(root).as_posix()) for root in roots for path in sorted(root.rglob("*.py"))]
