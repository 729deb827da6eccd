"""The error of the time step on the brain, for each scheme and start: the tables of docs/time.md.

Run from the root of the clone, with the brain, Biot and scikit-fem plugins installed::

    python tests/benchmarks/time_error.py steady ramp5 ramp10 jump        # some twelve CPU minutes
    python tests/benchmarks/time_error.py --meshes steady ramp10          # the error of the mesh: three

For each start a reference is computed with the generalised-α scheme, ρ∞ = 0.8, many substeps and, after a jump,
graded first steps, and once more with half as many substeps; their difference is printed as the error of the
reference. Parameters are in the middle of their ranges.
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np

from dacore.algebra.threads import one_blas_thread
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.studies.errors import ErrorMeter
from dacore_biot.model import Biot
from dacore_imaging.brain import Brain
from dacore_imaging.voxels import Voxels
from dacore_skfem.backend import SkfemBackend

STEP, STEPS = 5e-4, 40
SCHEMES = {
    "published": Newmark(),
    "Newmark 1/2, 1, newmark": Newmark(0.5, 1.0, "newmark"),
    "Newmark 1/4, 1/2, newmark": Newmark(0.25, 0.5, "newmark"),
    "generalised α, ρ∞ = 0": GeneralizedAlpha(0.0),
    "generalised α, ρ∞ = 0.5": GeneralizedAlpha(0.5),
    "generalised α, ρ∞ = 0.8": GeneralizedAlpha(0.8),
}
REFERENCE = GeneralizedAlpha(0.8)


@dataclass(frozen=True)
class Case:
    """A start: what the scene says, how fine its reference is, and the grids tried on it."""

    start: str
    ramp: float
    reference: tuple[int, int]
    grids: tuple[tuple[int, int], ...]


CASES = {
    "steady": Case("steady", 0.0, (32, 0), ((1, 0), (4, 0))),
    "ramp5": Case("zero", 5e-3, (16, 0), ((1, 0), (4, 0))),
    "ramp10": Case("zero", 1e-2, (16, 0), ((1, 0), (4, 0))),
    "jump": Case("zero", 0.0, (128, 8), ((1, 0), (1, 6), (4, 0), (4, 6))),
}


class Counted:
    """A solver method that counts factorisations."""

    def __init__(self, method):
        self.method, self.count = method, 0

    def prepare(self, *given):
        self.count += 1
        return self.method(*given)


class Study:
    """One start on one mesh."""

    def __init__(self, nodes, case):
        self.case = case
        mesh, backend = Brain(nodes=nodes, neck_height=1.0).mesh(), SkfemBackend()
        self.model = Biot(ramp=case.ramp).build(lambda fields: backend.discretize(mesh, fields))
        self.middle = self.model.parameters.middle
        self.analysis = None

    def march(self, scheme, substeps, graded):
        """Trajectory, CPU seconds and factorisations."""
        grid = TimeGrid(STEP, STEPS, 0, substeps, graded)
        marched = MarchedModel(self.model, grid, scheme, self.case.start, analysis=self.analysis)
        self.analysis = marched.analysis
        method = marched.method
        counted = Counted(type(method).prepare.__get__(method))
        object.__setattr__(method, "prepare", counted.prepare)
        started = time.process_time()
        trajectory = marched.solve(self.middle)
        return trajectory, time.process_time() - started, counted.count

    def errors(self, states, reference, times):
        """Percentages for u, p and p less the pressure outside at each time."""
        meter = ErrorMeter(self.model.space, "l2", [], {field.name: 1.0 for field in self.model.space.fields})
        wrong, whole = meter.norms(states - reference), meter.norms(reference)
        outside = next(load for load in self.model.loads if load.name == "csf")
        shifted = reference.copy()
        shifted[self.model.space.layout.block("p")] -= outside.profile(times) * self.middle["p_csf"]
        whole["p − p_csf"] = meter.norms(shifted)["p"]
        wrong["p − p_csf"] = wrong["p"]
        return {name: 100 * np.sqrt((wrong[name] ** 2).sum() / (whole[name] ** 2).sum()) for name in whole}


def table(nodes, name):
    """Print one table."""
    case = CASES[name]
    study = Study(nodes, case)
    substeps, graded = case.reference
    fine, spent, _ = study.march(REFERENCE, substeps, graded)
    half, half_spent, half_count = study.march(REFERENCE, substeps // 2, graded)
    print(f"\n### {name}, {nodes}: reference of {substeps} substeps, graded {graded}, {spent:.0f} CPU s\n")
    print("| scheme | substeps | graded | u | p | p − p_csf | factorisations | CPU s |")
    print("|---|---|---|---|---|---|---|---|")

    def line(label, substeps, graded, states, factorisations, spent):
        errors = study.errors(states, fine.states, fine.times)
        columns = " | ".join(f"{value:.2g}%" for value in errors.values())
        print(f"| {label} | {substeps} | {graded} | {columns} | {factorisations} | {spent:.1f} |", flush=True)

    line("reference with half the substeps", substeps // 2, graded, half.states, half_count, half_spent)
    for label, scheme in SCHEMES.items():
        for parts, halvings in case.grids:
            trajectory, spent, factorisations = study.march(scheme, parts, halvings)
            line(label, parts, halvings, trajectory.states, factorisations, spent)


def compare_meshes(name):
    """Print how far voxel averages on the 5k mesh are from those on the 33k mesh, with one step for each recorded."""
    averages, spent = {}, {}
    for nodes in ("5k", "33k"):
        study = Study(nodes, CASES[name])
        trajectory, spent[nodes], _ = study.march(GeneralizedAlpha(0.5), 1, 0)
        for field in ("u", "p"):
            voxels = Voxels(field=field, size=1.0, coverage=0.99).functionals(study.model.space)
            averages[nodes, field] = dict(zip(voxels.labels, voxels(trajectory.states), strict=True))
    outside = next(load for load in study.model.loads if load.name == "csf")
    shift = outside.profile(trajectory.times) * study.middle["p_csf"]
    print(f"\n### {name}: 5k against 33k; {spent['5k']:.1f} and {spent['33k']:.1f} CPU s\n")
    for field in ("u", "p"):
        shared = sorted(averages["5k", field].keys() & averages["33k", field].keys())
        coarse, fine = (np.array([averages[nodes, field][label] for label in shared]) for nodes in ("5k", "33k"))
        gap = np.linalg.norm(coarse - fine)
        print(f"{field}: {100 * gap / np.linalg.norm(fine):.2g}% over {len(shared)} averages")
        if field == "p":
            print(f"p − p_csf: {100 * gap / np.linalg.norm(fine - shift):.2g}%", flush=True)


def main():
    """Read the command line and print the tables asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="+", choices=CASES)
    parser.add_argument("--nodes", default="5k", choices=["5k", "33k"])
    parser.add_argument("--meshes", action="store_true", help="compare the meshes in place of the schemes")
    options = parser.parse_args()
    with one_blas_thread():
        for name in options.cases:
            compare_meshes(name) if options.meshes else table(options.nodes, name)


if __name__ == "__main__":
    main()
