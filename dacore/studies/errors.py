"""How errors are measured: field by field, less a constant, and in the joint norm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.space import Product, StateSpace

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
    labels : tuple of str
        Names of the errors: fields, contrasts, and "joint" where there are several fields.
    """

    def __init__(
        self, space: StateSpace, kind: Product, contrasts: Sequence[Contrast], weights: Mapping[str, float]
    ) -> None:
        self.space, self.kind, self.contrasts, self.weights = space, kind, contrasts, weights
        names = [field.name for field in space.fields]
        joint = (JOINT,) if len(names) > 1 else ()
        self.labels = (*names, *(contrast.label for contrast in contrasts), *joint)

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
            shifted = states.copy()
            shifted[self.space.layout.block(contrast.field)] -= contrast.constant
            out[contrast.label] = self.norms(shifted)[contrast.field]
        out[JOINT] = self._joint(out)
        return out

    def errors(self, difference: Array, reference: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
        """For each label, the norm of the difference and what it is relative to, both (t,)."""
        norms = self.norms(difference)
        for contrast in self.contrasts:
            norms[contrast.label] = norms[contrast.field]
        norms[JOINT] = self._joint(norms)
        return {label: (norms[label], reference[label]) for label in self.labels}

    def _joint(self, norms: Mapping[str, Array]) -> Array:
        squares = sum(self.weights[f.name] * norms[f.name] ** 2 for f in self.space.fields)
        return np.asarray(np.sqrt(squares))
