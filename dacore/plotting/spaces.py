"""How fast a training set is approximated, and how stably its spaces are seen."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes

from dacore.core.background import Background
from dacore.core.estimator import BackgroundSpace, PreparedEstimator
from dacore.errors import ShapeError
from dacore.figures.inf_sup import InfSupCurve, draw_inf_sup
from dacore.figures.spectrum import Spectrum, draw_singular_values, draw_tails
from dacore.figures.style import look
from dacore.plotting.axes import axes_for
from dacore.studies.outcomes import Judged
from dacore.workflow.session import Session

Spaces: TypeAlias = PreparedEstimator | Judged | BackgroundSpace
_SIZE = (5.2, 3.4)


def plot_spectrum(
    subject: Session | Background | Spaces | Mapping[str, Spaces],
    ax: Axes | None = None,
    *,
    tails: bool = False,
    largest: int | None = None,
) -> Axes:
    """Draw singular values: of each field of a training set, or of the spaces of estimators.

    Parameters
    ----------
    subject : Session, Background, PreparedEstimator, Judged, BackgroundSpace, or mapping of str to those with spaces
        Of a family of spaces, one a phase, the range and the median are drawn.
    ax : Axes, optional
        Where to draw; a figure of its own by default.
    tails : bool
        Draw what n modes leave out, ε̂_n, instead of σ_i/σ_1.
    largest : int, optional
        Last index shown.

    Returns
    -------
    Axes

    Raises
    ------
    ShapeError
        If there are no spaces.
    """
    found = subject.background if isinstance(subject, Session) else subject
    if isinstance(found, Background):
        spectra = [Spectrum(f.name, found.bases[f.name].singular_values) for f in found.space.fields]
    else:
        spectra = []
        for label, spaces in _families(found).items():
            shortest = min(len(space.singular_values) for space in spaces)
            spectra.append(Spectrum(label, np.stack([space.singular_values[:shortest] for space in spaces])))
    with look():
        drawn = axes_for(ax, *_SIZE)
        (draw_tails if tails else draw_singular_values)(drawn, spectra, largest)
        if len(spectra) > 1 or spectra[0].label:
            drawn.legend()
    return drawn


def plot_inf_sup(subject: Spaces | Mapping[str, Spaces], ax: Axes | None = None) -> Axes:
    """Draw the stability constants β_n against n.

    Parameters
    ----------
    subject : PreparedEstimator, Judged, BackgroundSpace, or mapping of str to these
        Of a family of spaces, one a phase, the range and the median are drawn.
    ax : Axes, optional
        Where to draw; a figure of its own by default.

    Returns
    -------
    Axes

    Raises
    ------
    ShapeError
        If there are no spaces.
    """
    curves = []
    for label, spaces in _families(subject).items():
        n = min(len(space.inf_sup) for space in spaces)
        curves.append(InfSupCurve(label, np.arange(1, n + 1), np.stack([space.inf_sup[:n] for space in spaces])))
    with look():
        drawn = axes_for(ax, *_SIZE)
        draw_inf_sup(drawn, curves)
        if any(curve.label for curve in curves):
            drawn.legend()
    return drawn


def _families(subject: Spaces | Mapping[str, Spaces]) -> dict[str, tuple[BackgroundSpace, ...]]:
    given = subject if isinstance(subject, Mapping) else {"": subject}
    found = {}
    for label, each in given.items():
        if isinstance(each, BackgroundSpace):
            spaces: tuple[BackgroundSpace, ...] = (each,)
        else:
            spaces = each.spaces if isinstance(each, Judged) else each.spaces()
        if not spaces:
            raise ShapeError(
                f"{type(each).__name__}{f' {label!r}' if label else ''}: has no background spaces; give an estimator "
                "of the PBDW family, or a Background for the spectrum of the training set"
            )
        found[label] = spaces
    return found
