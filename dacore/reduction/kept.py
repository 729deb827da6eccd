"""Reduced training on disk: the reduced model's arrays and its background, in one sealed file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dacore.core.arrays import Array
from dacore.core.parameters import ParameterSpace
from dacore.errors import DacoreError, StoreError
from dacore.io.arrays import read_arrays, write_arrays
from dacore.io.background import background_of, background_parts
from dacore.reduction.forward import with_forward
from dacore.reduction.galerkin import Tested, TestedTerm
from dacore.reduction.greedy import Round
from dacore.reduction.indicator import Indicator
from dacore.reduction.kinds import Reducible, affine_of, reduced_solver
from dacore.reduction.model import ReducedModel
from dacore.reduction.training import Reduced

MAGIC = "dacore reduced training 2"


def write_reduced(reduced: Reduced, path: Path) -> None:
    """Write a reduced training; the file appears whole or not at all."""
    model = reduced.model
    arrays, facts = background_parts(reduced.background)
    for title, tested in (("step", model.march.tested), ("tests", model.indicator.tested)):
        arrays |= _tested_arrays(title, tested)
    arrays |= {f"lift.{name}": values for name, values in model.lift_products.items()}
    arrays |= {f"gram.{name}": values for name, values in model.lift_grams.items()}
    arrays |= {"onto": model.onto, "factor": model.indicator.factor, "initial": model.march.start}
    arrays |= {"solved": reduced.solved, "estimates": reduced.estimates}
    for k, each in enumerate(reduced.rounds):
        arrays |= {f"round.{k}.{name}": getattr(each, name) for name in ("true", "estimated", "worst")}
    facts |= {
        "flow": model.march.flow,
        "motions": reduced.motions,
        "orders": [term.order for term in model.march.tested.terms],
        "rounds": [{"solved": each.solved, "modes": dict(each.modes)} for each in reduced.rounds],
        "columns": _bounds(model.march.tested.columns),
        "test_rows": _bounds(model.indicator.tested.rows),
    }
    write_arrays(path, MAGIC, arrays, facts)


def read_reduced(path: Path, model: Reducible, parameters: ParameterSpace) -> Reduced:
    """Read the reduced training of `model`; StoreError if the file is damaged or of another model."""
    arrays, facts = read_arrays(path, MAGIC)
    try:
        background = background_of(arrays, facts, model.space, parameters)
        columns = {name: slice(*ends) for name, ends in facts["columns"].items()}
        rows = {name: slice(*ends) for name, ends in facts["test_rows"].items()}
        orders = [int(order) for order in facts["orders"]]
        step = _tested("step", arrays, orders, columns, columns)
        tests = _tested("tests", arrays, orders, rows, columns)
        flow = tuple(bool(each) for each in facts["flow"])
        reduced = ReducedModel(
            affine_of(model),
            reduced_solver(model, step, flow, arrays["initial"]),
            Indicator(tests, arrays["factor"]),
            {name: arrays[f"lift.{name}"] for name in columns},
            {name: arrays[f"gram.{name}"] for name in columns},
            arrays["onto"],
        )
        rounds = tuple(
            Round(
                tuple(each["solved"]), each["modes"],
                *(arrays[f"round.{k}.{name}"] for name in ("true", "estimated", "worst")),
            )
            for k, each in enumerate(facts["rounds"])
        )  # fmt: skip
        return Reduced(
            with_forward(background, reduced, arrays["estimates"]), reduced, rounds,
            arrays["solved"].astype(np.int64), int(facts["motions"]), arrays["estimates"],
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, DacoreError) as error:
        raise StoreError(f"{path}: damaged or of another model ({error}); delete it and run again") from error


def _bounds(slices: Mapping[str, slice]) -> dict[str, tuple[int, int]]:
    return {name: (each.start, each.stop) for name, each in slices.items()}


def _tested_arrays(title: str, tested: Tested) -> dict[str, Array]:
    arrays = {f"{title}.forces": tested.forces}
    for k, term in enumerate(tested.terms):
        arrays[f"{title}.{k}.lifted"] = term.lifted
        arrays |= {f"{title}.{k}.block.{row}.{column}": block for (row, column), block in term.blocks.items()}
    return arrays


def _tested(
    title: str, arrays: Mapping[str, Array], orders: list[int], rows: dict[str, slice], columns: dict[str, slice]
) -> Tested:
    terms = []
    for k, order in enumerate(orders):
        blocks = {
            (row, column): arrays[name]
            for row in rows
            for column in columns
            if (name := f"{title}.{k}.block.{row}.{column}") in arrays
        }
        terms.append(TestedTerm(order, blocks, arrays[f"{title}.{k}.lifted"]))
    return Tested(tuple(terms), arrays[f"{title}.forces"], rows, columns)
