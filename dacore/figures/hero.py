"""From a few measured voxels to a hidden field, in one wide strip."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

from dacore.core.arrays import Array
from dacore.figures.slices import View, bar, outline, paint, scale, slab_legend
from dacore.figures.style import DIVERGING, INK, pretty, styled
from dacore.figures.voxels import on_slice, pixels


@dataclass(frozen=True, eq=False)
class Measured:
    """The left panel: one value for each voxel of a slice.

    Parameters
    ----------
    view : View
    centres : (s, d) array [cm]
    spacing : sequence of float [cm]
    values : (s,) array
    name, unit : str
    note : str
        Under the panel: how much and how well is measured.
    """

    view: View
    centres: Array
    spacing: Sequence[float]
    values: Array
    name: str
    unit: str
    note: str = ""


@dataclass(frozen=True, eq=False)
class Hidden:
    """The right panels: a field that was never measured, at the points of a cut.

    Parameters
    ----------
    view : View
    truth, estimate : (q,) arrays
    name, unit : str
    note : str
        Under the reconstruction: how large its error is.
    """

    view: View
    truth: Array
    estimate: Array
    name: str
    unit: str
    note: str = ""


@styled
def hero(measured: Measured, hidden: Hidden, caption: str = "") -> Figure:
    """Draw measured voxels → reconstruction | truth, with one colour scale for both on the right."""
    ratios = [1.0 / max(measured.view.aspect, 0.4), 0.22, *([1.0 / max(hidden.view.aspect, 0.4)] * 2)]
    height = 3.5
    figure = Figure(figsize=(2.6 * sum(ratios) + 1.9, height + (0.3 if caption else 0.0)), layout="compressed")
    left, middle, right, truth = figure.subplots(1, 4, width_ratios=ratios)
    if caption:
        figure.suptitle(pretty(caption))

    near = on_slice(measured.view, measured.centres, measured.spacing)
    seen = scale(measured.values[near])
    if seen.colours == DIVERGING:
        # Another pair of hues than the hidden field's, for another quantity.
        seen = replace(seen, colours="PuOr_r")
    outline(left, measured.view)
    pixels(left, measured.view, measured.centres[near], measured.spacing, measured.values[near], seen)
    bar(figure, [left], seen, seen.label(measured.name, measured.unit), location="left", pad=0.02)
    left.set_title("measured")

    arrow = FancyArrowPatch(
        (0.02, 0.5), (0.98, 0.5), transform=middle.transAxes, arrowstyle="-|>,head_length=7,head_width=4.5",
        mutation_scale=1.2, linewidth=2.2, color=INK,
    )  # fmt: skip
    middle.add_patch(arrow)

    shared = scale(hidden.truth)
    for axes, values, title in ((right, hidden.estimate, "recovered"), (truth, hidden.truth, "truth")):
        paint(axes, hidden.view, values, shared)
        axes.set_title(title)
    bar(figure, [right, truth], shared, shared.label(hidden.name, hidden.unit), (hidden.estimate,), pad=0.01)

    notes = ((left, measured.view.title, measured.note), (right, hidden.view.title, hidden.note), (truth, "", ""))
    for axes, place, note in notes:
        axes.set_xlabel("\n".join(pretty(line) for line in (place, note) if line), fontsize=8.5)
    for axes in (left, middle, right, truth):
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_visible(False)
    slab_legend(truth, hidden.view, loc="upper center", bbox_to_anchor=(0.5, 0.01))
    return figure
