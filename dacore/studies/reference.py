"""What judging an estimate needs of the unseen cases: their exact data, and themselves in small coordinates.

A trajectory y is read once and not needed again: with the projection Πy = Φa* onto the background's
bases and the rest ρ = y − Πy, the error of an estimate Φa + M⁻¹ℓᵀz is a matter of a*, ‖ρ‖² and ℓ(ρ)
(`dacore.studies.errors.ProjectedErrors`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.display import Displayed
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.core.space import StateSpace
from dacore.studies.errors import Contrast, ErrorMeter

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False, repr=False)
class Measured(Displayed):
    """What is measured and asked of the unseen cases, without noise.

    Parameters
    ----------
    data : (m, t, k) array
    quantities : mapping of str to (s, k) array
    """

    data: Array
    quantities: Mapping[str, Array]


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Displayed):
    """The unseen cases in the coordinates of a background, and how large they are.

    Parameters
    ----------
    coefficients : (r, t, k) array
        a* = Πy in the background's bases.
    rest : mapping of str to (t, k) array
        ‖ρ‖² of each field in the bases' inner product.
    seen : mapping of str to (m, t, k) array
        ℓ(ρ) of each field that the functionals see, the other fields being zero.
    norms : mapping of str to (t, k) array
        What the error of each field and contrast is relative to.
    """

    coefficients: Array
    rest: Mapping[str, Array]
    seen: Mapping[str, Array]
    norms: Mapping[str, Array]


def measure(
    space: StateSpace,
    functionals: Functionals,
    truths: Iterable[Trajectory],
    quantities: Mapping[str, QuantityOfInterest],
) -> Measured:
    """Measure true trajectories, each read once.

    Parameters
    ----------
    space : StateSpace
    functionals : Functionals
    truths : iterable of Trajectory
    quantities : mapping of str to QuantityOfInterest
    """
    asked = {name: (quantity, quantity.functionals(space)) for name, quantity in quantities.items()}
    data: list[Array] = []
    values: dict[str, list[Array]] = {name: [] for name in asked}
    for truth in truths:
        data.append(functionals(truth.states))
        for name, (quantity, seen) in asked.items():
            weights = quantity.time_weights(truth.states.shape[1])
            values[name].append(np.einsum("ot,st->so", weights, seen(truth.states)).reshape(-1))
    return Measured(np.stack(data, axis=2), {name: np.stack(each, axis=1) for name, each in values.items()})


def project(
    background: Background,
    functionals: Functionals,
    truths: Sequence[Trajectory],
    contrasts: Sequence[Contrast],
    progress: Progress | None = None,
) -> Reference:
    """Project true trajectories, each read once and one at a time in memory.

    Parameters
    ----------
    background : Background
    functionals : Functionals
    truths : sequence of Trajectory
    contrasts : sequence of Contrast
    progress : callable, optional
    """
    space, count, steps = background.space, len(truths), len(background.times)
    meter = ErrorMeter(space, background.kind, contrasts, {f.name: 1.0 for f in space.fields})
    columns = {f.name: functionals.matrix[:, space.layout.block(f.name)] for f in space.fields}
    seen = {name: np.empty((functionals.count, steps, count)) for name, part in columns.items() if part.nnz}
    coefficients = np.empty((background.dimension, steps, count))
    rest = {f.name: np.empty((steps, count)) for f in space.fields}
    norms: dict[str, Array] = {label: np.empty((steps, count)) for label in meter.own_labels}
    for k, truth in enumerate(truths):
        for label, values in meter.reference(truth.states).items():
            if label in norms:
                norms[label][:, k] = values
        for field in space.fields:
            name, basis = field.name, background.bases[field.name]
            part = truth.states[space.layout.block(name)]
            found = basis.project(part)
            left = part - basis.lift(found)
            # Projecting the rest again makes it orthogonal to round-off of its own size, not of the state's.
            more = basis.project(left)
            left -= basis.lift(more)
            coefficients[background.block(name), :, k] = found + more
            rest[name][:, k] = np.maximum(np.einsum("ij,ij->j", left, basis.product @ left), 0.0)
            if name in seen:
                seen[name][:, :, k] = columns[name] @ left
        if progress:
            progress(k + 1, count)
    return Reference(coefficients, rest, seen, norms)
