"""Build a plugin's settings from a table of a scene, or say in one line what is wrong with it.

The table is checked field by field against the annotations of a dataclass, and the dataclass's own
constructor makes the object, so that whatever it checks itself is checked too. TOML has the values
of JSON, and pydantic's strict JSON mode is exactly what a scene should allow: a list serves for a
tuple and a whole number for a float, but no text or truth value serves for a number.
"""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from difflib import get_close_matches
from functools import reduce
from operator import or_
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NoReturn,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from dacore.deprecation import Renamed, renamed_keys
from dacore.errors import DacoreError, PluginError, SceneError

if TYPE_CHECKING:
    from pydantic import TypeAdapter
    from pydantic_core import ErrorDetails

T = TypeVar("T")

EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "finite_number": "a finite number",
    "float_type": "a number",
    "frozen_set_type": "a list",
    "int_type": "a whole number",
    "list_type": "a list",
    "mapping_type": "a table",
    "none_required": "nothing",
    "path_type": "a file name in quotes",
    "set_type": "a list",
    "string_type": "text in quotes",
    "tuple_type": "a list",
}


class _TableError(ValueError):
    """What is wrong and at which key below the table; a ValueError, so that pydantic hands it through."""

    def __init__(self, path: str, text: str, expected: str = "") -> None:
        super().__init__(text)
        self.path = path
        self.text = text
        self.expected = expected


def build(cls: type[T], table: Mapping[str, Any], where: str, base: Path | None = None) -> T:
    """Make a `cls` from a table of a scene.

    Parameters
    ----------
    cls : type
        A dataclass, or a class without settings. Fields may be bool, int, float, str, Path,
        Literal, tuples, lists, mappings, other dataclasses, and optionals and unions of these,
        also with the constraints of `annotated_types`. NaN and infinity are refused. A class variable
        ``renamed`` (mapping of old keys to `dacore.deprecation.Renamed`) keeps old scenes alive.
    table : mapping
        Keys and values as ``tomllib`` gives them.
    where : str
        Place of the table, for messages: ``"demo.toml: model"``.
    base : Path, optional
        Folder that relative paths start from; they stay as they are if it is left out.

    Returns
    -------
    T

    Raises
    ------
    SceneError
        On the first key that is unknown, missing or has a wrong value, or if the class itself
        refuses the values. One line: key, what was given, what is allowed.
    PluginError
        If a field of `cls` has an annotation that no scene can fill.
    """
    old = getattr(cls, "renamed", None)  # or a field of that name, which is none of our business
    if isinstance(old, Mapping) and isinstance(table, Mapping):
        table = renamed_keys(table, {key: value for key, value in old.items() if isinstance(value, Renamed)}, where)
    try:
        return _build(cls, table, base)
    except _TableError as error:
        path = f"{where}.{error.path}" if error.path else where
        raise SceneError(f"{path}: {error.text}") from error.__cause__


def _build(cls: type[T], table: Any, base: Path | None) -> T:
    if not isinstance(table, Mapping):
        raise _TableError("", f"got {_show(table)}, expected a table", "a table")
    settings = [field for field in fields(cls) if field.init] if is_dataclass(cls) else []
    known = {field.name: field for field in settings}
    for key in table:
        if key not in known and not is_dataclass(cls) and key in getattr(cls, "__annotations__", {}):
            raise _TableError(
                _key(key), f"{cls.__name__} has it, but is no dataclass; put @dataclass(frozen=True) above it"
            )
        if key not in known:
            raise _TableError(_key(key), _unknown(str(key), list(known)))
    adapters = _adapters(cls, settings, base)
    values = {name: _validate(name, adapters[name], table[name]) for name in known if name in table}
    for name, field in known.items():
        if name not in values and field.default is MISSING and field.default_factory is MISSING:
            raise _TableError(name, f"missing; expected {_what_fits(adapters[name])}")
    try:
        return cls(**values)
    except (DacoreError, ValueError) as error:
        raise _TableError("", " ".join(str(error).split())) from error


def _adapters(cls: type, settings: list[Field[Any]], base: Path | None) -> dict[str, "TypeAdapter[Any]"]:
    from pydantic import ConfigDict, PydanticUserError, TypeAdapter

    config = ConfigDict(strict=True, allow_inf_nan=False)
    hints = get_type_hints(cls, include_extras=True) if settings else {}
    adapters = {}
    for field in settings:
        try:
            adapters[field.name] = TypeAdapter(_scene_type(hints[field.name], base), config=config)
        except (PydanticUserError, TypeError) as error:
            raise PluginError(
                f"{cls.__module__}.{cls.__qualname__}: field {field.name} is annotated {hints[field.name]}, "
                "which no value of a scene can fill; annotate it with plain types"
            ) from error
    return adapters


def _scene_type(hint: Any, base: Path | None) -> Any:
    """`hint` with paths, dataclasses and choices, however deep, replaced by what reads them from a scene."""
    from pydantic import AfterValidator, PlainValidator

    if hint is Path:
        return Annotated[Path, AfterValidator(lambda path: path if base is None else base / path.expanduser())]
    if isinstance(hint, type) and is_dataclass(hint):
        return Annotated[Any, PlainValidator(lambda table: _build(hint, table, base))]
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return Annotated[Any, PlainValidator(_choice(arguments))]
    if origin is Annotated:
        return Annotated[(_scene_type(arguments[0], base), *arguments[1:])]
    if origin in (Union, UnionType):
        return reduce(or_, [_scene_type(each, base) for each in arguments])
    if origin is None or origin is type or origin is Callable:
        return hint
    return origin[tuple(each if each is Ellipsis else _scene_type(each, base) for each in arguments)]


def _choice(choices: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Reader of a Literal. In Python True == 1, which would let true pass for a choice of numbers."""

    def check(value: Any) -> Any:
        for choice in choices:
            if type(value) is type(choice) and value == choice:
                return choice
        expected = " or ".join(_show(choice) for choice in choices)
        words = [each for each in choices if isinstance(each, str)]
        hint = _meant(value, words) if isinstance(value, str) else ""
        raise _TableError("", f"got {_show(value)}, expected {expected}{hint}", expected)

    return check


def _validate(name: str, adapter: "TypeAdapter[Any]", value: Any) -> Any:
    from pydantic import ValidationError

    try:
        return adapter.validate_json(json.dumps(value, default=_foreign))
    except _TableError as error:
        raise _TableError(name, error.text) from None
    except ValidationError as error:
        raise _first(name, value, error.errors(include_url=False)) from error


def _first(name: str, value: Any, errors: "list[ErrorDetails]") -> _TableError:
    """Return the first of the deepest errors; where several types are allowed, what each expects is joined."""
    errors = [error for error in errors if not _only_seems_short(error)] or errors
    places = [_place(value, error["loc"]) for error in errors]
    depth = max(len(steps) for steps, _ in places)
    path, given = next(place for place in places if len(place[0]) == depth)
    expected = []
    for error, (here, _) in zip(errors, places):
        inner = error.get("ctx", {}).get("error")
        if isinstance(inner, _TableError) and (len(errors) == 1 or not inner.expected):
            return _TableError(".".join(filter(None, (name + "".join(here), inner.path))), inner.text, inner.expected)
        if here == path:
            expected.append(_expected(error, given, errors))
    allowed = " or ".join(dict.fromkeys(expected))
    return _TableError(name + "".join(path), f"got {_show(given)}, expected {allowed}", allowed)


def _only_seems_short(error: "ErrorDetails") -> bool:
    """Whether a list is called too short because of wrong items alone, which pydantic does not count."""
    return error["type"] == "too_short" and len(error["input"]) >= error["ctx"]["min_length"]


def _place(value: Any, location: tuple[int | str, ...]) -> tuple[list[str], Any]:
    """Steps below a field and the value there; what is no key of the value is pydantic's name of a type."""
    steps = []
    for step in location:
        if isinstance(step, int) and isinstance(value, list | tuple) and step < len(value):
            steps.append(f"[{step}]")
            value = value[step]
        elif isinstance(value, Mapping) and step in value:
            steps.append(f".{_key(step)}")
            value = value[step]
    return steps, value


def _expected(error: "ErrorDetails", given: Any, errors: "list[ErrorDetails]") -> str:
    kind, context = error["type"], error.get("ctx", {})
    if isinstance(context.get("error"), _TableError):
        return str(context["error"].expected)
    if kind == "missing":  # one error for each value that a fixed-length list lacks
        return f"a list of {len(given) + sum(each['type'] == 'missing' for each in errors)}"
    if kind == "too_long":
        return f"a list of at most {context['max_length']}"
    if kind == "too_short":
        return f"a list of at least {context['min_length']}"
    return EXPECTED.get(kind, error["msg"].removeprefix("Input should be ").removeprefix("Value error, "))


def _what_fits(adapter: "TypeAdapter[Any]") -> str:
    """What a field allows, learnt from what it says to a value that is nothing."""
    try:
        _validate("", adapter, None)
    except _TableError as error:
        return error.expected
    return "a value"


def _unknown(key: str, known: list[str]) -> str:
    return f"unknown key{_meant(key, known)}; allowed here: {', '.join(sorted(known)) or 'no keys at all'}"


def _meant(word: str, words: list[str]) -> str:
    close = get_close_matches(word, words, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _show(value: Any) -> str:
    """`value` as a scene writes it, cut short."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        keys = ", ".join(map(_key, value))
        return f"a table with {keys if 0 < len(keys) <= 60 else f'{len(value)} keys'}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}" if len(value) > 6 else f"[{', '.join(map(_show, value))}]"
    text = repr(value) if isinstance(value, str | int | float) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _key(key: object) -> str:
    """A key as TOML writes it: bare if it can be, in quotes otherwise."""
    return str(key) if re.fullmatch(r"[A-Za-z0-9_-]+", str(key)) else repr(str(key))


def _foreign(value: Any) -> NoReturn:
    raise _TableError("", f"got a {type(value).__name__}, expected numbers, text, true or false, lists and tables")
