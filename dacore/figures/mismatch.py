"""What a wrong model does: errors and alarms against the size of what is wrong."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled


@dataclass(frozen=True, eq=False)
class MismatchCurve:
    """One estimator at one noise level, over the size of the mismatch.

    Parameters
    ----------
    label : str
    errors : mapping of str to (d,) array
        By measure, relative errors as fractions, or values in the unit that `mismatch` is given for it.
    right : mapping of str to float
        The same where nothing is wrong, by measure.
    alarms : (d,) array, optional
        Share of the cases whose data raise the alarm.
    """

    label: str
    errors: Mapping[str, Array]
    right: Mapping[str, float] = field(default_factory=dict)
    alarms: Array | None = None


@styled
def mismatch(
    sizes: Array,
    curves: Sequence[MismatchCurve],
    size: str = "mismatch δ / max|u|",
    noise: Mapping[str, float] | None = None,
    guess: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    caption: str = "",
) -> Figure:
    """Draw errors of each measure, and below the share of alarms, against the size of the mismatch.

    Parameters
    ----------
    sizes : (d,) array
        Positive; relative to the data.
    curves : sequence of MismatchCurve
        All with the same measures.
    size : str
        Label of the axis.
    noise : mapping of str to float, optional
        Noise levels, by label, in the unit of `sizes`; marked by a line.
    guess : mapping of str to float, optional
        Errors of guessing the training mean, by measure.
    units : mapping of str to str, optional
        Unit of the measures that are not relative.
    caption : str
    """
    x = np.asarray(sizes, dtype=np.float64)
    measures = list(curves[0].errors) if curves else []
    if not measures or x.ndim != 1 or not (x > 0).all():
        raise ShapeError("mismatch: expected at least one curve with an error, and positive sizes")
    for curve in curves:
        if list(curve.errors) != measures:
            raise ShapeError(f"errors of {curve.label!r}: got {list(curve.errors)}, expected {measures}")
        series = dict(curve.errors) | ({} if curve.alarms is None else {"alarms": curve.alarms})
        for name, values in series.items():
            if np.shape(values) != x.shape:
                raise ShapeError(f"{name} of {curve.label!r}: got shape {np.shape(values)}, expected {x.shape}")
    alarms = any(curve.alarms is not None for curve in curves)
    panels = len(measures) + alarms
    columns = min(3, panels)
    rows = -(-panels // columns)
    figure, grid = sheet(rows, columns, 2.9 * rows + 0.4, caption, width=WIDTH if columns > 1 else 5.0)
    for axes in grid.flat[panels:]:
        axes.set_visible(False)
    for axes, measure in zip(grid.flat, measures):
        unit = (units or {}).get(measure, "%")
        factor = 100.0 if unit == "%" else 1.0
        log_axis(axes, plain=True)
        for index, curve in enumerate(curves):
            _line(axes, x, factor * np.asarray(curve.errors[measure], dtype=np.float64), index, curve.label)
            if measure in curve.right:
                axes.axhline(
                    factor * curve.right[measure], color=colour(index), linewidth=0.9, linestyle=(0, (1, 2)), zorder=0
                )
        if any(measure in curve.right for curve in curves):
            axes.plot([], [], color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), label="nothing wrong")
        if measure in (guess or {}):
            axes.axhline(
                factor * (guess or {})[measure], color=INK, linewidth=1.1, linestyle=(0, (5, 3)),
                label="guessing the training mean",
            )  # fmt: skip
        axes.set_title(pretty(measure), pad=16)
        axes.set_ylabel(f"error  [{unit}]")
    if alarms:
        axes = grid.flat[len(measures)]
        for index, curve in enumerate(curves):
            if curve.alarms is not None:
                _line(axes, x, 100 * np.asarray(curve.alarms, dtype=np.float64), index, curve.label)
        axes.set_ylim(-4, 104)
        axes.set_title("alarm", pad=16)
        axes.set_ylabel("cases with an alarm  [%]")
        axes.grid(visible=True, axis="y")
    for axes in grid.flat[:panels]:
        log_axis(axes, "x", ticks=7)
        axes.set_xlabel(f"{pretty(size)}  [–]")
        for label, value in (noise or {}).items():
            axes.axvline(value, color=FAINT, linewidth=0.9, zorder=0)
            axes.annotate(
                pretty(label), (value, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2),
                textcoords="offset points", ha="center", va="bottom", fontsize=7.5, color=INK,
            )  # fmt: skip
    legend_below(figure, list(grid.flat))
    return figure


def _line(axes: Axes, x: Array, values: Array, index: int, label: str) -> None:
    axes.plot(
        x, values, color=colour(index), marker=marker(index), markersize=5, markeredgecolor="white",
        markeredgewidth=0.5, linewidth=1.4, label=pretty(label), clip_on=False,
    )  # fmt: skip
