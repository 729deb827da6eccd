"""A reduced model on fewer coordinates: the modes that its own trajectories use most, for those who ask it often.

Each field's coordinates are replaced by the leading principal directions of what they do over all marched steps of
some trajectories, beside their mean; the model is projected on them as it was on its modes, so that its steps keep
their structure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dacore.core.arrays import Array
from dacore.core.parameters import Parameters
from dacore.reduction.galerkin import Tested, TestedTerm, slices
from dacore.reduction.model import ReducedModel
from dacore.reduction.solver import Balance
from dacore.reduction.split import amplitudes_of, coefficients_of

# Best approximations relative to the error aimed at; measured on brains of 5k nodes, at rest and spun up.
_FLOW, _MOTION = 0.3, 3e-4


def coarse(model: ReducedModel, points: Sequence[Parameters], tolerance: float) -> ReducedModel:
    """Return the model on the coordinates that trajectories of some parameters need.

    Parameters
    ----------
    model : ReducedModel
    points : sequence of mappings of str to float
        Should reach as far as the parameters for which the model will be asked.
    tolerance : float
        Error of trajectories that is aimed at, for each field relative to what it varies over time and parameters.
        Best approximations are finer: those of fields that move with inertia or stiffness a thousand times, since
        pressures follow from small differences of them.
    """
    flow = dict(zip(model.fields, model.march.flow, strict=True))
    grams = {name: np.zeros((each.stop - each.start,) * 2) for name, each in model.march.tested.columns.items()}
    sums = {name: np.zeros(len(gram)) for name, gram in grams.items()}
    count = 0
    for point in points:
        states: list[Array] = []

        def watch(_: slice, balance: Balance, kept: list[Array] = states) -> None:
            kept.append(balance.value)

        model.march.run(coefficients_of(model.model, [point]), amplitudes_of(model.model, [point]), watch)
        every = np.concatenate(states, axis=1)
        count += every.shape[1]
        for name, rows in model.march.tested.columns.items():
            grams[name] += every[rows] @ every[rows].T
            sums[name] += every[rows].sum(axis=1)
    driven = any(flow.values())
    directions = {
        name: _directions(
            gram, sums[name] / count, count, tolerance * (_MOTION if driven and not flow[name] else _FLOW)
        )
        for name, gram in grams.items()
    }
    return _on(model, directions)


def _directions(gram: Array, mean: Array, count: int, tolerance: float) -> Array:
    """Orthonormal columns: the mean, and the directions that leave no more than `tolerance` of what varies."""
    squares, vectors = np.linalg.eigh(gram - count * np.outer(mean, mean))
    squares = np.maximum(squares, 0.0)
    keep = np.cumsum(squares) > tolerance**2 * squares.sum()
    found = vectors[:, keep]
    left = mean - found @ (found.T @ mean)
    size = float(np.linalg.norm(left))
    if size > 1e-12 * float(np.linalg.norm(mean)):
        left = left / size
        left -= found @ (found.T @ left)
        found = np.concatenate([found, (left / np.linalg.norm(left))[:, None]], axis=1)
    return np.asarray(found)


def _on(model: ReducedModel, directions: Mapping[str, Array]) -> ReducedModel:
    """Return the model on orthonormal directions (r_f, s_f) of each field's coordinates."""
    tested = model.march.tested
    rows = {name: directions[name] for name in tested.rows}
    onto = model.onto
    if onto is not None:
        parts = [onto[:, tested.columns[name]] @ each for name, each in directions.items()]
        onto = np.concatenate([*parts, onto[:, model.dimension :]], axis=1)
    return replace(
        model,
        march=model.march.on(_projected(tested, rows, directions), rows),
        indicator=replace(model.indicator, tested=_projected(model.indicator.tested, {}, directions)),
        lift_products={name: directions[name].T @ each for name, each in model.lift_products.items()},
        onto=onto,
    )


def _projected(tested: Tested, left: Mapping[str, Array], right: Mapping[str, Array]) -> Tested:
    """Tests combined by columns of `left`, for the groups of rows that it names, on coordinates along `right`."""

    def combined(values: Array) -> Array:
        parts = [
            left[name].T @ values[rows] if name in left else values[rows] for name, rows in tested.rows.items()
        ]  # fmt: skip
        return np.concatenate(parts)

    terms = []
    for term in tested.terms:
        blocks = {}
        for (row, column), block in term.blocks.items():
            made = block @ right[column]
            blocks[row, column] = np.ascontiguousarray(left[row].T @ made if row in left else made)
        terms.append(TestedTerm(term.order, blocks, combined(term.lifted)))
    sizes = {
        name: left[name].shape[1] if name in left else each.stop - each.start for name, each in tested.rows.items()
    }
    columns = slices({name: right[name].shape[1] for name in tested.columns})
    return Tested(tuple(terms), combined(tested.forces), slices(sizes), columns)
