"""Pictures of the background spaces: spectra, stability, bound, modes."""

import numpy as np

from dacore.algebra.svd import left_svd
from dacore.figures.bound import BoundCurve, bound
from dacore.figures.inf_sup import InfSupCurve, inf_sup
from dacore.figures.modes import ModeField, modes
from dacore.figures.spectrum import Spectrum, spectrum
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot
from dacore.workflow.tables import name_of

SHOWN_MODES = 4


def draw_spaces(canvas: Canvas) -> list[Drawn]:
    """Singular values, β_n and the bound of every background space."""
    session = canvas.session
    if not canvas.spaces:
        return []
    spectra, constants, bounds = [], [], []
    for name, spaces in canvas.spaces.items():
        label = name_of(session.builder, name)
        n = min(len(space.inf_sup) for space in spaces)
        values = np.stack([space.singular_values for space in spaces])
        beta = np.stack([space.inf_sup[:n] for space in spaces])
        tails = np.stack([space.tails[1 : n + 1] for space in spaces])
        dimensions = np.arange(1, n + 1)
        one = len(values) == 1
        spectra.append(Spectrum(label, values[0] if one else values))
        constants.append(InfSupCurve(label, dimensions, beta[0] if one else beta))
        middle = len(beta) // 2
        where = "" if one else f", step {middle + 1}"
        bounds.append(BoundCurve(label + where, dimensions, tails[middle], beta[middle], spaces[middle].n))
    return [
        Drawn(
            "singular_values", Plot(spectrum, spectra, canvas.caption, largest=200),
            "Singular values of the training set in each background space, and the tails ε̂_n they leave. "
            "A family (one space a phase) is drawn as its median within its range.",
            "decaying curves of singular values and relative tails against their number",
        ),
        Drawn(
            "inf_sup", Plot(inf_sup, constants, canvas.caption),
            "Stability constants β_n = σ_min of the cross-Gramian between the background space and the "
            "measurements. They never rise with n.",
            "stability constants falling with the dimension of the background space",
        ),
        Drawn(
            "bound", Plot(bound, bounds, canvas.caption),
            "The a-priori bound ε̂_n / β_n and the dimension in use. ε̂_n is a mean-square tail, not a worst case.",
            "bound, tails and stability constants against the dimension, with the dimension in use marked",
        ),
    ]  # fmt: skip


def draw_modes(canvas: Canvas) -> Drawn:
    """The first modes of the first background space, or of the training set."""
    session = canvas.session
    view = canvas.view()
    if canvas.spaces:
        name, spaces = next(iter(canvas.spaces.items()))
        vectors = session.background.lift(spaces[0].modes[:, :SHOWN_MODES])
        whose = name_of(session.builder, name)
    else:
        centred = session.background.coefficients - session.background.mean()[:, :, None]
        left = left_svd(centred.reshape(session.background.dimension, -1))[0]
        vectors, whose = session.background.lift(left[:, :SHOWN_MODES]), "training set"
    fields = [
        ModeField(field.name, canvas.values(view, vectors, field.name)) for field in session.background.space.fields
    ]
    told = ""
    if canvas.hidden is not None:
        told = (
            f" The fields of one column belong together: that is how an unmeasured {canvas.hidden.name} is recovered."
        )
    return Drawn(
        "modes",
        Plot(modes, view, fields, canvas.caption),
        f"First modes of the space of “{whose}”, each scaled to at most 1.{told}",
        "grid of slices with the first modes of each field",
    )
