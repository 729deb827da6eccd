"""Errors of estimates of trajectories that lie in the span of a background: no state is needed.

With b the coefficients of 1, ‖Φa − c‖² = ‖a − c b‖² + c²(‖1‖² − ‖b‖²) is the distance of a field from a constant c,
exactly, whether or not 1 is in the span; the rest is that of `dacore.studies.errors.ProjectedErrors`.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.observation import Functionals
from dacore.errors import ShapeError
from dacore.studies.errors import JOINT, Contrast, ErrorMeter, ProjectedErrors
from dacore.studies.reference import Reference


class SpanErrors:
    """Ratios of space–time norms, in the inner product of the background's bases.

    Parameters
    ----------
    background : Background
    functionals : Functionals
        That the estimates were made from.
    coefficients : (r, t, k) array
        True trajectories, at all times of the background.
    contrasts : sequence of Contrast
    weights : mapping of str to float
        Of the fields in the joint norm.

    Attributes
    ----------
    labels : tuple of str
        Names of the errors.
    """

    def __init__(
        self,
        background: Background,
        functionals: Functionals,
        coefficients: Array,
        contrasts: Sequence[Contrast],
        weights: Mapping[str, float],
    ) -> None:
        shape = (background.dimension, len(background.times))
        if coefficients.ndim != 3 or coefficients.shape[:2] != shape:
            raise ShapeError(f"trajectories: got shape {coefficients.shape}, expected ({shape[0]}, {shape[1]}, any)")
        space, shape = background.space, coefficients.shape[1:]
        self._background, self._coefficients = background, coefficients
        self._meter = ErrorMeter(space, background.kind, contrasts, weights)
        self.labels = self._meter.labels
        norms = {
            field.name: np.sqrt((coefficients[background.block(field.name)] ** 2).sum(axis=0)) for field in space.fields
        }
        for contrast in contrasts:
            norms[contrast.label] = distance(background, contrast, coefficients)
        # Nothing of the truth is left over, and nothing of that is seen.
        nothing = np.zeros(shape)
        rest = {field.name: nothing for field in space.fields}
        unseen = np.broadcast_to(0.0, (functionals.count, *shape))
        seen = {
            field.name: unseen for field in space.fields if functionals.matrix[:, space.layout.block(field.name)].nnz
        }
        self._projected = ProjectedErrors(background, functionals, Reference(coefficients, rest, seen, norms))
        self._norms = norms | {JOINT: self._meter.joint(norms)}

    def __call__(self, estimate: Estimate) -> dict[str, Array]:
        """Ratios (k,) of every label; NaN where the truth is zero."""
        if estimate.n_series != self._coefficients.shape[2]:
            raise ShapeError(
                f"estimate: got {estimate.n_series} series, expected {self._coefficients.shape[2]} as the truth"
            )
        below = {label: self._norms[label][estimate.steps] for label in self.labels}
        # A correction in another product, or from other data, has no short cut.
        norms = self._projected.norms(estimate) if self._projected.covers(estimate) else self._lifted(estimate)
        above = self._meter.complete(norms)
        out = {}
        for label in self.labels:
            top, bottom = (np.sqrt((each[label] ** 2).sum(axis=0)) for each in (above, below))
            out[label] = np.divide(top, bottom, out=np.full_like(top, np.nan), where=bottom > 0)
        return out

    def _lifted(self, estimate: Estimate) -> dict[str, Array]:
        """Norms (t, k) of the error of each field, one series at a time in memory."""
        rows = []
        for k in range(estimate.n_series):
            truth = self._background.lift(self._coefficients[:, estimate.steps, k])
            rows.append(self._meter.norms(truth - estimate.state(series=k)))
        return {name: np.stack([row[name] for row in rows], axis=1) for name in rows[0]}


def distance(background: Background, contrast: Contrast, coefficients: Array) -> Array:
    """Norm (t, k) of a field less a constant, of trajectories (r, t, k) in the span."""
    basis = background.bases[contrast.field]
    one = np.ones(basis.basis.shape[0])
    along = basis.project(one)
    left = one - basis.lift(along)
    rest = max(float(left @ (basis.product @ left)), 0.0)
    away = coefficients[background.block(contrast.field)] - contrast.constant * along[:, None, None]
    return np.asarray(np.sqrt((away**2).sum(axis=0) + contrast.constant**2 * rest))
