"""How errors are measured: field by field, less a constant, and in the joint norm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dacore.algebra.gram import RieszMap
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.observation import Functionals
from dacore.core.space import Product, StateSpace

if TYPE_CHECKING:
    from dacore.studies.reference import Reference

JOINT = "joint"


@dataclass(frozen=True)
class Contrast:
    """An error of a field relative to its distance from a constant: p − p_csf."""

    label: str
    field: str
    constant: float


class ErrorMeter:
    """Relative errors of fields, contrasts and the joint state, step by step.

    Parameters
    ----------
    space : StateSpace
    kind : {"l2", "h1"}
    contrasts : sequence of Contrast
    weights : mapping of str to float
        Of the fields in the joint norm.

    Attributes
    ----------
    own_labels : tuple of str
        Names of the errors of fields and contrasts.
    labels : tuple of str
        These, and "joint" where there are several fields.
    """

    def __init__(
        self, space: StateSpace, kind: Product, contrasts: Sequence[Contrast], weights: Mapping[str, float]
    ) -> None:
        self.space, self.kind, self.contrasts, self.weights = space, kind, contrasts, weights
        names = [field.name for field in space.fields]
        self.own_labels = (*names, *(contrast.label for contrast in contrasts))
        self.labels = (*self.own_labels, *((JOINT,) if len(names) > 1 else ()))

    def norms(self, states: Array) -> dict[str, Array]:
        """Norm (t,) of each field of states (n_dofs, t)."""
        out = {}
        for field in self.space.fields:
            product = self.space.scalar_product(field.name, self.kind)
            total = np.zeros(states.shape[1])
            for component in range(field.components):
                part = states[self.space.layout.component(field.name, component)]
                total += np.einsum("ij,ij->j", part, product @ part)
            out[field.name] = np.sqrt(np.maximum(total, 0.0))
        return out

    def reference(self, states: Array) -> dict[str, Array]:
        """Return what each error is relative to, (t,), for a true trajectory (n_dofs, t)."""
        out = self.norms(states)
        for contrast in self.contrasts:
            product = self.space.scalar_product(contrast.field, self.kind)
            total = np.zeros(states.shape[1])
            for component in range(self.space.layout.field(contrast.field).components):
                part = states[self.space.layout.component(contrast.field, component)] - contrast.constant
                total += np.einsum("ij,ij->j", part, product @ part)
            out[contrast.label] = np.sqrt(np.maximum(total, 0.0))
        out[JOINT] = self.joint(out)
        return out

    def errors(self, difference: Array, reference: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
        """For each label, the norm of the difference and what it is relative to, both (t,)."""
        norms = self.complete(self.norms(difference))
        return {label: (norms[label], reference[label]) for label in self.labels}

    def complete(self, norms: Mapping[str, Array]) -> dict[str, Array]:
        """Norms of the error of every label, from those of the fields: a constant changes no difference."""
        out = dict(norms)
        for contrast in self.contrasts:
            out[contrast.label] = out[contrast.field]
        out[JOINT] = self.joint(out)
        return out

    def joint(self, norms: Mapping[str, Array]) -> Array:
        """Norm of the joint state, from those of the fields."""
        squares = sum(self.weights[f.name] * norms[f.name] ** 2 for f in self.space.fields)
        return np.asarray(np.sqrt(squares))


class ProjectedErrors:
    """Errors of estimates without lifting a state, in the inner product of the background's bases.

    For an estimate Φa + M⁻¹ℓᵀz and a truth Φa* + ρ, ρ orthogonal to Φ, the squared error of a field is::

        ‖a* − a‖² + ‖ρ‖² + (zᵀKz − 2 zᵀ(ℓΦ(a* − a) + ℓ(ρ))) / w

    with the field's weight w in M and its part K of the Gram matrix. The last term is what the correction
    mends of the first two; where it mends nearly all, an error of it below 1e-8 of what it mends is round-off.

    Parameters
    ----------
    background : Background
    functionals : Functionals
    reference : Reference
    """

    def __init__(self, background: Background, functionals: Functionals, reference: "Reference") -> None:
        self.background, self.functionals, self.reference = background, functionals, reference
        self._observed = background.observe(functionals.matrix)

    def covers(self, estimate: Estimate) -> bool:
        """Whether the estimate has this form: of this background, its correction in the same product and data."""
        if estimate.background is not self.background:
            return False
        if estimate.correction is None or estimate.riesz is None:
            return True
        riesz = estimate.riesz
        return (
            type(riesz) is RieszMap
            and riesz.functionals is self.functionals
            and riesz.space is self.background.space
            and riesz.kind == self.background.kind
        )

    def norms(self, estimate: Estimate) -> dict[str, Array]:
        """Norm (t, k) of the error of each field, for k series in the order of the cases."""
        out = {}
        away = self.reference.coefficients[:, estimate.steps] - estimate.coefficients
        for field in self.background.space.fields:
            block = self.background.block(field.name)
            square = (away[block] ** 2).sum(axis=0) + self.reference.rest[field.name][estimate.steps]
            if estimate.correction is not None and field.name in self.reference.seen:
                square = square + self._mended(estimate, field.name, away[block])
            out[field.name] = np.sqrt(np.maximum(square, 0.0))
        return out

    def _mended(self, estimate: Estimate, field: str, away: Array) -> Array:
        """What the correction adds (t, k) to the squared error of a field that the background alone leaves."""
        riesz = estimate.riesz
        if not isinstance(riesz, RieszMap) or estimate.correction is None:
            return np.zeros(away.shape[1:])
        z = estimate.correction
        flat = z.reshape(len(z), -1)
        missed = np.tensordot(self._observed[:, self.background.block(field)], away, axes=1)
        missed += self.reference.seen[field][:, estimate.steps]
        change = riesz.field_gram(field) @ flat - 2.0 * missed.reshape(flat.shape)
        return np.asarray(np.einsum("mj,mj->j", flat, change).reshape(z.shape[1:]) / riesz.weights[field])
