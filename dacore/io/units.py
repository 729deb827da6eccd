"""Units as people write them: "mm", "µm", "value [mm]", "dyn/cm²"."""

import re
from functools import cache
from tokenize import TokenError
from typing import Any

from dacore.errors import SceneError

_HEADER = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*")
# Angles have no dimension: a radian a second would pass for a hertz.
_ANGLES = {"radian", "degree", "turn", "revolutions_per_minute", "revolutions_per_second"}
_WRITTEN = re.compile(r"[\w\s*/^().%°-]+")


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def factor(given: str, wanted: str, where: str) -> float:
    """What a number in the unit `given` is multiplied with to be in the unit `wanted`.

    Raises
    ------
    SceneError
        If a unit is unknown, measures something else, or has a zero of its own as °C has: no factor converts it.
    """
    if given == wanted:
        return 1.0
    import pint

    try:
        if not _WRITTEN.fullmatch(_plain(given)):
            raise ValueError("no unit")
        zero, one = (_registry().Quantity(number, _plain(given)).to(_plain(wanted)).magnitude for number in (0.0, 1.0))
    except (pint.errors.PintError, AttributeError, TypeError, ValueError, AssertionError, TokenError) as error:
        raise SceneError(f"{where}: got the unit {given!r}, expected one that converts to {wanted!r}") from error
    if zero != 0:
        raise SceneError(
            f"{where}: got the unit {given!r}, which has a zero of its own; give differences from the zero of the "
            f"scene, in {wanted!r}"
        )
    if wanted == "Hz" and _ANGLES & {name for name, _ in _registry().Quantity(1.0, _plain(given)).unit_items()}:
        raise SceneError(f"{where}: got {given!r}, a unit of angular frequency; give cycles a second, in 'Hz'")
    return float(one)


def chosen_unit(asked: str | None, found: str | None, name: str) -> tuple[str | None, tuple[str, ...]]:
    """The unit that was asked for, or else that of the file; and a note if one replaces the other."""
    if asked is None or found is None or asked == found:
        return asked or found, ()
    return asked, (f"{name}: says its values are in {found}; --unit {asked} is taken instead",)


def split_header(text: str) -> tuple[str, str | None]:
    """Name and unit of a column: "value [mm]" gives ("value", "mm"); the unit is None without brackets."""
    found = _HEADER.fullmatch(text)
    if found is None:
        return text.strip(), None
    unit = found["unit"]
    return found["name"], unit.strip() if unit and unit.strip() else None


def _plain(unit: str) -> str:
    return unit.strip().replace("²", "^2").replace("³", "^3").replace("μ", "u").replace("µ", "u")


def parse_quantity(text: str, wanted: str, where: str) -> float:
    """A number with or without a unit as a number in the unit `wanted`: "0.5 ms" in "s" is 5e-4."""
    found = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if found is None:
        raise SceneError(f"{where}: got {text!r}, expected a number with or without a unit, such as '5 {wanted}'")
    return float(found[1]) * (factor(found[2], wanted, where) if found[2] else 1.0)
