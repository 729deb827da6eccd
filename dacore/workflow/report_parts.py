"""What a report is made of."""

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from dacore.errors import ShapeError

Tone = Literal["", "best", "bad", "muted"]

_PNG = b"\x89PNG\r\n\x1a\n"
# Figures are drawn at 144 dots an inch: shown at 96, they are sharp and their letters of text size.
_SHRINK = 1.5


@dataclass(frozen=True)
class Card:
    """A headline number.

    Parameters
    ----------
    label : str
        What it is.
    value : str
        The number with its unit.
    note : str
        What to hold it against ("guessing the mean: 39 %").
    tone : {"", "good", "bad"}
    """

    label: str
    value: str
    note: str = ""
    tone: Literal["", "good", "bad"] = ""


@dataclass(frozen=True)
class Cell:
    """A table cell with emphasis: "best" of its kind, "bad" (worse than guessing), or "muted"."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Table:
    """Rows under headers; the first column names its row.

    Parameters
    ----------
    headers : sequence of str
    rows : sequence of sequences of str or Cell
        Each as long as the headers.
    caption, note : str
        Above and under it.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    caption: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        for index, row in enumerate(self.rows):
            if len(row) != len(self.headers):
                raise ShapeError(
                    f"table {self.caption or '(no caption)'!r}: row {index} has {len(row)} cells, "
                    f"expected {len(self.headers)} as the headers"
                )


@dataclass(frozen=True)
class Picture:
    """A PNG or SVG.

    Parameters
    ----------
    data : bytes
        The file's content (`dacore.figures.style.png` or ``svg``).
    caption : str
    alt : str
        What it shows, in words, for those who cannot see it.
    """

    data: bytes
    caption: str
    alt: str

    def __post_init__(self) -> None:
        if not self.data.startswith(_PNG) and b"<svg" not in self.data[:2000]:
            raise ShapeError(f"picture {self.caption!r}: its bytes are neither PNG nor SVG")
        if not self.alt.strip():
            raise ShapeError(f"picture {self.caption!r}: has no alternative text; say in words what it shows")

    @property
    def mime(self) -> str:
        """Media type."""
        return "image/png" if self.data.startswith(_PNG) else "image/svg+xml"

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height in CSS pixels; None where an SVG does not say."""
        if self.data.startswith(_PNG):
            width, height = struct.unpack(">II", self.data[16:24])
            return round(width / _SHRINK), round(height / _SHRINK)
        found = (
            re.search(rb'<svg[^>]*?\bwidth="([\d.]+)pt"', self.data),
            re.search(rb'<svg[^>]*?\bheight="([\d.]+)pt"', self.data),
        )
        if found[0] is None or found[1] is None:
            return None
        return round(float(found[0][1]) * 96 / 72), round(float(found[1][1]) * 96 / 72)


@dataclass(frozen=True)
class Section:
    """A heading, text, and tables and pictures in their order.

    Parameters
    ----------
    title : str
    text : str
        Paragraphs parted by blank lines. ``**strong**``, ```code``` and names such as p_csf are set as such.
    parts : sequence of Table or Picture
    """

    title: str
    text: str = ""
    parts: Sequence[Table | Picture] = ()


@dataclass(frozen=True)
class Timing:
    """How long a stage took, whether it was run, cached or skipped, and how long it was expected to take [s]."""

    stage: str
    seconds: float
    state: str = "run"
    expected: float | None = None


@dataclass(frozen=True)
class Provenance:
    """Where the numbers come from.

    Parameters
    ----------
    facts : mapping of str to (mapping of str to str)
        By heading ("Versions", "Seeds", "Machine"), names and values.
    timings : sequence of Timing
    peak_memory : int, optional
        Bytes.
    """

    facts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    timings: Sequence[Timing] = ()
    peak_memory: int | None = None


@dataclass(frozen=True)
class Report:
    """Everything a report shows.

    Parameters
    ----------
    title, subtitle : str
    cards : sequence of Card
    sections : sequence of Section
    provenance : Provenance, optional
    scene : str
        The scene's TOML, shown folded.
    """

    title: str
    subtitle: str = ""
    cards: Sequence[Card] = ()
    sections: Sequence[Section] = ()
    provenance: Provenance | None = None
    scene: str = ""
