"""What values show of themselves: a few lines in a terminal, a small table in a notebook.

A class that derives from `Displayed` says in `_card` what it is: a title, facts, tables. Whoever looks at a value must
not wait for it: a card holds what is known already, and nothing is computed or loaded for it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from textwrap import wrap
from typing import Any

# A line of text is no longer than this, a value has no more than so many of them, and a table shows so many rows in a
# terminal and in a notebook.
_LONGEST, _MOST, _LINES, _ROWS = 96, 4, 24, 40
# Facts that fit are on one line.
_ONE_LINE = 100

# Borders are grey and see-through and text has the page's own colour, so that light and dark pages both do.
_TABLE = "border-collapse:collapse;margin:.3em 0;color:inherit;background:transparent;font-size:.95em"
_CELL = "text-align:left;padding:.15em .8em .15em 0;vertical-align:top;border:0;border-bottom:1px solid #8883"
_HEAD = f"{_CELL};font-weight:normal;opacity:.65;white-space:nowrap"


@dataclass(frozen=True)
class Rows:
    """A table of a card.

    Parameters
    ----------
    headers : tuple of str
    rows : tuple of tuples of str
        As long as the headers.
    title : str
    """

    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""

    def text(self) -> list[str]:
        """Lines of aligned columns.

        Returns
        -------
        list of str
        """
        shown = [self.headers, *self.rows[:_LINES]]
        widths = [max(len(row[k]) for row in shown) for k in range(len(self.headers))]
        lines = [f"  {self.title}"] if self.title else []
        lines += [
            ("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))).rstrip()
            for row in shown
        ]
        return lines + [f"  … and {len(self.rows) - _LINES} more"] * (len(self.rows) > _LINES)

    def html(self) -> str:
        """A table, its text escaped.

        Returns
        -------
        str
        """
        head = "".join(f'<th style="{_HEAD}">{escape(cell)}</th>' for cell in self.headers)
        body = "".join(
            "<tr>" + "".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in row) + "</tr>"
            for row in self.rows[:_ROWS]
        )
        more = f'<div style="opacity:.65">… and {len(self.rows) - _ROWS} more</div>' * (len(self.rows) > _ROWS)
        title = f'<div style="margin-top:.5em">{escape(self.title)}</div>' if self.title else ""
        return f'{title}<table style="{_TABLE}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}'


@dataclass(frozen=True)
class Card:
    """What is shown of a value.

    Parameters
    ----------
    title : str
        What it is.
    facts : tuple of (str, str)
        Names and values; a fact without a value is left out.
    tables : tuple of Rows
        Those without rows are left out.
    notebook : tuple of Rows
        Tables too long for a terminal.
    """

    title: str
    facts: tuple[tuple[str, str], ...] = ()
    tables: tuple[Rows, ...] = ()
    notebook: tuple[Rows, ...] = ()

    def text(self) -> str:
        """One line if it fits, else a line for each fact and each row.

        Returns
        -------
        str
        """
        facts = [(name, value) for name, value in self.facts if value]
        tables = [table for table in self.tables if table.rows]
        line = f"{self.title}({'; '.join(f'{name}: {value}' for name, value in facts)})" if facts else self.title
        if not tables and len(line) <= _ONE_LINE:
            return line
        width = max((len(name) for name, _ in facts), default=0)
        lines = [_cut(self.title), *(line for fact in facts for line in _wrapped(*fact, width))]
        return "\n".join([*lines, *(line for table in tables for line in table.text())])

    def html(self) -> str:
        """A heading and tables, styled inline, all text escaped.

        Returns
        -------
        str
        """
        rows = "".join(
            f'<tr><th scope="row" style="{_HEAD}">{escape(name)}</th><td style="{_CELL}">{escape(value)}</td></tr>'
            for name, value in self.facts
            if value
        )
        facts = f'<table style="{_TABLE}"><tbody>{rows}</tbody></table>' if rows else ""
        tables = "".join(table.html() for table in (*self.tables, *self.notebook) if table.rows)
        return f'<div style="overflow-x:auto"><strong>{escape(self.title)}</strong>{facts}{tables}</div>'


class Displayed:
    """A value that shows itself by a card.

    A dataclass below needs ``@dataclass(repr=False)``, or it gets a ``__repr__`` of its own that prints every array.
    """

    def _card(self) -> Card:
        """Title, facts and tables; by default the attributes, arrays by their shape. Must compute and load nothing."""
        return Card(type(self).__name__, tuple((name, brief(value)) for name, value in _attributes(self)))

    def __repr__(self) -> str:
        return self._card().text()

    def _repr_html_(self) -> str:
        return self._card().html()


def brief(value: Any) -> str:
    """A value in a few words: arrays and matrices by shape, long text cut, none as nothing.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
    """
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return number(value)
    if isinstance(value, bool | int):
        return f"{value}" if isinstance(value, bool) else count(value)
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        what = "sparse" if hasattr(value, "nnz") else "array"
        return f"{what} {' × '.join(map(str, shape))}" if shape else f"{value}"
    if isinstance(value, Mapping):
        return listed([str(key) for key in value])
    if isinstance(value, Sequence | set | frozenset):
        plain = all(isinstance(each, str | int | float) for each in value)
        return listed([brief(each) for each in value]) if plain else count(len(value), "item")
    if isinstance(value, Displayed):
        return value._card().title
    return getattr(value, "__name__", type(value).__name__)


def number(value: float) -> str:
    """A number of up to six digits: "1e6", "0.45", "10132.5".

    Parameters
    ----------
    value : float

    Returns
    -------
    str
    """
    mantissa, exponent, power = (f"{value:.6g}" if abs(value) != 1e5 else "1e5").partition("e")
    return f"{mantissa}e{int(power)}" if exponent else mantissa


def percent(value: float) -> str:
    """A relative error as a percentage of two digits: "0.13%", "12%", "4200%", and "–" for NaN.

    Parameters
    ----------
    value : float

    Returns
    -------
    str
    """
    if value != value:
        return "–"
    mantissa, exponent, power = f"{100 * value:.1e}".partition("e")
    if value == 0 or -3 <= int(power) < 5:
        return f"{float(mantissa + exponent + power):g}%"
    return f"{float(mantissa):g}e{int(power)}%"


def listed(names: Sequence[str], most: int = 8) -> str:
    """Names with commas, the first of many.

    Parameters
    ----------
    names : sequence of str
    most : int
        More are counted instead.

    Returns
    -------
    str
    """
    return ", ".join(names[:most]) + (f", … ({len(names)})" if len(names) > most else "")


def count(number: int, what: str = "", plural: str = "") -> str:
    """A whole number with what is counted: "5,147 nodes", "1 mode".

    Parameters
    ----------
    number : int
    what : str
        In the singular.
    plural : str
        `what` with an s by default.

    Returns
    -------
    str
    """
    word = what if number == 1 or not what else plural or f"{what}s"
    return f"{number:,} {word}".rstrip()


def unit_text(unit: str) -> str:
    """A unit as it is printed: "dyn/cm^2" becomes "dyn/cm²", and "1" becomes "–".

    Parameters
    ----------
    unit : str

    Returns
    -------
    str
    """
    return "–" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def moments(times: Sequence[float] | Any) -> str:
    """How many times [s] there are and from when to when, in a unit that suits: "20, 0.5 to 10 ms".

    Parameters
    ----------
    times : (t,) array [s]

    Returns
    -------
    str
    """
    if len(times) == 0:
        return "none"
    first, last = float(times[0]), float(times[-1])
    size = max(abs(first), abs(last))
    factor, unit = next(((f, u) for f, u in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")) if size * f >= 1.0), (1.0, "s"))
    if len(times) == 1:
        return f"1, {factor * first:.4g} {unit}"
    return f"{len(times)}, {factor * first:.4g} to {factor * last:.4g} {unit}"


def _attributes(value: object) -> list[tuple[str, Any]]:
    if is_dataclass(value):
        return [(field.name, getattr(value, field.name)) for field in fields(value) if not field.name.startswith("_")]
    return [(name, each) for name, each in vars(value).items() if not name.startswith("_")]


def _cut(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"


def _wrapped(name: str, value: str, width: int) -> list[str]:
    """Lines of a fact, its value below itself where it is long."""
    parts = wrap(" ".join(value.split()), _LONGEST, max_lines=_MOST, placeholder=" …") or [""]
    return [f"  {(name if k == 0 else '').ljust(width)}  {part}" for k, part in enumerate(parts)]
