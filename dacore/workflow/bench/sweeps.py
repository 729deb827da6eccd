"""What a benchmark varies: sweeps of a scene's settings, by default those its plugins offer."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Literal

from dacore.errors import SceneError
from dacore.workflow.build import Builder
from dacore.workflow.comparison.variants import Axis

# What the error of a point is measured on.
Kind = Literal["forward", "voxels", "estimate"]

SUBSTEPS = (1, 2, 4, 8)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
DIMENSIONS = (2, 4, 8, 16, 32)
QUADRATURES = (1, 2, 4, 8, "exact")


@dataclass(frozen=True)
class Sweep:
    """Points that differ in a few settings; every combination of the axes' values is a point.

    Parameters
    ----------
    name : str
        What is varied, in words.
    kind : {"forward", "voxels", "estimate"}
        Errors are those of the trajectory against the reference, of the functionals against exact ones,
        or of the estimates on unseen cases.
    axes : tuple of Axis
    """

    name: str
    kind: Kind
    axes: tuple[Axis, ...]


def default_sweeps(builder: Builder, sizes: Axis | None, extra: Sequence[Axis] = ()) -> list[Sweep]:
    """The sweeps that make sense for a scene.

    Parameters
    ----------
    builder : Builder
        Of the scene.
    sizes : Axis, optional
        Key and values that make the mesh finer, the finest last.
    extra : sequence of Axis
        Any other key; a sweep each.
    """
    scene = builder.scene
    affine = scene.domain is not None
    out = []
    if affine:
        now = scene.time.model_dump(exclude_unset=True)
        named = tuple(f"{count} substep{'s' if count > 1 else ''}" for count in SUBSTEPS)
        out.append(Sweep("time step", "forward", (Axis("time.substeps", SUBSTEPS, named),)))
        damped = Axis("time", tuple(damped_time(now, count, 6) for count in SUBSTEPS), named)
        out.append(Sweep("time step, generalised α, graded start", "forward", (damped,)))
    if sizes is not None:
        out.append(Sweep("mesh", "forward", (sizes,)))
        if affine:
            out.append(
                Sweep("mesh and time step", "forward", (sizes, Axis("time.substeps", SUBSTEPS[1:3], named[1:3])))
            )
    if _has(builder.physics, "displacement_order"):
        out.append(Sweep("element order", "forward", (Axis("physics.displacement_order", (1, 2)),)))
    if affine:
        ready = _ready(builder, "backend")
        if len(ready) > 1:
            out.append(Sweep("backend", "forward", (Axis("backends", ready),)))
        out.append(Sweep("solver", "forward", (Axis("solvers", _ready(builder, "solver")),)))
        out.append(Sweep("tolerance of the solver", "forward", (Axis("solver.tolerance", TOLERANCES),)))
    for name, operator in builder.observations.items():
        if _has(operator, "quadrature"):
            axis = Axis(f"observation.{name}.quadrature", QUADRATURES)
            out.append(Sweep(f"quadrature of {name}", "voxels", (axis,)))
    for name, estimator in builder.estimators.items():
        if _has(estimator, "n"):
            most = scene.training.samples - 2
            dims = tuple(n for n in DIMENSIONS if n <= most)
            axes = (Axis("estimators", (name,)), Axis(f"estimator.{name}.n", dims))
            out.append(Sweep(f"dimension n of {name}", "estimate", axes))
        else:
            out.append(Sweep(name.replace("_", " "), "estimate", (Axis("estimators", (name,)),)))
    out += [Sweep(axis.key, "forward", (axis,)) for axis in extra]
    return out


def pick(sweeps: Sequence[Sweep], wanted: Sequence[str]) -> list[Sweep]:
    """The sweeps that words name: a kind, a name, or the start of names; SceneError for a word that fits none."""
    chosen: list[Sweep] = []
    for word in wanted:
        exact = [sweep for sweep in sweeps if word in (sweep.kind, sweep.name)]
        found = exact or [sweep for sweep in sweeps if sweep.name.startswith(word)]
        if not found:
            known = ", ".join(dict.fromkeys(f"{sweep.name!r}" for sweep in sweeps))
            raise SceneError(
                f"--only: got {word!r}, expected forward, voxels, estimate, or the start of one of {known}"
            )
        chosen += found
    return [sweep for sweep in sweeps if sweep in chosen]


def damped_time(time: dict[str, Any], substeps: int, graded: int) -> dict[str, Any]:
    """A scene's [time] table with a damped scheme of second order, shorter steps and a graded start."""
    kept = {key: value for key, value in time.items() if key not in ("beta", "gamma", "first_order", "rho_inf")}
    return kept | {"scheme": "generalized_alpha", "rho_inf": 0.5, "substeps": substeps, "graded": graded}


def _has(settings: Any, name: str) -> bool:
    return is_dataclass(settings) and any(field.name == name for field in fields(settings))


def _ready(builder: Builder, kind: str) -> tuple[str, ...]:
    return tuple(row.name for row in builder.registry.table() if row.kind == kind and row.status == "ready")
