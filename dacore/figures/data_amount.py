"""Errors against how much is measured."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import INK, WIDTH, colour, legend_below, log_axis, marker, pretty, sheet, styled, title_text


@styled
def data_amount(
    amounts: Sequence[str],
    counts: Sequence[int],
    errors: Mapping[str, Mapping[str, Array]],
    guess: Mapping[str, float],
    units: Mapping[str, str] | None = None,
    caption: str = "",
) -> Figure:
    """Draw a panel a measure and a line an estimator, over what is measured in the order given.

    Parameters
    ----------
    amounts : sequence of a str
        "one slice", "three slices", "all".
    counts : sequence of a int
        Functionals m of each.
    errors : mapping of str to (mapping of str to (a,) or (k, a) array)
        For each measure and estimator, relative errors as fractions, or values in the unit that `units` gives; of k
        cases the median is a line and the middle 80% a band.
    guess : mapping of str to float
        The same of guessing the training mean, by measure.
    units : mapping of str to str, optional
        Unit of the measures that are not relative.
    caption : str
    """
    if len(amounts) != len(counts) or not amounts or not errors:
        raise ShapeError(f"data: got {len(amounts)} amounts with {len(counts)} counts, expected as many, and an error")
    # Labels of many amounts need room.
    columns = min(2 if len(errors) == 4 or len(amounts) > 3 else 3, len(errors))
    rows = -(-len(errors) // columns)
    width = WIDTH if columns > 1 else 5.0
    letters = int((width / columns - 0.7) / len(amounts) / 0.064)
    labels = [
        f"{title_text(amount, max(letters, 6))}\n$m$ = {count:,}" for amount, count in zip(amounts, counts, strict=True)
    ]
    deepest = max(label.count("\n") for label in labels)
    figure, grid = sheet(rows, columns, (2.7 + 0.13 * deepest) * rows + 0.4, caption, width=width)
    names = list(dict.fromkeys(name for each in errors.values() for name in each))
    places = np.arange(len(amounts))
    for axes in grid.flat[len(errors) :]:
        axes.set_visible(False)
    for axes, (measure, lines) in zip(grid.flat, errors.items()):
        unit = (units or {}).get(measure, "%")
        factor = 100.0 if unit == "%" else 1.0
        log_axis(axes, plain=True)
        for name, values in lines.items():
            index = names.index(name)
            cases = factor * np.atleast_2d(np.asarray(values, dtype=np.float64))
            if cases.shape[1] != len(amounts):
                raise ShapeError(
                    f"{measure} of {name!r}: got shape {np.shape(values)}, expected ({len(amounts)},) or (cases, "
                    f"{len(amounts)})"
                )
            # Estimators stand a little apart, or their bands would hide each other.
            x = places + 0.12 * (index - (len(names) - 1) / 2)
            if len(cases) > 1:
                low, high = np.nanquantile(cases, (0.1, 0.9), axis=0)
                axes.vlines(x, low, high, color=colour(index), linewidth=5, alpha=0.25)
            axes.plot(
                x, np.nanmedian(cases, axis=0), color=colour(index), marker=marker(index), markersize=6, linewidth=1.2,
                markeredgecolor="white", markeredgewidth=0.6, label=pretty(name),
            )  # fmt: skip
        if measure in guess:
            axes.axhline(
                factor * guess[measure], color=INK, linewidth=1.1, linestyle=(0, (5, 3)),
                label="guessing the training mean",
            )  # fmt: skip
        axes.set_xticks(places, labels, fontsize=7.5 if len(amounts) > 3 else 8)
        axes.set_xlim(-0.5, len(amounts) - 0.5)
        axes.set_title(pretty(measure))
        axes.set_ylabel(f"error  [{unit}]")
    legend_below(figure, list(grid.flat))
    return figure
