"""Backgrounds on disk, and as the named arrays and facts that a file of something larger takes in."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.parameters import ParameterSpace
from dacore.core.reduced import ReducedSpace
from dacore.core.space import Product, StateSpace
from dacore.errors import DacoreError, StoreError
from dacore.io.arrays import read_arrays, write_arrays

KIND = "dacore background 2"


def write_background(background: Background, path: Path) -> None:
    """Write a background; the file appears whole or not at all."""
    write_arrays(path, KIND, *background_parts(background))


def read_background(path: Path, space: StateSpace, parameters: ParameterSpace) -> Background:
    """Read a background of `space`; StoreError if the file is damaged or of another space."""
    arrays, facts = read_arrays(path, KIND)
    try:
        return background_of(arrays, facts, space, parameters)
    except (KeyError, ValueError, TypeError, DacoreError) as error:
        raise StoreError(f"{path}: damaged or of another space ({error}); delete it and run again") from error


def background_parts(background: Background) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays by name and the facts (JSON values) that `background_of` makes a background of."""
    arrays = {name: getattr(background, name) for name in ("coefficients", "times", "samples")}
    for name, basis in background.bases.items():
        arrays |= {f"basis.{name}": basis.basis, f"values.{name}": basis.singular_values}
    return arrays, {"kind": background.kind, "compression": dict(background.compression)}


def background_of(
    arrays: Mapping[str, Array], facts: Mapping[str, Any], space: StateSpace, parameters: ParameterSpace
) -> Background:
    """Make a background of its parts; KeyError, or a dacore error, if they are not all there or of another space."""
    kind: Product = "h1" if facts["kind"] == "h1" else "l2"
    bases = {
        field.name: ReducedSpace(
            arrays[f"basis.{field.name}"], arrays[f"values.{field.name}"], space.field_product(field.name, kind)
        )
        for field in space.fields
    }
    return Background(
        space, bases, arrays["coefficients"], arrays["times"], parameters, arrays["samples"], kind, facts["compression"]
    )
