"""Errors of any estimate of a scene's unseen cases, as its validation measures them."""

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.errors import ShapeError
from dacore.studies.errors import JOINT, ErrorMeter, ProjectedErrors
from dacore.studies.validation import PRODUCT, Judge
from dacore.workflow.session import Session


class Judging:
    """Measures errors on the unseen cases of a scene.

    Parameters
    ----------
    session : Session
    background : Background, optional
        Of the estimates; that of the scene by default.

    Attributes
    ----------
    judge : Judge
    labels : list of str
        Of the errors, the joint one left out.

    Raises
    ------
    ShapeError
        If the scene asks for numbers of interest alone.
    """

    def __init__(self, session: Session, background: Background | None = None) -> None:
        if not session.scene.report.states:
            raise ShapeError("got report.states = false, but this study measures errors of fields; set it to true")
        own = session.background if background is None else background
        contrasts = session.builder.contrasts(session.model.space, session.parameters)
        meter = ErrorMeter(session.model.space, PRODUCT, contrasts, session.validation.joint_weights)
        projected = None
        if own is session.background and own.kind == PRODUCT:
            projected = ProjectedErrors(own, session.functionals, session.runner["reference"])
        self.judge = Judge(session.runner["measured"], session.quantities, meter, projected, lambda: session.truth)
        self.labels = [label for label in meter.labels if label != JOINT]
        self._quantities = list(session.quantities)

    def errors(self, estimate: Estimate) -> tuple[dict[str, Array], dict[str, Array]]:
        """Relative space–time errors (k,) by label, and errors (s, k) by quantity."""
        return self.judge.errors(estimate)

    def means(self, estimate: Estimate) -> tuple[list[float], list[float]]:
        """Mean error of each label, and root mean square error of each quantity."""
        errors, values = self.judge.errors(estimate)
        return (
            [float(errors[label].mean()) for label in self.labels],
            [float(np.sqrt((values[name] ** 2).mean())) for name in self._quantities],
        )
