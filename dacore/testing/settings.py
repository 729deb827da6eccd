"""What holds for the settings of every plugin: a frozen dataclass whose fields are the keys of its table in a scene."""

import pickle
from collections.abc import Mapping
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType
from typing import Any

from dacore.errors import DacoreError
from dacore.plugins.settings import build
from dacore.testing.suite import fail, require


def settings_are_frozen(settings: Any) -> None:
    """Settings are a frozen dataclass: no field can be set once it is made."""
    name = type(settings).__name__
    good = is_dataclass(settings) and not isinstance(settings, type)
    require(good, f"{name}: is no dataclass; decorate it with @dataclass(frozen=True)")
    for field in fields(settings):
        try:
            setattr(settings, field.name, getattr(settings, field.name))
        except FrozenInstanceError:
            continue
        fail(f"{name}.{field.name}: can be set after making; decorate the class with @dataclass(frozen=True)")


def settings_cannot_change(settings: Any) -> None:
    """Values of settings cannot be changed from within either: no lists, sets or arrays, however deep."""
    for field in fields(settings):
        where = f"{type(settings).__name__}.{field.name}"
        value = getattr(settings, field.name)
        # A scene's table stays a mapping; what it holds must not change.
        for part in value.values() if isinstance(value, Mapping) else [value]:
            if not _constant(part):
                fail(f"{where}: holds a {_changeable(part)}, which can be changed; keep a tuple in its place")


def settings_are_equal_to_their_copy(settings: Any) -> None:
    """A copy, made anew or pickled, is equal."""
    name = type(settings).__name__
    again = replace(settings)
    require(again == settings, f"{name}: made again from its own fields it is {again!r}, not {settings!r}")
    try:
        copy = pickle.loads(pickle.dumps(settings))
    except Exception as error:  # noqa: BLE001  pickle raises many kinds
        fail(f"{name}: cannot be pickled: {type(error).__name__}: {error}")
    require(copy == settings, f"{name}: after pickling it is {copy!r}, not {settings!r}")


def settings_come_from_a_scene(settings: Any) -> None:
    """A scene's table with the fields as keys makes equal settings, and a key that is no field is refused."""
    cls = type(settings)
    table = {field.name: _plain(getattr(settings, field.name)) for field in fields(settings) if field.init}
    table = {key: value for key, value in table.items() if value is not None}
    made = build(cls, table, "scene")
    require(made == settings, f"{cls.__name__}: a scene with {table} makes {made!r}, expected {settings!r}")
    try:
        build(cls, table | {"no_such_key": 1}, "scene")
    except DacoreError:
        return
    fail(f"{cls.__name__}: a key that is no field is taken in silence")


CHECKS = (
    settings_are_frozen, settings_cannot_change, settings_are_equal_to_their_copy, settings_come_from_a_scene,
)  # fmt: skip

_PLAIN = (bool, int, float, complex, str, bytes, PurePath, Enum, type, FunctionType, BuiltinFunctionType)


def _constant(value: Any) -> bool:
    if value is None or isinstance(value, _PLAIN):
        return True
    if isinstance(value, tuple | frozenset):
        return all(_constant(each) for each in value)
    if is_dataclass(value):
        parameters: Any = getattr(type(value), "__dataclass_params__", None)
        frozen = parameters is not None and parameters.frozen
        return frozen and all(_constant(getattr(value, field.name)) for field in fields(value))
    return False


def _changeable(value: Any) -> str:
    """Type of the first part of a value that is not constant."""
    if isinstance(value, tuple | frozenset):
        return next(_changeable(each) for each in value if not _constant(each))
    return type(value).__name__


def _plain(value: Any) -> Any:
    """A value of settings as TOML would give it."""
    if isinstance(value, tuple | list | frozenset):
        return [_plain(each) for each in value]
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        table = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {key: each for key, each in table.items() if each is not None}
    return str(value) if isinstance(value, PurePath) else value
