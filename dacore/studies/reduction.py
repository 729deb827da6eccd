"""How far a reduced model is from the full one, on the unseen cases that validation solves in full anyway."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.display import Displayed
from dacore.core.parameters import Parameters
from dacore.errors import ShapeError
from dacore.reduction.model import ReducedModel
from dacore.studies.errors import Contrast
from dacore.studies.reference import Reference


@dataclass(frozen=True, eq=False, repr=False)
class UnseenErrors(Displayed):
    """A reduced model on unseen cases.

    Parameters
    ----------
    true : mapping of str to (k,) array
        Relative space–time error of each field, and of each contrast, against the full model.
    estimated : mapping of str to (k,) array
        What the reduced model itself estimates, for each field.
    """

    true: Mapping[str, Array]
    estimated: Mapping[str, Array]

    @property
    def effectivity(self) -> dict[str, Array]:
        """Estimate by true error (k,) of each field; NaN where there is no error."""
        return {
            name: np.divide(values, self.true[name], out=np.full_like(values, np.nan), where=self.true[name] > 0)
            for name, values in self.estimated.items()
        }


def unseen_errors(
    model: ReducedModel,
    background: Background,
    reference: Reference,
    points: Sequence[Parameters],
    contrasts: Sequence[Contrast] = (),
    less_mean: Sequence[str] = (),
) -> UnseenErrors:
    """Compare reduced with full trajectories, which are known by their projection and what it leaves.

    Parameters
    ----------
    model : ReducedModel
        That knows the bases of the background (`ReducedModel.onto`).
    background : Background
    reference : Reference
        The unseen cases in these bases.
    points : sequence of k mappings of str to float
        Their parameters.
    contrasts : sequence of Contrast
        Of `reference`: an error is the same for a field and for the field less a constant, its size is not.
    less_mean : sequence of str
        Fields that the background and the reference hold less their mean over the steps.
    """
    if model.onto is None:
        raise ShapeError("reduced model: it knows no background; make it by dacore.reduction.training.train_reduced")
    states, estimated = model.estimate(points)
    difference = background.without_mean(np.tensordot(model.onto, states, axes=1), less_mean) - reference.coefficients
    labels = {name: name for name in model.fields} | {each.label: each.field for each in contrasts}
    true = {}
    for label, field in labels.items():
        squares = (difference[background.block(field)] ** 2).sum(axis=(0, 1)) + reference.rest[field].sum(axis=0)
        true[label] = np.sqrt(squares / (reference.norms[label] ** 2).sum(axis=0))
    return UnseenErrors(true, dict(zip(model.fields, estimated, strict=True)))
