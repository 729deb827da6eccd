"""Discretisation error in time: the same model with its steps divided.

A reconstruction error against a truth computed with the same steps says nothing about the error
of those steps; this study measures it beside every reconstruction (docs/method.md: Time).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dacore.core.model import ForwardModel
from dacore.core.parameters import Parameters
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
        On the same space; `fine` records `factor` times as many steps.
    parameters : mapping of str to float
    factor : int
    meter : ErrorMeter
        Measures the difference; the finer computation is the reference.
    """
    one, other = coarse.solve(parameters).states, fine.solve(parameters).states[:, factor - 1 :: factor]
    pairs = meter.errors(one - other, meter.reference(other))
    differences = {
        label: float(np.sqrt((above**2).sum() / (below**2).sum())) for label, (above, below) in pairs.items()
    }
    return Refinement(factor, differences, dict(parameters))
