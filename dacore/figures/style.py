"""One look for every figure: fonts, colours, sizes, and the bytes a report embeds."""

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from dacore.core.arrays import Array, IntArray
from dacore.figures.ticks import LogLabels

P = ParamSpec("P")

# One or two letters, an underscore, letters or digits: a name with a subscript, not a word_with_underscores.
_NAME = re.compile(r"(?<![\w.$])([^\W\d_]{1,2}\u0302?)_([A-Za-z0-9]+)(?!\w|\.\w)")

WIDTH = 9.0
"""Width [in] of a figure in a report."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5F5F5F")
"""Okabe and Ito's palette, told apart by every common kind of colour vision."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
INK = "#222222"
FAINT = "#8A8A8A"
SEQUENTIAL = "viridis"
DIVERGING = "RdBu_r"
SPREAD = "magma"

# Typed loosely: the names matplotlib's own types allow change with its version.
_LOOK: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlepad": 6.0,
    "axes.labelsize": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": False,
    "axes.unicode_minus": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "figure.facecolor": "white",
    "figure.titlesize": 8.5,
    "figure.titleweight": "normal",
    "savefig.facecolor": "white",
    "mathtext.fontset": "dejavusans",
    "svg.fonttype": "path",
    "svg.hashsalt": "dacore",
}


@contextmanager
def look() -> Iterator[None]:
    """Draw in the common look: ``with look(): ...`` leaves matplotlib's settings as they were."""
    # Only what is changed is put back: the first figure of a notebook loads its backend, which says in other settings
    # that figures are to be shown.
    before = {key: mpl.rcParams[key] for key in _LOOK}
    mpl.rcParams.update(_LOOK)
    try:
        yield
    finally:
        mpl.rcParams.update(before)


def styled(make: Callable[P, Figure]) -> Callable[P, Figure]:
    """Run a figure function under the common look, leaving matplotlib's settings as they were."""

    @wraps(make)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with look():
            return make(*args, **kwargs)

    return wrapper


def sheet(
    rows: int, columns: int, height: float, caption: str = "", width: float = WIDTH, **options: Any
) -> tuple[Figure, "np.ndarray[Any, Any]"]:
    """Make a figure of rows × columns axes (a 2-D array of Axes) with its caption as the title.

    ``layout="compressed"`` among the options is for panels of fixed proportions.
    """
    layout = options.pop("layout", "constrained")
    figure = Figure(figsize=(width, height + (0.3 if caption else 0.0)), layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    if caption:
        figure.suptitle(pretty(caption), color="#5F5F5F")
    return figure, axes


def png(figure: Figure, dpi: float = 144) -> bytes:
    """Render as PNG; the same figure gives the same bytes."""
    return _render(figure, format="png", dpi=dpi, metadata={"Software": None})


def svg(figure: Figure) -> bytes:
    """Render as SVG (letters as outlines, so it looks the same everywhere)."""
    return _render(figure, format="svg", metadata={"Date": None, "Creator": None})


def _render(figure: Figure, **options: Any) -> bytes:
    buffer = BytesIO()
    with look():
        figure.savefig(buffer, bbox_inches="tight", pad_inches=0.08, **options)
    return buffer.getvalue()


def title_text(label: str, width: int = 26) -> str:
    """A label as a column's title, broken into lines so that neighbours do not meet."""
    return "\n".join(pretty(line) for line in textwrap.wrap(label, width)) or label


def pretty(text: str) -> str:
    """Set the subscripts of short names (e_u, p_csf, β_n) as subscripts and leave the rest as it is.

    Dollar signs are escaped: text of a user is never parsed as mathematics.
    """
    return _NAME.sub(r"\1$_{\\mathrm{\2}}$", text.replace("$", r"\$"))


def colour(index: int) -> str:
    """Colour of the series number `index`."""
    return COLOURS[index % len(COLOURS)]


def marker(index: int) -> str:
    """Marker of the series number `index`: a second cue beside colour, another one when colours start again."""
    return MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]


def family(axes: Axes, x: Array | IntArray, values: Array, index: int, label: str, **options: Any) -> None:
    """Draw one curve, or of several (k, n) the range as a band and the median as a line.

    NaN and, on a logarithmic axis, values that are not positive are left out.
    """
    curves = np.atleast_2d(np.array(values, dtype=np.float64))
    if axes.get_yscale() == "log":
        curves[~(curves > 0)] = np.nan
    shown = np.isfinite(curves).any(axis=0)
    places, curves = np.asarray(x, dtype=np.float64)[shown], curves[:, shown]
    if len(curves) > 1:
        axes.fill_between(
            places, np.nanmin(curves, axis=0), np.nanmax(curves, axis=0), color=colour(index), alpha=0.18, linewidth=0
        )
    every = max(1, len(places) // 12)
    style: dict[str, Any] = {
        "color": colour(index),
        "marker": marker(index),
        "markevery": (index % every, every),
        "markersize": 4.0,
    }
    axes.plot(places, np.nanmedian(curves, axis=0), label=pretty(label), **(style | options))


def log_axis(axes: Axes, which: str = "y", plain: bool = False, ticks: int = 12) -> None:
    """Make an axis logarithmic with few labels, as powers of ten or as plain numbers (0.1, 1, 10).

    Where it shows fewer than two powers of ten, numbers between them are labelled too.
    """
    axis = axes.yaxis if which == "y" else axes.xaxis
    axes.set_yscale("log") if which == "y" else axes.set_xscale("log")
    text = (lambda value: percent_text(value).removesuffix(" %")) if plain else None
    axis.set_major_locator(LogLocator(numticks=ticks))
    axis.set_minor_locator(LogLocator(subs="auto", numticks=ticks))
    axis.set_major_formatter(LogLabels(False, text))
    axis.set_minor_formatter(LogLabels(True, text))
    # Labels between powers count as much as theirs.
    axis.set_tick_params(which="minor", labelsize=_LOOK[f"{which}tick.labelsize"])
    axis.grid(visible=True, which="major")


def percent_text(value: float) -> str:
    """Write a percentage with as many digits as it needs: 0.01 %, 2.1 %, 140 %."""
    if value == 0 or not np.isfinite(value):
        return f"{value:g} %"
    if abs(value) >= 1e5 or abs(value) < 1e-3:
        mantissa, exponent = f"{value:.0e}".split("e")
        return f"{mantissa}e{int(exponent)} %"
    digits = max(0, 1 - int(np.floor(np.log10(abs(value)))))
    text = f"{value:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text) + " %"


def share_text(share: float) -> str:
    """A share of variance learned as a percentage, with more digits near all of it: "63%", "99.97%", "0%"."""
    value = 100 * float(np.clip(share, 0.0, 1.0))
    # A tenth of the deviation and a hundredth differ in digits after the point alone.
    return f"{value:.0f}%" if value < 98.5 else f"{min(float(f'{value:.4g}'), 100.0):g}%"


def legend_below(figure: Figure, axes: Sequence[Axes]) -> None:
    """Put one legend for all axes under the figure, each label once, in as many columns as its width has room for."""
    entries: dict[str, Any] = {}
    for each in axes:
        for handle, label in zip(*each.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    if entries:
        # A letter of the legend's size is about this wide, and a handle with its gaps half an inch.
        longest = max(len(line) for label in entries for line in plain_text(label).split("\n"))
        room = int(figure.get_figwidth() // (0.072 * longest + 0.5))
        columns = max(1, min(len(entries), 5, room))
        # Rows of one length: four entries in two and two, not in three and one.
        columns = -(-len(entries) // -(-len(entries) // columns))
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)


def plain_text(label: str) -> str:
    """A label without the marks of subscripts and mathematics, to know how long it looks."""
    return re.sub(r"\$_\{\\mathrm\{(\w+)\}\}\$|\\(?:hat|mathrm)|[${}\\]", r"\1", label)
