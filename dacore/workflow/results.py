"""The machine-readable result of a run: every error next to the error of guessing the training mean."""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dacore.core.arrays import Array
from dacore.core.background import Background
from dacore.core.mesh import Mesh
from dacore.core.observation import Functionals
from dacore.io.atomic import atomic_write
from dacore.pipeline.runner import PlannedStage
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR, Judged, Outcome, Validation
from dacore.workflow.build import Builder
from dacore.workflow.machine import peak_memory
from dacore.workflow.session import Session
from dacore.workflow.stages import judges_reduction

SCHEMA = 1


def summarise(session: Session, seconds: float, expected: Sequence[PlannedStage] = ()) -> dict[str, Any]:
    """Collect everything a run found, as JSON values.

    Parameters
    ----------
    session : Session
        With the results of the scene's targets.
    seconds : float
        Wall time of the run so far.
    expected : sequence of PlannedStage
        The plan before the run, whose estimates stand beside what the stages took.
    """
    scene, background, validation = session.scene, session.background, session.validation
    timings = {name: round(value, 4) for name, value in session.runner.timings.items()}
    summary = {
        "schema": SCHEMA,
        "title": scene.title,
        "reference": f"{session.builder.same_truth}: errors are those of the reconstruction alone",
        "scene": scene.model_dump(mode="json"),
        "truth_of": "unseen cases drawn uniformly from the parameters' ranges",
        "seeds": {"training": scene.training.seed, "validation": scene.validation.seed, "noise": scene.noise.seed},
        **circumstances(session.builder),
        "timings": timings | {"total": round(seconds, 3)},
        "estimated": {
            row.name: {"seconds": round(row.cost.seconds, 3), "mebibytes": round(row.cost.memory / 2**20, 1)}
            for row in expected
            if row.cost is not None
        },
        "stages": dict(session.runner.states),
        "peak_memory_mib": {"main": round(peak_memory(), 1)},
        "mesh": _mesh(session.mesh) if scene.domain is not None else None,
        "n_dofs": background.space.n_dofs,
        "observation": _observation(session.functionals),
        "background": _background(background),
        "parameters": {
            p.name: {"low": p.low, "high": p.high, "unit": p.unit} for p in background.parameters.parameters
        },
        "estimators": {name: _estimator(session.judged(name)) for name in scene.estimator},
        "cautions": list(session.cautions),
        "joint_weights": dict(validation.joint_weights),
        "validation": [_outcome(session, outcome) for outcome in validation.outcomes],
    }
    if scene.training.method == "reduced":
        summary["reduced_training"] = _reduced(session)
    if scene.validation.refine_time > 1:
        refinement = session.refinement
        summary["discretisation_error_in_time"] = {
            "steps_divided_by": refinement.factor,
            "relative_difference": {name: value for name, value in refinement.differences.items() if name != JOINT},
            "parameters": dict(refinement.parameters),
        }
    return summary


def circumstances(builder: Builder) -> dict[str, Any]:
    """Versions and machine, which every result names."""
    return {
        "versions": {"python": platform.python_version(), **builder.versions()},
        "machine": {"system": platform.platform(), "processor": platform.machine(), "cores": os.cpu_count()},
    }


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write JSON; the file appears whole or not at all."""
    with atomic_write(path) as stream:
        stream.write(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def numbers(values: ArrayLike) -> Any:
    """Turn an array into nested lists of floats, or a number into a float; null where it is not finite."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        return float(array) if np.isfinite(array) else None
    return [numbers(part) for part in array]


def _mesh(mesh: Mesh) -> dict[str, Any]:
    return {
        "nodes": len(mesh.points),
        "cells": len(mesh.cells),
        "facets": {role: len(mesh.boundary_facets(role)) for role in mesh.roles},
        "volume_cm": float(mesh.volumes.sum()),
        "extent_cm": numbers(np.ptp(mesh.points, axis=0)),
    }


def _observation(functionals: Functionals) -> dict[str, Any]:
    return {
        "functionals": functionals.count,
        "sites": functionals.n_sites,
        "dropped": functionals.dropped,
        "unit": functionals.unit,
    }


def _reduced(session: Session) -> dict[str, Any]:
    reduced = session.reduced
    fields = reduced.model.fields
    out = {
        "tolerance": session.scene.training.reduction,
        "solved_in_full": len(reduced.solved),
        "motions_each": reduced.motions,
        "dimension": reduced.model.dimension,
        "largest_estimate": dict(zip(fields, numbers(reduced.estimates.max(axis=1)), strict=True)),
        "rounds": [
            {
                "samples": list(each.solved),
                "modes": dict(each.modes),
                "true_error": dict(zip(fields, numbers(each.true), strict=True)),
                "estimated_error": dict(zip(fields, numbers(each.estimated), strict=True)),
            }
            for each in reduced.rounds
        ],
    }
    if judges_reduction(session.scene):
        unseen = session.unseen_errors
        out["unseen_cases"] = {
            "error": {name: numbers(values) for name, values in unseen.true.items()},
            "estimated": {name: numbers(values) for name, values in unseen.estimated.items()},
        }
    return out


def _background(background: Background) -> dict[str, Any]:
    return {
        "samples": background.n_samples,
        "steps": len(background.times),
        "modes": {name: basis.dimension for name, basis in background.bases.items()},
        "relative_compression_error": dict(background.compression),
        "product": background.kind,
    }


def _estimator(judged: Judged) -> dict[str, Any]:
    spaces = judged.spaces
    return {
        "inf_sup": numbers(judged.inf_sup),
        "n": [space.n for space in spaces],
        "inf_sup_of_n": [numbers(space.inf_sup) for space in spaces],
        "tails_of_n": [numbers(space.tails) for space in spaces],
    }


def _mean(values: Array) -> Array:
    """Mean over what is finite, NaN if nothing is."""
    finite = values[np.isfinite(values)]
    return np.asarray(finite.mean() if finite.size else np.nan)


def true_parameters(session: Session, names: Sequence[str]) -> Array:
    """True parameters (p, k) of the unseen cases."""
    samples = session.runner["truth"].samples
    columns = [session.parameters.names.index(name) for name in names]
    return np.asarray(samples, dtype=np.float64)[:, columns].T


def learned_of(validation: Validation, outcome: Outcome, quantity: str) -> Array:
    """Share (s, k) of a quantity's variance over the training set that the claimed one takes away; NaN without any."""
    prior = validation.outcome(PRIOR, 0.0).quantities[quantity].deviation
    claimed = outcome.quantities[quantity].deviation
    # An estimate of some of the times has fewer numbers than the prior has.
    known = prior if prior.shape == claimed.shape else np.broadcast_to(np.median(prior, axis=0), claimed.shape)
    return np.asarray(1.0 - np.divide(claimed, known, out=np.full_like(claimed, np.nan), where=known > 0) ** 2)


def _outcome(session: Session, outcome: Outcome) -> dict[str, Any]:
    validation = session.validation
    prior = validation.outcome(PRIOR, 0.0)
    errors = {}
    for label in validation.errors:
        values, guess = outcome.space_time[label], prior.space_time[label]
        errors[label] = {
            "mean": numbers(values.mean()),
            "worst": numbers(values.max()),
            "mean_over_steps": numbers(_mean(outcome.per_step[label])),
            "of_the_training_mean": numbers(guess.mean()),
            "cases": numbers(values),
        }
    quantities = {}
    for name, quantity in outcome.quantities.items():
        guess_quantity = prior.quantities[name]
        quantities[name] = {
            "rms_error": quantity.rms,
            "largest_error": quantity.worst,
            "rms_error_of_the_training_mean": guess_quantity.rms,
            "largest_error_of_the_training_mean": guess_quantity.worst,
            "truth": numbers(quantity.truth),
            "estimate": numbers(quantity.estimate),
            "standard_deviation": numbers(quantity.deviation),
            "variance_learned": numbers(learned_of(validation, outcome, name)),
        }
    found: dict[str, Any] = {
        "estimator": outcome.estimator,
        "noise": outcome.noise,
        "errors": errors,
        "quantities": quantities,
        "seconds_for_all_cases": round(outcome.seconds, 4),
    }
    if outcome.misfit is not None:
        misfit = outcome.misfit
        found["misfit"] = {
            "ratio": numbers(misfit.ratio),
            "probability": numbers(misfit.probability),
            "alarm": misfit.alarm.tolist(),
        }
    if outcome.parameters is not None:
        estimate = outcome.parameters
        truth = true_parameters(session, estimate.names)
        found["parameters"] = {
            name: {
                "truth": numbers(truth[row]),
                "estimate": numbers(estimate.values[row]),
                "standard_deviation": numbers(estimate.deviation[row]),
                "deviation_of_the_prior": numbers(estimate.prior[row]),
                "variance_learned": numbers(estimate.learned[row]),
            }
            for row, name in enumerate(estimate.names)
        }
    return found
