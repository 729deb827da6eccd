"""A key for what a figure shows: the same content gives the same key, in every process."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def content_key(*values: Any) -> str | None:
    """Hash of values and all they hold; None if one of them is of a kind that has no content to go by.

    Parameters
    ----------
    *values : any
        Numbers, text, arrays, module-level functions, dataclasses, and mappings and sequences of such.
    """
    state = hashlib.sha256()
    try:
        for piece in _pieces(values):
            state.update(len(piece).to_bytes(8, "little"))
            state.update(piece)
    except TypeError:
        return None
    return state.hexdigest()[:24]


def _pieces(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError(value.dtype)
        yield f"array {value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        yield f"{type(value).__name__} {value!r}".encode()
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__module__}.{type(value).__qualname__}".encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _pieces(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, each in value.items():
            yield from _pieces(key)
            yield from _pieces(each)
    elif isinstance(value, Sequence):
        yield f"sequence {len(value)}".encode()
        for each in value:
            yield from _pieces(each)
    elif callable(value) and "<" not in getattr(value, "__qualname__", "<"):  # no lambda, no inner function
        yield f"{value.__module__}.{value.__qualname__}".encode()
    else:
        raise TypeError(type(value))
