"""What validation keeps on disk: measured and projected cases, and outcomes, as named arrays."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.core.estimator import BackgroundSpace, Estimate, ParameterEstimate
from dacore.core.misfit import Misfit
from dacore.errors import StoreError
from dacore.io.arrays import read_arrays, write_arrays
from dacore.studies.outcomes import Judged, Outcome, QuantityOutcome
from dacore.studies.reference import Measured, Reference
from dacore.studies.refinement import Refinement

MEASURED = "dacore measured cases 1"
REFERENCE = "dacore reference cases 1"
JUDGED = "dacore outcomes 2"
REFINEMENT = "dacore refinement 1"


def write_measured(measured: Measured, path: Path) -> None:
    """Write measured cases; the file appears whole or not at all."""
    write_arrays(path, MEASURED, {"data": measured.data, **_under("q", measured.quantities)})


def read_measured(path: Path) -> Measured:
    """Read measured cases; StoreError if the file is damaged."""
    arrays, _ = read_arrays(path, MEASURED)
    with _complete(path):
        return Measured(arrays["data"], _below("q", arrays))


def write_reference(reference: Reference, path: Path) -> None:
    """Write projected cases; the file appears whole or not at all."""
    parts = {"coefficients": reference.coefficients}
    for name in ("rest", "seen", "norms"):
        parts |= _under(name, getattr(reference, name))
    write_arrays(path, REFERENCE, parts)


def read_reference(path: Path) -> Reference:
    """Read projected cases; StoreError if the file is damaged."""
    arrays, _ = read_arrays(path, REFERENCE)
    with _complete(path):
        return Reference(arrays["coefficients"], *(_below(name, arrays) for name in ("rest", "seen", "norms")))


def write_judged(judged: Judged, path: Path) -> None:
    """Write the outcomes of an estimator, without its estimates; the file appears whole or not at all."""
    arrays: dict[str, Array] = {"inf_sup": judged.inf_sup}
    facts: list[dict[str, Any]] = [
        {"estimator": each.estimator, "noise": each.noise, "seconds": each.seconds} for each in judged.outcomes
    ]
    for k, outcome in enumerate(judged.outcomes):
        arrays |= _under(f"{k}.per_step", outcome.per_step) | _under(f"{k}.space_time", outcome.space_time)
        if outcome.misfit is not None:
            arrays |= _under(f"{k}.misfit", asdict(outcome.misfit))
        if outcome.parameters is not None:
            found = outcome.parameters
            facts[k]["parameters"] = list(found.names)
            parts = {"values": found.values, "covariance": found.covariance, "prior": found.prior}
            arrays |= _under(f"{k}.parameters", parts)
        for part in ("truth", "estimate", "deviation"):
            arrays |= _under(f"{k}.{part}", {name: getattr(q, part) for name, q in outcome.quantities.items()})
    for k, space in enumerate(judged.spaces):
        for part in ("modes", "singular_values", "tails", "inf_sup"):
            arrays[f"space {k}.{part}"] = getattr(space, part)
    write_arrays(path, JUDGED, arrays, {"outcomes": facts, "n": [space.n for space in judged.spaces]})


def read_judged(path: Path, again: Callable[[float], Estimate]) -> Judged:
    """Read outcomes; StoreError if the file is damaged.

    Parameters
    ----------
    path : Path
    again : callable
        Noise level -> the estimate of all cases, called when a state of it is asked for.
    """
    arrays, facts = read_arrays(path, JUDGED)
    with _complete(path):
        outcomes = []
        for k, fact in enumerate(facts["outcomes"]):
            parts = [_below(f"{k}.{part}", arrays) for part in ("truth", "estimate", "deviation")]
            quantities = {name: QuantityOutcome(*(part[name] for part in parts)) for name in parts[0]}
            outcomes.append(
                Outcome(
                    fact["estimator"], fact["noise"], _below(f"{k}.per_step", arrays),
                    _below(f"{k}.space_time", arrays), quantities, fact["seconds"], partial(again, fact["noise"]),
                    Misfit(**misfit) if (misfit := _below(f"{k}.misfit", arrays)) else None,
                    ParameterEstimate(tuple(fact["parameters"]), **_below(f"{k}.parameters", arrays))
                    if "parameters" in fact
                    else None,
                )
            )  # fmt: skip
        spaces = [
            BackgroundSpace(
                arrays[f"space {k}.modes"], arrays[f"space {k}.singular_values"], arrays[f"space {k}.tails"],
                arrays[f"space {k}.inf_sup"], int(n),
            )
            for k, n in enumerate(facts["n"])
        ]  # fmt: skip
        return Judged(tuple(outcomes), np.asarray(arrays["inf_sup"]), tuple(spaces))


def write_refinement(refinement: Refinement, path: Path) -> None:
    """Write what finer steps change; the file appears whole or not at all."""
    write_arrays(path, REFINEMENT, {}, asdict(refinement))


def read_refinement(path: Path) -> Refinement:
    """Read what finer steps change; StoreError if the file is damaged."""
    _, facts = read_arrays(path, REFINEMENT)
    with _complete(path):
        return Refinement(facts["factor"], facts["differences"], facts["parameters"])


@contextmanager
def _complete(path: Path) -> Iterator[None]:
    """Turn a name that a file lacks into a StoreError."""
    try:
        yield
    except KeyError as error:
        raise StoreError(f"{path}: damaged ({error} is missing); delete it and run again") from error


def _under(prefix: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    return {f"{prefix}:{name}": values for name, values in arrays.items()}


def _below(prefix: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    return {name.removeprefix(f"{prefix}:"): values for name, values in arrays.items() if name.startswith(f"{prefix}:")}
