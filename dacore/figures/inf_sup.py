"""Stability constants β(V_n, W) against the dimension of the background space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array, IntArray
from dacore.errors import ShapeError
from dacore.figures.style import family, legend_below, log_axis, sheet, styled


@dataclass(frozen=True, eq=False)
class InfSupCurve:
    """β_n of one pair of space and observation, or of a family such as the phases of a cycle.

    Parameters
    ----------
    label : str
    dimensions : (n,) int array
    values : (n,) or (k, n) array
    """

    label: str
    dimensions: IntArray
    values: Array

    def __post_init__(self) -> None:
        if np.ndim(self.values) not in (1, 2) or np.shape(self.values)[-1] != len(self.dimensions):
            raise ShapeError(
                f"β of {self.label!r}: got shape {np.shape(self.values)} for {len(self.dimensions)} dimensions, "
                "expected (n,) or (k, n)"
            )


@styled
def inf_sup(curves: Sequence[InfSupCurve], caption: str = "") -> Figure:
    """Draw β_n = min over V_n of ‖Π_W v‖/‖v‖ (docs/method.md: PBDW) for several spaces or observations."""
    figure, ((axes,),) = sheet(1, 1, 3.6, caption, width=7.0)
    draw_inf_sup(axes, curves)
    legend_below(figure, [axes])
    return figure


def draw_inf_sup(axes: Axes, curves: Sequence[InfSupCurve]) -> None:
    """Draw β_n in axes."""
    log_axis(axes)
    for index, curve in enumerate(curves):
        family(axes, curve.dimensions, curve.values, index, curve.label)
    axes.axhline(1.0, color="#BBBBBB", linewidth=0.8, zorder=0)
    axes.set(xlabel="dimension $n$", ylabel=r"stability constant $\beta_n$  [–]")
    top = axes.get_ylim()[1]
    axes.set_ylim(top=max(top, 1.3))
