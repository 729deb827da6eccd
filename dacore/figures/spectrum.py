"""Singular values of the training set and what n modes leave out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.core.reduced import relative_tails
from dacore.errors import ShapeError
from dacore.figures.style import family, legend_below, log_axis, sheet, styled

# Past round-off (1e-16 of the largest) squares carry no information about the data.
_FLOOR = 1e-16


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values of one space, or of a family such as one space per phase.

    Parameters
    ----------
    label : str
    singular_values : (r,) or (k, r) array
        Decreasing; a family shows its range and median.
    """

    label: str
    singular_values: Array

    def __post_init__(self) -> None:
        if np.ndim(self.singular_values) not in (1, 2) or np.size(self.singular_values) == 0:
            raise ShapeError(
                f"singular values of {self.label!r}: got shape {np.shape(self.singular_values)}, "
                "expected (r,) or (k, r)"
            )


@styled
def spectrum(spaces: Sequence[Spectrum], caption: str = "", largest: int | None = None) -> Figure:
    """Draw σ_i/σ_1 and the tails ε̂_n = (Σ_{i>n} σ_i² / Σ_i σ_i²)^½ (docs/method.md: The training set) side by side.

    Parameters
    ----------
    spaces : sequence of Spectrum
    caption : str
        Scene, mesh and scheme.
    largest : int, optional
        Last index shown.
    """
    figure, ((left, right),) = sheet(1, 2, 3.5, caption)
    draw_singular_values(left, spaces, largest)
    draw_tails(right, spaces, largest)
    left.set_title("Singular values")
    right.set_title("What n modes leave out")
    legend_below(figure, [left, right])
    return figure


def draw_singular_values(axes: Axes, spaces: Sequence[Spectrum], largest: int | None = None) -> None:
    """Draw σ_i/σ_1 in axes; past round-off nothing is drawn."""
    log_axis(axes)
    for index, space in enumerate(spaces):
        values = np.atleast_2d(np.asarray(space.singular_values, dtype=np.float64))[:, :largest]
        scaled = values / np.where(values[:, :1] > 0, values[:, :1], 1.0)
        family(axes, np.arange(1, values.shape[1] + 1), np.where(scaled > _FLOOR, scaled, np.nan), index, space.label)
    axes.set(xlabel="mode number $i$", ylabel=r"$\sigma_i\,/\,\sigma_1$  [–]")


def draw_tails(axes: Axes, spaces: Sequence[Spectrum], largest: int | None = None) -> None:
    """Draw the tails ε̂_n in axes; past round-off nothing is drawn."""
    log_axis(axes)
    for index, space in enumerate(spaces):
        full = np.atleast_2d(np.asarray(space.singular_values, dtype=np.float64))
        count = full[:, :largest].shape[1]
        tails = np.stack([relative_tails(row) for row in full])[:, : count + 1]
        family(axes, np.arange(tails.shape[1]), np.where(tails > _FLOOR, tails, np.nan), index, space.label)
    axes.set(xlabel="dimension $n$", ylabel=r"tail $\hat{\varepsilon}_n$  [–]")
