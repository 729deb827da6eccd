"""A trained reduced model as what an estimator sees of it: from parameters to trajectories in a background's bases."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dacore.core.arrays import Array
from dacore.core.background import Background, ParametricMap
from dacore.core.parameters import ParameterSpace
from dacore.errors import ShapeError
from dacore.reduction.coarse import coarse
from dacore.reduction.model import ReducedModel
from dacore.reduction.response import ReducedResponse

# Reduced states of so many bytes at a time are turned into coefficients.
_CHUNK_BYTES = 256 * 2**20


@dataclass(frozen=True, eq=False)
class ReducedForward(ParametricMap):
    """Trajectories of a reduced model in the bases of its background.

    Points that differ in amplitudes of loads only share one factorisation of the step, so that a parameter that
    acts through loads alone costs next to nothing.

    Parameters
    ----------
    model : ReducedModel
        Knows the background's bases (`ReducedModel.onto`).
    parameters : ParameterSpace
        Names the columns of points.
    errors : mapping of str to float
        For each field, the relative space–time error to be expected.

    Raises
    ------
    ShapeError
        If the model knows no background.
    """

    model: ReducedModel
    parameters: ParameterSpace
    errors: Mapping[str, float]

    def __post_init__(self) -> None:
        if self.model.onto is None:
            raise ShapeError("reduced model: knows no background; give it one by ReducedModel.on")

    def coefficients(self, points: Array) -> Array:
        """Trajectories (r, t, k), in the bases and at the times of the background, of parameters (k, n_parameters)."""
        given = np.asarray(points, dtype=np.float64)
        width = len(self.parameters.parameters)
        if given.ndim != 2 or given.shape[1] != width:
            raise ShapeError(f"points: got shape {given.shape}, expected (any, {width}) = (points, parameters)")
        onto = np.asarray(self.model.onto)
        times = len(self.model.times)
        out = np.empty((len(onto), times, len(given)))
        step = max(int(_CHUNK_BYTES / (8 * onto.shape[1] * times)), 1)
        for first in range(0, len(given), step):
            part = slice(first, first + step)
            states = self.model.solve([self.parameters.as_mapping(row) for row in given[part]])
            out[:, :, part] = np.tensordot(onto, states, axes=1)
        return out

    def coarse(self, points: Array, tolerance: float) -> "ReducedForward":
        """Return the map on the modes that its trajectories at points (k, n_parameters) need; see `coarse`.

        That of a motion at one frequency stays as it is: two phases of a few points span too little.
        """
        if isinstance(self.model.march, ReducedResponse):
            return self
        mappings = [self.parameters.as_mapping(row) for row in points]
        return replace(self, model=coarse(self.model, mappings, tolerance))

    @property
    def accuracy(self) -> Mapping[str, float]:
        """For each field, the relative space–time error that is to be expected of a trajectory."""
        return self.errors


def with_forward(background: Background, model: ReducedModel, estimates: Array) -> Background:
    """Return the background with the map that its trajectories came from.

    Parameters
    ----------
    background : Background
    model : ReducedModel
        Knows the background's bases.
    estimates : (n_fields, K) array
        Estimated relative error of each sample; the root of their mean square is what is to be expected, together
        with what the background's compression leaves.
    """
    expected = np.sqrt((estimates**2).mean(axis=1))
    errors = {
        name: float(np.hypot(error, background.compression[name]))
        for name, error in zip(model.fields, expected, strict=True)
    }
    return replace(background, forward=ReducedForward(model, background.parameters, errors))
