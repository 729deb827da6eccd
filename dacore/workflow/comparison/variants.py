"""The variants of a scene that a comparison runs."""

import copy
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

from dacore.errors import SceneError
from dacore.io.scene import apply

Choice = Literal["backends", "solvers", "observations", "estimators"]

_TABLES = {"observations": "observation", "estimators": "estimator"}


@dataclass(frozen=True)
class Axis:
    """One thing that differs between the variants.

    Parameters
    ----------
    key : str
        "backends", "solvers", "observations" or "estimators"; or the dotted key of a scene.
    values : tuple
        Names. Of observations and estimators of the scene, several joined by "+" are used together.
        For a key of a scene, its values.
    labels : tuple of str, optional
        Short names of the values.
    """

    key: str
    values: tuple[Any, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.values:
            raise SceneError(f"--{self.key}: got nothing, expected names parted by commas")
        doubled = [value for k, value in enumerate(self.values) if value in self.values[:k]]
        if doubled:
            raise SceneError(f"--{self.key}: {doubled[0]} is named twice; name each variant once")


@dataclass(frozen=True)
class Variant:
    """A whole scene with a short name.

    Parameters
    ----------
    label : str
        What is different: "dolfinx", "slice + sensors", "33k · mfem".
    table : mapping
        The scene, unchecked.
    """

    label: str
    table: Mapping[str, Any]


def names(text: str) -> tuple[str, ...]:
    """Part ``"skfem, dolfinx"`` at its commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def axis_of(text: str) -> Axis:
    """Read ``"domain.nodes=5k,33k"``: the values are those of TOML where they are valid TOML, text elsewhere."""
    key, equals, values = text.partition("=")
    if not equals or not key.strip():
        raise SceneError(f"--vary {text}: expected key=value,value, for example training.samples=16,32")
    try:
        return Axis(key.strip(), tuple(tomllib.loads(f"values = [{values}]")["values"]))
    except tomllib.TOMLDecodeError:
        return Axis(key.strip(), names(values))


def variants(table: Mapping[str, Any], axes: Sequence[Axis]) -> list[Variant]:
    """Every combination of the axes' values, the first axis slowest; at least two.

    Raises
    ------
    SceneError
        If there is nothing to compare, or a name is not in the scene.
    """
    out = combinations(table, axes)
    if len(out) < 2:
        raise SceneError(
            "compare: got one variant, expected at least two; name some: --backends skfem,dolfinx, --solvers, "
            "--observations, --estimators, or --vary KEY=VALUE,VALUE"
        )
    return out


def combinations(table: Mapping[str, Any], axes: Sequence[Axis]) -> list[Variant]:
    """Every combination of the axes' values, the first axis slowest, named by what differs among them."""
    out = []
    for numbers in product(*(range(len(axis.values)) for axis in axes)):
        changed = copy.deepcopy(dict(table))
        for axis, k in zip(axes, numbers, strict=True):
            _change(changed, axis.key, axis.values[k])
        # What is the same in all of them names none of them.
        different = [_label(axis, k) for axis, k in zip(axes, numbers, strict=True) if len(axis.values) > 1]
        out.append(Variant(" · ".join(different), changed))
    return out


def _label(axis: Axis, k: int) -> str:
    value = axis.values[k]
    return axis.labels[k] if axis.labels else value.replace("+", " + ") if isinstance(value, str) else str(value)


def _change(table: dict[str, Any], key: str, value: Any) -> None:
    if key == "backends":
        table["discretization"] = {**table.get("discretization", {}), "backend": value}
    elif key == "solvers":
        old = table.get("solver", {})
        # Another solver has other keys; the tolerance is everybody's.
        kept = old if old.get("kind", "auto") == value else {k: v for k, v in old.items() if k == "tolerance"}
        table["solver"] = {**kept, "kind": value}
    elif key in _TABLES:
        name = _TABLES[key]
        known = table.get(name, {})
        wanted = [part.strip() for part in str(value).split("+")]
        unknown = [part for part in wanted if part not in known]
        if unknown:
            raise SceneError(f"--{key}: got {unknown[0]!r}, expected names of the scene: {', '.join(known) or 'none'}")
        table[name] = {part: known[part] for part in wanted}
    else:
        apply(table, key, value)
