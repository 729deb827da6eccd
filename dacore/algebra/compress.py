"""From training trajectories to a Background: one POD for each field."""

from collections.abc import Sequence

import numpy as np

from dacore.algebra.pod import pod
from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.parameters import ParameterSpace
from dacore.core.space import Product, StateSpace
from dacore.errors import ShapeError


def compress(
    space: StateSpace,
    trajectories: Sequence[Array],
    times: Array,
    parameters: ParameterSpace,
    samples: Array,
    tolerance: float = 1e-7,
    kind: Product = "l2",
) -> Background:
    """Compress training trajectories field by field.

    The fields are decomposed apart, because a joint basis would have to choose the weight ζ
    between them before anyone knows what is measured; see `dacore.core.background`.

    Parameters
    ----------
    space : StateSpace
    trajectories : K arrays (n_dofs, t)
    times : (t,) array [s]
    parameters : ParameterSpace
    samples : (K, n_parameters) array
    tolerance : float
        Relative mean-square error of each field.
    kind : {"l2", "h1"}
    """
    if not trajectories:
        raise ShapeError("training: got no trajectory, expected at least one")
    bases, parts, reached = {}, [], {}
    for field in space.fields:
        block = space.layout.block(field.name)
        data = np.concatenate([trajectory[block] for trajectory in trajectories], axis=1)
        basis = pod(data, space.field_product(field.name, kind), tolerance)
        coefficients = basis.project(data)
        total = float(np.einsum("ij,ij->", data, basis.product @ data))
        reached[field.name] = float(np.sqrt(max(1.0 - (coefficients**2).sum() / total, 0.0)))
        bases[field.name] = basis
        parts.append(coefficients.reshape(basis.dimension, len(trajectories), -1).swapaxes(1, 2))
    return Background(space, bases, np.concatenate(parts), times, parameters, samples, kind, reached)

