"""Where Newmark's family is stable, and what schemes leave of each frequency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import INK, WIDTH, colour, legend_below, log_axis, sheet, styled


@dataclass(frozen=True, eq=False)
class RadiusMap:
    """Largest spectral radii over (β, γ).

    Parameters
    ----------
    title : str
    betas, gammas : (b,), (g,) arrays
    radii : (b, g) array
    """

    title: str
    betas: Array
    gammas: Array
    radii: Array


@dataclass(frozen=True, eq=False)
class RadiusCurve:
    """Spectral radius of a scheme over frequencies.

    Parameters
    ----------
    label : str
    frequencies : (n,) array
        ωτ.
    radii : (n,) array
    """

    label: str
    frequencies: Array
    radii: Array


@styled
def stability(maps: Sequence[RadiusMap], curves: Sequence[RadiusCurve], caption: str = "") -> Figure:
    """Draw a panel for each map with the line 2β = γ ≥ 1/2 of the theory, and one panel of curves.

    Parameters
    ----------
    maps : sequence of RadiusMap
    curves : sequence of RadiusCurve
    caption : str
    """
    for each in maps:
        if np.shape(each.radii) != (len(each.betas), len(each.gammas)):
            raise ShapeError(
                f"map {each.title!r}: got shape {np.shape(each.radii)}, expected {(len(each.betas), len(each.gammas))}"
            )
    figure, grid = sheet(1, len(maps) + 1, 3.3, caption, width=WIDTH)
    norm = LogNorm(1e-6, 10.0)
    for axes, each in zip(grid[0], maps):
        growth = np.clip(each.radii.T - 1, 1e-6, 10.0)
        image = axes.pcolormesh(each.betas, each.gammas, growth, norm=norm, cmap="magma_r", shading="nearest")
        high = float(each.gammas.max())
        axes.plot([0.25, high / 2], [0.5, high], color=INK, linewidth=1.2)
        axes.plot([0.25, float(each.betas.max())], [0.5, 0.5], color=INK, linewidth=1.2)
        axes.set_xlim(each.betas.min(), each.betas.max())
        axes.set_ylim(each.gammas.min(), high)
        axes.set_title(each.title)
        axes.set_xlabel("β")
        axes.set_ylabel("γ")
        bar = figure.colorbar(image, ax=axes, orientation="horizontal", pad=0.18, label="largest growth per step")
        bar.ax.tick_params(labelsize=7)
    last = grid[0, -1]
    for k, curve in enumerate(curves):
        last.plot(curve.frequencies, curve.radii, color=colour(k), label=curve.label)
    log_axis(last, "x")
    last.set_ylim(0, 1.05)
    last.set_title("What a step leaves")
    last.set_xlabel("ωτ")
    last.set_ylabel("spectral radius")
    last.grid(visible=True)
    legend_below(figure, [last])
    return figure
