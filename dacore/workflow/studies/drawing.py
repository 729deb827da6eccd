"""Figures of studies from what they found."""

from collections.abc import Mapping, Sequence

import numpy as np

from dacore.core.arrays import Array
from dacore.figures.data_amount import data_amount
from dacore.figures.mismatch import MismatchCurve, mismatch
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, error_name, tag
from dacore.workflow.studies.grid import Grid
from dacore.workflow.tables import name_of, noise_name, quantity_title


def measures(grid: Grid, canvas: Canvas) -> tuple[list[str], dict[str, str]]:
    """Names of the errors and quantities of a grid as figures call them, and the units of the quantities."""
    titles = [f"{quantity_title(canvas.session.builder, name)} (rms)" for name in grid.quantities]
    units = {title: canvas.quantity_unit(name) for title, name in zip(titles, grid.quantities, strict=True)}
    return [*(error_name(label) for label in grid.errors), *titles], units


def values_of(grid: Grid, setting: int | slice | Sequence[int], estimator: int, level: int) -> Array:
    """Mean errors and root mean squares of an estimator at a noise level, (..., measures)."""
    return np.concatenate([grid.mean[setting, estimator, level], grid.rms[setting, estimator, level]], axis=-1)


def draw_amounts(grid: Grid, counts: Sequence[int], canvas: Canvas) -> list[Drawn]:
    """Errors over the settings, a figure a noise level."""
    names, units = measures(grid, canvas)
    out = []
    for k, level in enumerate(grid.levels):
        errors: dict[str, dict[str, Array]] = {each: {} for each in names}
        for e, estimator in enumerate(grid.estimators):
            if estimator == PRIOR:
                continue
            for measure, values in zip(names, values_of(grid, slice(None), e, k).T, strict=True):
                errors[measure][name_of(canvas.session.builder, estimator)] = values
        guess = dict(zip(names, map(float, values_of(grid, 0, 0, k)), strict=True))
        out.append(
            Drawn(
                tag(level),
                Plot(
                    data_amount, grid.settings, counts, errors, guess, units, f"{canvas.caption} · {noise_name(level)}"
                ),
                f"Mean errors over the unseen cases, {noise_name(level)}.", "lines of errors over the settings",
            )
        )  # fmt: skip
    return out


def draw_mismatch(
    grid: Grid, series: str, rows: Sequence[int], sizes: Array, levels: Mapping[str, float], canvas: Canvas
) -> list[Drawn]:
    """Errors against the size of what is wrong, a figure a noise level; row 0 of the grid is where nothing is.

    Parameters
    ----------
    grid : Grid
    series : str
    rows : sequence of int
        Settings of the series, by size.
    sizes : (d,) array
        Relative to the data.
    levels : mapping of str to float
        Noise levels in the unit of `sizes`, by label.
    canvas : Canvas
    """
    names, units = measures(grid, canvas)
    out = []
    for k, level in enumerate(grid.levels):
        curves = []
        for e, estimator in enumerate(grid.estimators):
            if estimator == PRIOR:
                continue
            errors = dict(zip(names, values_of(grid, rows, e, k).T, strict=True))
            right = dict(zip(names, map(float, values_of(grid, 0, e, k)), strict=True))
            alarms = grid.alarms[rows, e, k]
            label = name_of(canvas.session.builder, estimator)
            curves.append(MismatchCurve(label, errors, right, alarms if np.isfinite(alarms).all() else None))
        guess = dict(zip(names, map(float, values_of(grid, 0, 0, k)), strict=True))
        out.append(
            Drawn(
                f"{'_'.join(series.split())}_{tag(level)}",
                Plot(
                    mismatch, sizes, curves, f"{series}, relative to the largest datum", levels, guess, units,
                    f"{canvas.caption} · {noise_name(level)}",
                ),
                f"Errors against the size of “{series}”, {noise_name(level)}; thin lines: nothing wrong.",
                "curves of errors that rise with the size of the mismatch",
            )
        )  # fmt: skip
    return out
