"""The report of a reconstruction: what was found, how well it fits, what to beware of."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dacore.workflow.drawn import unit_text
from dacore.workflow.machine import peak_memory
from dacore.workflow.reconstruct.result import Reconstruction
from dacore.workflow.reconstruct.tables import data_table, parameter_table, quantity_table
from dacore.workflow.report_parts import Card, Picture, Provenance, Report, Section, Table, Timing
from dacore.workflow.tables import name_of, number_text, quantity_title, value_text

_CARDS = 3


def make_report(
    result: Reconstruction, pictures: Mapping[str, Picture], found: Mapping[str, Any], scene_text: str
) -> Report:
    """Put it together.

    Parameters
    ----------
    result : Reconstruction
    pictures : mapping of str to Picture
    found : mapping
        The summary that is written as JSON.
    scene_text : str
    """
    scene, misfit = result.session.scene, result.estimate.misfit

    def take(stem: str) -> list[Picture]:
        return [picture for name, picture in pictures.items() if name.startswith(stem)]

    def table(made: Table | None) -> list[Table]:
        return [] if made is None else [made]

    doubts = [f"**Beware:** {line}." for line in result.warnings] + [f"Supposed: {line}." for line in result.notes]
    sections = [
        Section("Does it fit?", "\n\n".join([result.verdict, *doubts]), take("data_fit")),
        Section("What was measured", "", [data_table(result), *take("measured_slice")]),
        Section("Reconstructed fields", "No truth is known here: what stands beside the fields is what the estimator "
                "claims of their error.", take("fields")),
        Section("Numbers of interest", "", table(quantity_table(result))),
        Section("Parameters", "", table(parameter_table(result))),
    ]  # fmt: skip
    files = {str(source["file"]): str(source["sha256"]) for source in found["data"]}
    facts = {
        **({"Data": files} if files else {}),
        "Versions": found["versions"],
        "Machine": {name: str(value) for name, value in found["machine"].items()},
        "Size": {
            "degrees of freedom": f"{result.session.background.space.n_dofs:,}",
            "measurements used": f"{int(result.used.mask.sum()):,} of {result.target.count:,}",
            "steps used": f"{len(result.used.steps)} of {len(result.target.times)}",
            "training trajectories": str(result.session.background.n_samples),
            "training set": found["training"],
        },
    }
    states = result.session.runner.states
    timings = [Timing(name, s, states.get(name, "run")) for name, s in result.session.runner.timings.items()]
    alarm = misfit is not None and bool(misfit.alarm[0])
    fits = misfit is not None and np.isfinite(misfit.ratio).all()
    cards = [
        *_numbers(result),
        Card(
            "does it fit?", ("no" if alarm else "hardly" if result.doubtful else "yes") if fits else "not known",
            f"left over: {number_text(float(misfit.ratio[0]))} of what was expected" if misfit and fits else "",
            ("bad" if alarm else "" if result.doubtful else "good") if fits else "",
        ),
    ]  # fmt: skip
    return Report(
        scene.title,
        f"reconstructed from {', '.join(each.name for each in result.data)} · dacore {found['versions']['dacore']} · "
        f"{name_of(result.session.builder, result.estimator)}",
        cards, [each for each in sections if each.parts or each.text],
        Provenance(facts, timings, int(peak_memory() * 2**20)), scene_text,
    )  # fmt: skip


def _numbers(result: Reconstruction) -> list[Card]:
    out = []
    for name in result.session.quantities:
        members = [n for n in result.numbers if n.quantity == name]
        if len(members) > 1:
            continue
        (n,) = members
        note = f"training mean: {number_text(n.training)}"
        if np.isfinite(n.low):
            low, high = (value_text(each, n.deviation).partition(" ")[0] for each in (n.low, n.high))
            note = f"90% interval: {low} to {high}; {note}"
        shown = value_text(n.value, n.deviation).partition(" ")[0]
        out.append(Card(quantity_title(result.session.builder, name), f"{shown} {unit_text(n.unit)}", note))
    return out[:_CARDS]
