"""Discretisation error in time: the same model with its steps divided.

A reconstruction error against a truth computed with the same steps says nothing about the error
of those steps; this study measures it beside every reconstruction (docs/method.md: Time).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import Parameters
from dacore.errors import ShapeError
from dacore.studies.errors import ErrorMeter


@dataclass(frozen=True)
class Refinement:
    """Relative space–time difference from a finer computation at the recorded times.

    Parameters
    ----------
    factor : int
        The finer computation has this many steps for each.
    differences : mapping of str to float
        For each field and contrast.
    parameters : mapping of str to float
        Where it was measured.
    """

    factor: int
    differences: Mapping[str, float]
    parameters: Mapping[str, float]


def time_refinement(
    coarse: ForwardModel, fine: ForwardModel, parameters: Parameters, factor: int, meter: ErrorMeter
) -> Refinement:
    """Compare a model with one of finer steps at the coarse model's recorded times.

    Parameters
    ----------
    coarse, fine : ForwardModel
        On the same space; what `fine` records besides the coarse model's times is left out.
    parameters : mapping of str to float
    factor : int
    meter : ErrorMeter
        Measures the difference; the finer computation is the reference.

    Raises
    ------
    ShapeError
        If the finer model does not record every time of the coarse one.
    """
    one, other = coarse.solve(parameters).states, _at_times(fine.solve(parameters), coarse.times)
    pairs = meter.errors(one - other, meter.reference(other))
    differences = {
        label: float(np.sqrt((above**2).sum() / (below**2).sum())) for label, (above, below) in pairs.items()
    }
    return Refinement(factor, differences, dict(parameters))


def _at_times(trajectory: Trajectory, times: Array) -> Array:
    """States (n_dofs, t) at times that a trajectory recorded, to a millionth of their distance."""
    nearest = np.abs(trajectory.times[None, :] - times[:, None]).argmin(axis=1)
    if not np.allclose(trajectory.times[nearest], times, rtol=0.0, atol=1e-6 * float(times[-1]) / len(times)):
        raise ShapeError("refinement: the finer model does not record all times of the coarse one")
    return np.asarray(trajectory.states[:, nearest])
