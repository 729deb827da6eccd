"""Growth laws of the stages: what each costs by the size of the scene, before anything was measured here.

Constants are processor seconds of one core, from the brain of 5,147 and 33,000 nodes (20,588 and 131,500 dofs; 40
steps; 462 voxel values; scikit-fem and its direct solver). `dacore.pipeline.costs` corrects them by what stages took
in a cache. Sizes by name:

========  =====================================================
nodes     of the mesh
n         dofs
m, r      functionals; modes of the background
K, cases  trajectories of the training set, unseen cases
t         recorded steps
marched   steps of the march for one trajectory
levels    noise levels
refine    parts of a step in the refinement
workers   processes that solve
full      trajectories that reduced training solves in full
========  =====================================================
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from dacore.core.domain import Domain
from dacore.io.scene import Scene
from dacore.pipeline.costs import Cost
from dacore.pipeline.stage import Stage

Sizes = Mapping[str, float]
# What the plan calls the work after the stages.
REPORT = "report"

MIB = 2.0**20
GIB = 2.0**30
# What Python, its libraries and a scene's plugins take before any work.
BASE = 150 * MIB
# Before the stages that know them ran: components of a field in space and a scalar at each node, values, modes.
COMPONENTS, GUESS = 4.0, {"m": 500.0, "r": 80.0}
# Of reduced training: motions a trajectory, trajectories and candidates a round, coordinates of the reduced model.
_MOTIONS, _ROUND, _CANDIDATES, _COORDINATES = 2, 2, 64, 600
# Marches that emulating a reduced model takes, in terms of those on all its coordinates.
_NODES = 170


def sizes_of(scene: Scene, domain: Domain | None, workers: int) -> dict[str, float]:
    """What a scene says of its own size."""
    time = scene.time
    marched = (time.steps + time.spin_up) * time.substeps + time.graded
    out = {
        **GUESS,
        "K": float(scene.training.samples), "cases": float(scene.validation.cases), "t": float(time.steps),
        "marched": float(marched), "levels": float(len(scene.noise.levels)),
        "refine": float(scene.validation.refine_time), "workers": float(max(workers, 1)),
        "full": _full(scene),
    }  # fmt: skip
    expected = domain.expected_nodes() if domain is not None else None
    return out if expected is None else out | {"nodes": float(expected)}


def domain(sizes: Sizes) -> Cost | None:
    """Meshing: in proportion to the nodes."""
    if "nodes" not in sizes:
        return None
    return Cost(3.0 + 1e-4 * sizes["nodes"], BASE + 4e3 * sizes["nodes"])


def model(sizes: Sizes) -> Cost | None:
    """Assembly: in proportion to the dofs."""
    n = _dofs(sizes)
    return None if n is None else Cost(0.3 + 1.5e-5 * n, BASE + 6e3 * n)


def functionals(sizes: Sizes) -> Cost | None:
    """Clipping cells by voxels: in proportion to the dofs."""
    n = _dofs(sizes)
    return None if n is None else Cost(0.05 + 4e-6 * n, BASE + 6e3 * n)


def trajectory(sizes: Sizes) -> Cost | None:
    """One trajectory: a factorisation of n^1.8 and steps of n^1.0; its factor grows as n^(4/3)."""
    n = _dofs(sizes)
    if n is None:
        return None
    size = n / 2e4
    seconds = 0.3 * size**1.8 + sizes["marched"] * 0.027 * size
    return Cost(seconds, 4 * GIB * (n / 5e5) ** (4 / 3) + 24 * n * sizes["t"] + 6e3 * n)


def trajectories(sizes: Sizes, count: str) -> Cost | None:
    """A set of trajectories, on several processes."""
    one = trajectory(sizes)
    if one is None:
        return None
    processes = min(sizes["workers"], sizes[count])
    return Cost(one.seconds * sizes[count] / processes, (BASE + one.memory) * processes)


def reduced_training(sizes: Sizes) -> Cost | None:
    """Few trajectories in full, their modes, and all samples marched by a reduced model.

    A trajectory in full is two motions with one factorisation, which is some 0.4 of its cost; one more is for the
    random tests. Modes cost in proportion to the values of the motions. A sample of 40 steps on 400 to 900 coordinates
    takes 0.03 to 0.1 s. Every round but the first solves two trajectories and marches 64 candidates.
    """
    n, one = _dofs(sizes), trajectory(sizes)
    if n is None or one is None:
        return None
    full, t, samples = sizes["full"], sizes["t"], sizes["K"]
    processes = min(sizes["workers"], _ROUND)
    columns = _MOTIONS * t * full
    candidates = min(samples, _CANDIDATES) * full / _ROUND
    seconds = one.seconds * ((0.4 + 0.6 * _MOTIONS) * full / processes + 1)
    seconds += 3e-7 * n * columns + (0.02 + 1.5e-3 * sizes["marched"]) * (samples + candidates)
    here = 16 * n * (_COORDINATES + _MOTIONS * t) + 8 * _COORDINATES * t * samples
    return Cost(seconds, BASE + here + (BASE + one.memory + 8 * n * _MOTIONS * t) * processes)


def background(sizes: Sizes) -> Cost | None:
    """Proper orthogonal decomposition: in proportion to all values; some hundreds of states are held at once."""
    n = _dofs(sizes)
    if n is None:
        return None
    return Cost(0.5 + 8e-8 * n * sizes["K"] * sizes["t"], BASE + 8 * n * (1500 + 3 * sizes["r"]) + 6e3 * n)


def prepared(sizes: Sizes) -> Cost | None:
    """Representers of the functionals, and decompositions of the training set's data for each fold of it."""
    n = _dofs(sizes)
    if n is None:
        return None
    m, data = sizes["m"], sizes["m"] * sizes["t"] * sizes["K"]
    seconds = 0.5 + 1e-8 * m * n + 2e-9 * data * sizes["K"]
    return Cost(seconds, BASE + 4 * m * n + 24 * data + 16 * m * m + 8 * n * sizes["r"])


def groundwork(sizes: Sizes) -> Cost:
    """Some two hundred marches of a reduced model, the first of them on all its coordinates."""
    values = sizes["r"] * sizes["t"] * sizes["K"]
    return Cost(3.0 + (0.02 + 1.5e-3 * sizes["marched"]) * _NODES + 1e-8 * values * _COORDINATES, BASE + 50 * values)


def measured(sizes: Sizes) -> Cost | None:
    """Reading the unseen cases."""
    n = _dofs(sizes)
    if n is None:
        return None
    one = 8 * n * sizes["t"]
    return Cost(0.1 + sizes["cases"] * one / 4e8, BASE + 3 * one)


def reference(sizes: Sizes) -> Cost | None:
    """Reading the unseen cases and projecting them twice."""
    n = _dofs(sizes)
    if n is None:
        return None
    one, values = 8 * n * sizes["t"], n * sizes["t"] * sizes["cases"]
    kept = 8 * sizes["cases"] * sizes["t"] * (2 * sizes["m"] + sizes["r"])
    return Cost(0.1 + values * (2e-8 + 4e-10 * sizes["r"]), BASE + 6 * one + 8 * n * sizes["r"] + kept)


def judged(sizes: Sizes) -> Cost | None:
    """Estimates, their errors in small coordinates, and deviations from trajectories held out."""
    data = sizes["m"] * sizes["t"] * sizes["cases"] * sizes["levels"]
    seconds = 1.0 + 1e-10 * data * sizes["m"] + 3e-10 * sizes["m"] * sizes["t"] * sizes["K"] ** 2
    return Cost(seconds, BASE + 40 * data + 16 * sizes["m"] ** 2)


def refinement(sizes: Sizes) -> Cost | None:
    """A trajectory, and one of finer steps."""
    one = trajectory(sizes)
    return None if one is None else Cost(one.seconds * (1 + 0.7 * sizes["refine"]), BASE + one.memory)


def report(sizes: Sizes, states: bool) -> Cost:
    """Figures, and with states the fields of the worst cases."""
    levels = sizes["levels"]
    if not states:
        return Cost(4.0 + levels, 2 * BASE)
    n = _dofs(sizes) or 0.0
    values = n * sizes["t"] * levels
    return Cost(8.0 + 4.0 * levels + 2e-7 * values, 2 * BASE + 40 * n * sizes["t"])


def _full(scene: Scene) -> float:
    """How many trajectories reduced training solves: about 12 for 1e-3, 20 for 1e-5, and never fewer than eight."""
    training = scene.training
    expected = max(8.0, 4.0 * math.log10(1.0 / training.reduction))
    return float(min(expected, training.samples, training.most))


def _dofs(sizes: Sizes) -> float | None:
    if "n" in sizes:
        return sizes["n"]
    return COMPONENTS * sizes["nodes"] if "nodes" in sizes else None


def priced(stages: Sequence[Stage], scene: Scene) -> list[Stage]:
    """The same stages with their laws of cost, their sizes and how many pieces they resume from."""
    reduced = scene.training.method == "reduced"
    laws: dict[str, Callable[[Sizes], Cost | None]] = {
        "domain": domain, "model": model, "functionals": functionals, "prepared": prepared,
        "groundwork": groundwork,
        "training": reduced_training if reduced else lambda sizes: trajectories(sizes, "K"),
        "truth": lambda sizes: trajectories(sizes, "cases"),
        "measured": measured, "reference": reference, "judged": judged, "refinement": refinement,
    }  # fmt: skip
    found: dict[str, Callable[[Any], Sizes]] = {
        "domain": lambda mesh: {"nodes": float(len(mesh.points))},
        "model": lambda made: {"n": float(made.space.n_dofs)},
        "functionals": lambda made: {"m": float(made.count)},
        "background": lambda made: {"r": float(made.dimension)},
    }
    pieces = {"truth": scene.validation.cases}
    if not reduced:
        # A reduced training is made by its one stage, which is kept as a whole; motions resume by themselves.
        laws["background"] = background
        pieces["training"] = scene.training.samples
    return [
        replace(
            stage, cost=laws.get(stage.name.partition(".")[0]), size=found.get(stage.name),
            pieces=pieces.get(stage.name, 0),
        )
        for stage in stages
    ]  # fmt: skip
