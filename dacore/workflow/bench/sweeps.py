"""What a benchmark varies: sweeps of a scene's settings, by default those its plugins offer."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Literal

from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.newmark import Newmark
from dacore.errors import SceneError
from dacore.workflow.build import Builder
from dacore.workflow.comparison.variants import Axis, axis_of

# What the error of a point is measured on.
Kind = Literal["forward", "voxels", "estimate", "costs"]

SUBSTEPS = (1, 2, 4, 8)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
DIMENSIONS = (2, 4, 8, 16, 32)
EXACT = "exact"
QUADRATURES = (1, 2, 4, 8, EXACT)

GROWTH = "growth"
DAMPING = 0.5
_OF_A_SCHEME = ("scheme", "beta", "gamma", "first_order", "rho_inf")

# Where a change moves the trajectory; every other key moves estimates alone.
_FORWARD = frozenset(("backends", "solvers", "domain", "discretization", "physics", "parameters", "time", "solver"))


@dataclass(frozen=True)
class Sweep:
    """Points that differ in a few settings; every combination of the axes' values is a point.

    Parameters
    ----------
    name : str
        What is varied, in words.
    kind : {"forward", "voxels", "estimate", "costs"}
        Errors are those of the trajectory against the reference, of the functionals against exact ones,
        or of the estimates on unseen cases; "costs" are those of a trajectory, without errors.
    axes : tuple of Axis
    """

    name: str
    kind: Kind
    axes: tuple[Axis, ...]


def default_sweeps(
    builder: Builder, sizes: Axis | None, extra: Sequence[Sequence[Axis]] = (), larger: Axis | None = None
) -> list[Sweep]:
    """The sweeps that make sense for a scene.

    Parameters
    ----------
    builder : Builder
        Of the scene.
    sizes : Axis, optional
        Key and values that make the mesh finer, the finest last.
    extra : sequence of sequences of Axis
        Any other keys; each is a sweep over every combination of its axes' values.
    larger : Axis, optional
        Key and values whose costs alone are measured, for sizes that are too large for errors.

    Raises
    ------
    SceneError
        If trajectories are to be compared that have no mesh in common.
    """
    scene = builder.scene
    affine = scene.domain is not None
    others = [_sweep(axes) for axes in extra]
    moving = [axis.key for axis in (sizes, larger) if axis is not None]
    moving += [each.name for each in others if each.kind == "forward"]
    if moving and not affine:
        raise SceneError(
            f"{builder.where}: {moving[0]}: trajectories are compared at points of a mesh, and the scene has no "
            "[domain]; vary what estimates depend on, for example --vary training.samples=8,16"
        )
    out = []
    if affine:
        named = tuple(f"{count} substep{'s' if count > 1 else ''}" for count in SUBSTEPS)
        out.append(Sweep("time step", "forward", (Axis("time.substeps", SUBSTEPS, named),)))
        out += [
            Sweep(f"time step, {name}", "forward", (Axis("time", tuple(times), named),))
            for name, times in _schemes(builder).items()
        ]
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
    if larger is not None:
        out.append(Sweep(GROWTH, "costs", (larger,)))
    return out + others


def _schemes(builder: Builder) -> dict[str, list[dict[str, Any]]]:
    """[time] tables of schemes other than the scene's own, by name, for every number of substeps."""
    now = builder.scene.time.model_dump(exclude_unset=True)
    kept = {key: value for key, value in now.items() if key not in _OF_A_SCHEME}
    damped = f"generalised α, ρ∞ = {DAMPING:g}"
    out = {"generalised α, graded start": [damped_time(now, count, 6) for count in SUBSTEPS]}
    if builder.scheme != GeneralizedAlpha(DAMPING):
        out[damped] = [damped_time(now, count, now.get("graded", 0)) for count in SUBSTEPS]
    if builder.scheme != Newmark():
        published = {"scheme": "newmark", "beta": 0.5, "gamma": 1.0, "first_order": "backward_euler"}
        out["Newmark as published"] = [kept | published | {"substeps": count} for count in SUBSTEPS]
    return out


def axes_of(text: str) -> tuple[Axis, ...]:
    """Read ``"domain.nodes=5k,33k; time.substeps=1,2"``: axes whose every combination is a point."""
    return tuple(axis_of(part) for part in text.split(";") if part.strip())


def _sweep(axes: Sequence[Axis]) -> Sweep:
    forward = any(axis.key.partition(".")[0] in _FORWARD for axis in axes)
    return Sweep(" × ".join(axis.key for axis in axes), "forward" if forward else "estimate", tuple(axes))


def pick(sweeps: Sequence[Sweep], wanted: Sequence[str]) -> list[Sweep]:
    """The sweeps that words name: a kind, a name, or the start of names; SceneError for a word that fits none."""
    chosen: list[Sweep] = []
    for word in wanted:
        exact = [sweep for sweep in sweeps if word in (sweep.kind, sweep.name)]
        found = exact or [sweep for sweep in sweeps if sweep.name.startswith(word)]
        if not found:
            known = ", ".join(dict.fromkeys(f"{sweep.name!r}" for sweep in sweeps))
            raise SceneError(
                f"--only: got {word!r}, expected forward, voxels, estimate, costs, or the start of one of {known}"
            )
        chosen += found
    return [sweep for sweep in sweeps if sweep in chosen]


def damped_time(time: dict[str, Any], substeps: int, graded: int) -> dict[str, Any]:
    """A scene's [time] table with a damped scheme of second order, shorter steps and a graded start."""
    kept = {key: value for key, value in time.items() if key not in _OF_A_SCHEME}
    return kept | {"scheme": "generalized_alpha", "rho_inf": DAMPING, "substeps": substeps, "graded": graded}


def _has(settings: Any, name: str) -> bool:
    return is_dataclass(settings) and any(field.name == name for field in fields(settings))


def _ready(builder: Builder, kind: str) -> tuple[str, ...]:
    return tuple(row.name for row in builder.registry.table() if row.kind == kind and row.status == "ready")
