"""Discretisation error in time: the same model with its steps divided.

A reconstruction error against a truth computed with the same steps says nothing about the error
of those steps; this study measures it beside every reconstruction (METHOD: time integration).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dacore.core.model import ForwardModel
from dacore.core.parameters import Parameters


@dataclass(frozen=True)
class Refinement:
    """Relative space–time difference from a finer computation at the recorded times.

    Parameters
    ----------
    factor : int
        The finer computation has this many steps for each.
    differences : mapping of str to float
        For each field.
    parameters : mapping of str to float
        Where it was measured.
    """

    factor: int
    differences: Mapping[str, float]
    parameters: Mapping[str, float]


def time_refinement(coarse: ForwardModel, fine: ForwardModel, parameters: Parameters, factor: int) -> Refinement:
    """Compare a model with one of finer steps at the coarse model's recorded times.

    Parameters
    ----------
    coarse, fine : ForwardModel
        On the same space; `fine` records `factor` times as many steps.
    parameters : mapping of str to float
    factor : int
    """
    one, other = coarse.solve(parameters).states, fine.solve(parameters).states[:, factor - 1 :: factor]
    space = coarse.space
    differences = {}
    for field in space.fields:
        product = space.field_product(field.name)
        block = space.layout.block(field.name)
        error, size = one[block] - other[block], other[block]
        ratio = np.einsum("ij,ij->", error, product @ error) / np.einsum("ij,ij->", size, product @ size)
        differences[field.name] = float(np.sqrt(ratio))
    return Refinement(factor, differences, dict(parameters))
