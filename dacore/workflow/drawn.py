"""A figure with what a report says of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, TypeVar

from matplotlib.figure import Figure

from dacore.core.timegrid import time_unit
from dacore.plugins.versions import source_hash
from dacore.workflow.content import content_key

T = TypeVar("T")


class Plot:
    """A figure that is drawn when it is wanted: a figure function and what it shows.

    Parameters
    ----------
    make : callable
        Of `dacore.figures`: data in, figure out.
    *given, **options
        What it is called with.
    """

    def __init__(self, make: Callable[..., Figure], *given: Any, **options: Any) -> None:
        self.make, self.given, self.options = make, given, options

    def draw(self) -> Figure:
        """Draw it."""
        return self.make(*self.given, **self.options)

    def key(self) -> str | None:
        """Hash of what decides how it looks: what it shows, the code that draws it, and matplotlib's version."""
        drawing = (source_hash("dacore", ("figures", "geometry")), version("matplotlib"))
        return content_key(drawing, self.make, self.given, self.options)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure for a report.

    Parameters
    ----------
    name : str
        Stem of its file.
    figure : Figure or Plot
    caption : str
    alt : str
        What it shows, in words.
    """

    name: str
    figure: Figure | Plot
    caption: str
    alt: str


def sheets(name: str, items: Sequence[T], most: int = 4) -> list[tuple[str, Sequence[T]]]:
    """Divide what one figure would show among several of at most so many, each with a name of its own."""
    if len(items) <= most:
        return [(name, items)]
    count = -(-len(items) // most)
    size = -(-len(items) // count)
    return [(f"{name}_{k + 1}", items[k * size : (k + 1) * size]) for k in range(count)]


def tag(level: float) -> str:
    """A noise level in a file name: "no_noise", "noise_10"."""
    return "no_noise" if level == 0 else f"noise_{100 * level:g}".replace(".", "p")


def error_name(label: str) -> str:
    """What a figure calls the error of a field or contrast."""
    return f"e_{label}" if label.isidentifier() else f"e of {label}"


def unit_text(unit: str) -> str:
    """A unit as it is printed: "dyn/cm^2" becomes "dyn/cm²"."""
    return unit.replace("^2", "²").replace("^3", "³")


def time_text(seconds: float) -> str:
    """A time with a unit that suits it: "15 ms", "2.5 s"."""
    factor, unit = time_unit(seconds)
    return f"{seconds * factor:.3g} {unit}"
