"""How much data said of each parameter and quantity: what they took off the prior's variance."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.style import FAINT, INK, colour, pretty, share_text, sheet, styled

# Less of the variance than this is nothing that a decision could rest on.
UNSEEN = 0.1


@styled
def learned(
    names: Sequence[str], shares: Mapping[str, Array], unseen: float = UNSEEN, caption: str = ""
) -> Figure:  # fmt: skip
    """Draw 1 − posterior / prior variance, a row a parameter or quantity and a bar a series.

    Parameters
    ----------
    names : sequence of s str
        Of the parameters and quantities.
    shares : mapping of str to (s,) or (s, k) array
        For each series (an estimator, a noise level), the share of the variance that the data took away; of k
        cases, a bar for the median and a line for the middle 80%. Below 0 is drawn as 0.
    unseen : float
        A smaller share is marked as not seen.
    caption : str
    """
    if not names or not shares:
        raise ShapeError("learned: got no name or no series, expected at least one of each")
    height = 0.24 * len(names) * max(len(shares), 2) + 1.2
    figure, ((axes,),) = sheet(1, 1, height, caption, width=7.0)
    thick = 0.8 / len(shares)
    for index, (label, values) in enumerate(shares.items()):
        cases = np.asarray(values, dtype=np.float64)
        if cases.ndim not in (1, 2) or len(cases) != len(names):
            raise ShapeError(f"shares of {label!r}: got shape {cases.shape}, expected ({len(names)},) or with cases")
        cases = np.clip(100 * cases.reshape(len(names), -1), 0.0, 100.0)
        middle = np.median(cases, axis=1)
        for row, share in enumerate(middle):
            place = row + thick * (index - (len(shares) - 1) / 2)
            seen = share >= 100 * unseen
            axes.barh(
                place, share, height=0.9 * thick, color=colour(index) if seen else "white", edgecolor=colour(index),
                linewidth=0.8, hatch=None if seen else "////", zorder=2,
            )  # fmt: skip
            low, high = np.quantile(cases[row], (0.1, 0.9))
            if cases.shape[1] > 1:
                axes.plot([low, high], [place, place], color=INK, linewidth=1.0, zorder=3)
            text = share_text(share / 100)
            text = text if seen else f"{text}, not seen"
            axes.annotate(
                text, (max(high, share), place), xytext=(4, 0), textcoords="offset points", va="center", fontsize=7.5,
                color=INK if seen else FAINT,
            )  # fmt: skip
    axes.set_yticks(np.arange(len(names)), [pretty(name) for name in names])
    axes.set(xlim=(0, 118), ylim=(len(names) - 0.45, -0.55))
    axes.set_xticks(np.arange(0, 101, 20))
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=True, axis="x")
    axes.set_xlabel("prior variance that the data took away  [%]")
    handles = [Patch(facecolor=colour(i), label=pretty(label)) for i, label in enumerate(shares)]
    handles.append(
        Patch(facecolor="white", edgecolor=FAINT, hatch="////", label=f"not seen (below {100 * unseen:.0f}%)")
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure
