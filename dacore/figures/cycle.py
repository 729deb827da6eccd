"""Errors over the cycle, one thin line for every unseen case."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.core.timegrid import time_unit
from dacore.errors import ShapeError
from dacore.figures.style import INK, colour, legend_below, log_axis, pretty, sheet, styled, title_text


@dataclass(frozen=True, eq=False)
class ErrorHistory:
    """Errors of one estimator over the cycle.

    Parameters
    ----------
    label : str
    errors : mapping of str to (t, k) array
        For each measure ("e_u", "e_p", "e of p − p_csf"), the relative error at each step of each case.
    """

    label: str
    errors: Mapping[str, Array]


@styled
def cycle_errors(
    times: Array, histories: Sequence[ErrorHistory], prior: Mapping[str, Array], caption: str = ""
) -> Figure:
    """Draw one column an estimator and one row a measure, on logarithmic scales shared by each row.

    Parameters
    ----------
    times : (t,) array [s]
    histories : sequence of ErrorHistory
        All with the same measures.
    prior : mapping of str to (t,) or (t, k) array
        Error of guessing the training mean of each step, by measure; a mean over cases is drawn.
    caption : str
        Scene, mesh, scheme and noise level.
    """
    measures = list(histories[0].errors)
    for history in histories:
        if list(history.errors) != measures:
            raise ShapeError(f"errors of {history.label!r}: got {list(history.errors)}, expected {measures}")
        for name, values in history.errors.items():
            if np.ndim(values) != 2 or len(values) != len(times):
                raise ShapeError(
                    f"{name} of {history.label!r}: got shape {np.shape(values)}, expected ({len(times)}, k)"
                )
    figure, grid = sheet(
        len(measures), len(histories), 1.75 * len(measures) + 0.7, caption, sharex=True, sharey="row"
    )  # fmt: skip
    factor, unit = time_unit(float(times[-1]))
    for row, name in enumerate(measures):
        for column, history in enumerate(histories):
            axes = grid[row, column]
            log_axis(axes, plain=True)
            errors = _percent(history.errors[name])
            strength = float(np.clip(6.0 / errors.shape[1], 0.12, 0.5))
            axes.plot(factor * times, errors, color=colour(column), alpha=strength, linewidth=0.8)
            axes.plot(factor * times, _mean(errors), color=colour(column), linewidth=2.2)
            axes.plot([], [], color="#777777", linewidth=2.2, label="mean over the cases")
            axes.plot([], [], color="#777777", alpha=0.5, linewidth=0.8, label="each case")
            if name in prior:
                guess = _percent(prior[name])
                guess = guess if guess.ndim == 1 else _mean(guess)
                axes.plot(
                    factor * times, guess, color=INK, linestyle=(0, (5, 3)), linewidth=1.2,
                    label="guessing the training mean",
                )  # fmt: skip
            if row == 0:
                axes.set_title(title_text(history.label))
            if row == len(measures) - 1:
                axes.set_xlabel(f"time [{unit}]")
        grid[row, 0].set_ylabel(f"{pretty(name)}  [%]")
    legend_below(figure, list(grid.flat))
    return figure


def _percent(values: Array) -> Array:
    percent = 100.0 * np.asarray(values, dtype=np.float64)
    return np.where(percent > 0, percent, np.nan)


def _mean(errors: Array) -> Array:
    """Mean over the cases (t,) of what is known; NaN at a time when nothing is."""
    known = np.isfinite(errors)
    count = known.sum(axis=1)
    total = np.where(known, errors, 0.0).sum(axis=1)
    return np.asarray(np.divide(total, count, out=np.full(len(errors), np.nan), where=count > 0))
