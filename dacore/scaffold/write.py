"""Write a distribution from the templates: checked first, then whole or not at all."""

import contextlib
import keyword
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, distribution
from importlib.resources import files
from pathlib import Path
from string import Template

from dacore.errors import PluginError, StoreError
from dacore.plugins.api import API_VERSION
from dacore.plugins.modules import available
from dacore.plugins.registry import load
from dacore.scaffold.kinds import DEFAULT, KINDS

# Sections of a scene in their order, and the kind whose own or other fragment fills each.
SECTIONS = ("domain", "backend", "model", "solver", "observation", "quantity", "estimator", "study")
# What a scene borrows where a kind is not among those written: name of the distribution, and what it brings.
BORROWED = {
    "backend": ("dacore-skfem", "the backend skfem"),
    "model": ("dacore-biot", "the model biot"),
    "observation": ("dacore-imaging", "the observation points"),
}


def new_plugin(name: str, kinds: Sequence[str] = DEFAULT, out: Path | None = None) -> Path:
    """Write an installable distribution with a working plugin of each kind, its tests and a scene that uses it.

    Parameters
    ----------
    name : str
        Of the distribution: "dacore-tumour". What a scene writes begins with "tumour".
    kinds : sequence of str
        Keys of `KINDS`.
    out : Path, optional
        Folder in which the folder NAME is made; the working directory by default.

    Returns
    -------
    Path
        The folder that was made.

    Raises
    ------
    PluginError
        If the name or a kind cannot be used; says what can.
    StoreError
        If the folder is there already, or cannot be written.
    """
    stem, package = _checked(name, kinds)
    folder = (out or Path()) / name
    if folder.exists() or folder.is_symlink():
        raise StoreError(f"{folder}: is there already; choose another NAME or --out, or move it away")
    values = _values(name, stem, package, kinds)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=folder.parent))
    except OSError as error:
        raise StoreError(f"{folder.parent}: cannot be written ({error.strerror}); choose another --out") from error
    try:
        for place, text in _written(package, kinds, values).items():
            file = scratch / name / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        # All at once: nobody sees half of it, and what came in between is not overwritten.
        (scratch / name).rename(folder)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return folder


def word(stem: str, kind: str) -> str:
    """Return what a scene calls the plugin of a kind."""
    return f"{stem}_{KINDS[kind].word}" if KINDS[kind].word else stem


def _checked(name: str, kinds: Sequence[str]) -> tuple[str, str]:
    """Return the stem of the words of scenes, and the package's name; PluginError if they cannot be used."""
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown or not kinds:
        raise PluginError(f"--kind: got {', '.join(unknown) or 'none'}, expected some of {', '.join(KINDS)}")
    if len(set(kinds)) < len(kinds):
        raise PluginError(f"--kind: got {', '.join(kinds)}, expected each kind once")
    if not re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?", name):
        raise PluginError(
            f"NAME: got {name!r}, expected the name of a distribution: letters, digits, '-', '_' and '.', a letter or "
            "digit at both ends, such as dacore-tumour"
        )
    package = re.sub(r"[-_.]+", "_", name).lower()
    stem = package.removeprefix("dacore_")
    for each in (package, stem):
        if not each.isidentifier() or keyword.iskeyword(each):
            raise PluginError(
                f"NAME: got {name!r}, of which Python would have to make the name {each!r}; expected one that begins "
                "with a letter and is no keyword, such as dacore-tumour"
            )
    if package in sys.stdlib_module_names or package in {"dacore", "tests"}:
        raise PluginError(f"NAME: got {name!r}, but {package} is a module of Python or dacore; choose another name")
    with contextlib.suppress(PackageNotFoundError):
        found = distribution(name)
        raise PluginError(f"NAME: got {name!r}, but {name} {found.version} is installed already; choose another name")
    if available(package):
        raise PluginError(f"NAME: got {name!r}, but a module {package} is there already; choose another name")
    registry = load()
    for kind in kinds:
        for row in registry.table():
            if (row.kind, row.name) == (kind, word(stem, kind)):
                raise PluginError(
                    f"NAME: got {name!r}, but the {kind} {row.name!r} is declared by {row.distribution} {row.version} "
                    "already; choose another name"
                )
    return stem, package


def _values(name: str, stem: str, package: str, kinds: Sequence[str]) -> dict[str, str]:
    """Return what the templates' placeholders become."""
    own, round_ = "model" in kinds, "domain" in kinds
    values = {
        "name": name, "stem": stem, "package": package, "api": ".".join(map(str, API_VERSION)),
        "summary": f"For dacore: {', '.join(kinds)}",
        "field": "c" if own else "u", "asked": "c" if own else "p",
        "opening": "inlet" if own else "neck", "rest": "wall" if own else "mre",
        "observed": "lines" if "observation" in kinds else "points",
        "x1": "-1.5" if not round_ else "-1.2", "x2": "-0.5", "x3": "0.8", "ylow": "-0.8", "yhigh": "0.8",
    }  # fmt: skip
    values["contents"] = "\n".join(
        f"- the {kind} `{word(stem, kind)}`: {KINDS[kind].summary} (`src/{package}/{kind}.py`)" for kind in kinds
    )
    values["declared"] = "\n".join(f'    ("{kind}", "{word(stem, kind)}"),' for kind in kinds)
    borrowed = [f"{what} of {whose}" for kind, (whose, what) in BORROWED.items() if kind not in kinds]
    values["borrowed"] = f"{' and '.join(borrowed)} besides (`dacore plugins` says whether they are there)"
    if not borrowed:
        values["borrowed"] = "nothing else but what dacore itself brings"
    values["hooks"] = "".join(_hook(kind, stem, package) for kind in kinds).rstrip("\n")
    values["more"] = _fill("project/quantity_test.py.in", values) if "quantity" in kinds else ""
    return values


def _hook(kind: str, stem: str, package: str) -> str:
    one = KINDS[kind]
    # One argument a line, with a comma after the last, is how formatters leave it, however long a name is.
    return f'''

@hookimpl
def {one.hook}() -> list[PluginSpec]:
    """Declare {one.summary}."""
    return [
        PluginSpec(
            "{word(stem, kind)}",
            "{package}.{kind}:{one.target}",
            summary="{one.summary}",
            api=API,
        )
    ]
'''


def _written(package: str, kinds: Sequence[str], values: Mapping[str, str]) -> dict[str, str]:
    """Return the content of every file of the distribution, by its place."""
    source = f"src/{package}"
    out = {
        "pyproject.toml": _fill("project/pyproject.toml.in", values),
        "README.md": _fill("project/README.md.in", values),
        ".gitignore": _fill("project/gitignore.in", values),
        "scene.toml": _scene(kinds, values),
        f"{source}/__init__.py": _fill("project/__init__.py.in", values),
        f"{source}/py.typed": "",
        "tests/test_declared.py": _fill("project/test_declared.py.in", values),
        "tests/test_scene.py": _fill("project/test_scene.py.in", values),
    }
    for kind in kinds:
        out[f"{source}/{kind}.py"] = _fill(f"kinds/{kind}/module.py.in", values)
        out[f"tests/test_{kind}.py"] = _fill(f"kinds/{kind}/test.py.in", values)
    return out


def _scene(kinds: Sequence[str], values: Mapping[str, str]) -> str:
    """Return a scene that uses what was written, and for the rest what dacore and its plugins have."""
    parts = [_fill("project/scene_begin.toml.in", values)]
    for section in SECTIONS:
        if section == "quantity":
            parts.append(_fill("project/scene_noise.toml.in", values))
        fragment = f"kinds/{section}/{'own' if section in kinds else 'other'}.toml.in"
        if section in kinds or _template(fragment) is not None:
            parts.append(_fill(fragment, values))
        if section == "estimator":
            parts.append(_fill("project/scene_end.toml.in", values))
    return "\n".join(parts)


def _template(place: str) -> str | None:
    file = files("dacore.scaffold") / "templates" / place
    return file.read_text(encoding="utf-8") if file.is_file() else None


def _fill(place: str, values: Mapping[str, str]) -> str:
    text = _template(place)
    if text is None:
        raise PluginError(f"template {place} is missing from this installation of dacore; install dacore again")
    return Template(text).substitute(values)
