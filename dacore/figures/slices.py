"""What every picture of a slice shares: the view, colour scales, outlines, colour bars."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from matplotlib.tri import Triangulation

from dacore.core.arrays import Array
from dacore.figures.style import DIVERGING, INK, SEQUENTIAL, pretty
from dacore.geometry.cut import PlaneCut

# How far past the end of a colour bar values may go, in parts of its size, before the bar says so.
_SLACK = 0.02


_SLAB: Any = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 2.5))}


@dataclass(frozen=True)
class Frame:
    """Names of the axes and of where they point.

    Parameters
    ----------
    names : tuple of str
        Of the axes.
    ends : tuple of (str, str)
        What lies at the low and the high end of each axis; empty strings for nothing.
    planes : tuple of str
        Name of the plane normal to each axis.
    unit : str
        Of length.
    """

    names: tuple[str, ...] = ("x", "y", "z")
    ends: tuple[tuple[str, str], ...] = (("", ""), ("", ""), ("", ""))
    planes: tuple[str, ...] = ("plane", "plane", "plane")
    unit: str = "cm"

    def axis_label(self, axis: int) -> str:
        """Name, unit and direction of an axis: "y [cm] → front"."""
        high = self.ends[axis][1]
        return f"{self.names[axis]} [{self.unit}]" + (f" → {high}" if high else "")

    def plane_label(self, cut: PlaneCut) -> str:
        """Name and place of a slice: "sagittal plane x = 0.2 cm"."""
        name = self.planes[cut.axis]
        kind = name if name == "plane" else f"{name} plane"
        return f"{kind} {self.names[cut.axis]} = {cut.value:.3g} {self.unit}"


HEAD = Frame(
    ends=(("left", "right"), ("back", "front"), ("bottom", "top")), planes=("sagittal", "coronal", "axial")
)  # fmt: skip
"""The head: x to the right, y from back to front, z up."""


@dataclass(frozen=True)
class Slab:
    """A measured slice, drawn where a view is perpendicular to it.

    Parameters
    ----------
    axis : int
        Its normal.
    low, high : float [cm]
        Its two faces.
    label : str
    """

    axis: int
    low: float
    high: float
    label: str = "measured slice"


@dataclass(frozen=True, eq=False)
class View:
    """A slice and how to look at it.

    Parameters
    ----------
    cut : PlaneCut
    frame : Frame
    slabs : tuple of Slab
        Measured slices to show.
    """

    cut: PlaneCut
    frame: Frame = Frame()
    slabs: tuple[Slab, ...] = ()

    @property
    def title(self) -> str:
        """Name and place of the slice."""
        return self.frame.plane_label(self.cut)

    @property
    def aspect(self) -> float:
        """Height over width of the slice."""
        width, height = np.ptp(self.cut.points, axis=0)
        return float(height / width)


@dataclass(frozen=True)
class Scale:
    """A colour scale with a power of ten taken out, so that ticks are short.

    Parameters
    ----------
    low, high : float
        In the data's unit.
    colours : str
        Name of a colour map.
    """

    low: float
    high: float
    colours: str = SEQUENTIAL

    @property
    def size(self) -> float:
        """The larger of its two ends."""
        return max(abs(self.low), abs(self.high))

    @property
    def power(self) -> int:
        """Power of ten, a multiple of three, taken out of the ticks."""
        size = self.size
        if not 0 < size < np.inf or 1e-2 <= size < 1e5:
            return 0
        return int(3 * np.floor(np.log10(size) / 3))

    @property
    def norm(self) -> Normalize:
        """Normalisation of the scaled data."""
        return Normalize(self.low / 10.0**self.power, self.high / 10.0**self.power)

    def label(self, name: str, unit: str) -> str:
        """Name with unit and power of ten: "|u|  [10⁻³ cm]"."""
        raised = str(self.power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        factor = f"10{raised}" if self.power else ""
        inside = " ".join(part for part in (factor, "" if unit == "1" and factor else unit) if part)
        return f"{pretty(name)}  [{inside.replace('1', '–', 1) if inside == '1' else inside}]"


def scale(*values: Array, signed: bool | None = None, colours: str | None = None) -> Scale:
    """Colour scale that holds all `values`: about zero if they are signed, from their least if not.

    Parameters
    ----------
    *values : arrays
        NaN is left out.
    signed : bool, optional
        By default, whether both signs occur.
    colours : str, optional
        Colour map, instead of the usual one of the kind.
    """
    flat = np.concatenate([np.asarray(v, dtype=np.float64).ravel() for v in values])
    flat = flat[np.isfinite(flat)]
    low, high = (float(flat.min()), float(flat.max())) if flat.size else (0.0, 0.0)
    if signed if signed is not None else low < 0 < high:
        size = max(-low, high) or 1.0
        return Scale(-size, size, colours or DIVERGING)
    if 0 <= low < 0.5 * high:
        low = 0.0
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    return Scale(low, high, colours or SEQUENTIAL)


def paint(axes: Axes, view: View, values: Array, colour_scale: Scale, levels: int = 96) -> None:
    """Draw nodal values (q,) of the cut by colour, then its outline and the measured slabs."""
    triangulation = Triangulation(view.cut.points[:, 0], view.cut.points[:, 1], view.cut.triangles)
    norm = colour_scale.norm
    axes.tricontourf(
        triangulation,
        np.clip(np.asarray(values) / 10.0**colour_scale.power, norm.vmin, norm.vmax),
        levels=np.linspace(norm.vmin or 0.0, norm.vmax or 1.0, levels),
        norm=norm,
        cmap=colour_scale.colours,
        antialiased=False,
        extend="both",
    )
    outline(axes, view)
    slabs(axes, view)


def outline(axes: Axes, view: View, **options: Any) -> None:
    """Draw the boundary of the slice, and set the axes to show the whole of it at true proportions."""
    style: dict[str, Any] = {"colors": INK, "linewidths": 0.9, "capstyle": "round"} | options
    axes.add_collection(LineCollection(list(view.cut.points[view.cut.outline]), **style))
    low, high = view.cut.points.min(axis=0), view.cut.points.max(axis=0)
    margin = 0.03 * float((high - low).max())
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal")


def slabs(axes: Axes, view: View) -> None:
    """Draw the faces of the measured slabs that the view is perpendicular to."""
    for slab in view.slabs:
        if slab.axis not in view.cut.axes:
            continue
        line = axes.axvline if slab.axis == view.cut.axes[0] else axes.axhline
        for place in (slab.low, slab.high):
            line(place, color="white", linewidth=2.0, alpha=0.6)
            line(place, **_SLAB)


def slab_legend(where: Figure | Axes, view: View, **options: Any) -> None:
    """Say under a figure (or in axes) what the dashed lines are, if there are any."""
    names = dict.fromkeys(slab.label for slab in view.slabs if slab.axis in view.cut.axes)
    if names:
        handles = [Line2D([], [], label=pretty(name), **_SLAB) for name in names]
        where.legend(handles=handles, **({"loc": "outside lower center"} | options))


def dress(axes: Axes, view: View, left: bool, bottom: bool) -> None:
    """Label the axes of a panel where it stands at the left or the bottom of its grid."""
    horizontal, vertical = view.cut.axes
    axes.locator_params(nbins=5)
    axes.tick_params(length=2.5, left=left, bottom=bottom, labelleft=left, labelbottom=bottom)
    for spine in axes.spines.values():
        spine.set_visible(False)
    if left:
        axes.set_ylabel(view.frame.axis_label(vertical))
    if bottom:
        axes.set_xlabel(view.frame.axis_label(horizontal))


def bar(
    figure: Figure, axes: Iterable[Axes], colour_scale: Scale, label: str, shown: Sequence[Array] = (), **options: Any
) -> None:
    """Add the colour bar of some panels, with a pointed end where the values `shown` go beyond it."""
    low = any(bool(np.nanmin(values) < colour_scale.low - _SLACK * colour_scale.size) for values in shown)
    high = any(bool(np.nanmax(values) > colour_scale.high + _SLACK * colour_scale.size) for values in shown)
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[low, high]
    where: dict[str, Any] = {"fraction": 0.05, "pad": 0.02, "aspect": 22, "extend": extend} | options
    mappable = ScalarMappable(norm=colour_scale.norm, cmap=colour_scale.colours)
    drawn = figure.colorbar(mappable, ax=list(axes), **where)
    drawn.set_label(label, fontsize=8.5)
    drawn.ax.tick_params(labelsize=7.5, length=2.5)
    drawn.locator = MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10])
    plain = ScalarFormatter(useOffset=False)
    plain.set_scientific(False)
    drawn.formatter = plain
    drawn.update_ticks()
    drawn.outline.set_linewidth(0.5)


def panel_height(view: View, width: float, extra: float = 0.0) -> float:
    """Height [in] of a row of panels `width` inches wide each."""
    return float(np.clip(width * view.aspect, 0.8, 2.2 * width)) + extra
