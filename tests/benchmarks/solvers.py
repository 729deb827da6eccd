"""Linear solvers side by side on real time steps of poroelasticity: set-up, time a step, iterations, memory, residual.

Run as a script: ``python tests/benchmarks/solvers.py --nodes 33k --methods direct krylov petsc_krylov``. Each method
runs in a process of its own on one thread and marches the same trajectory: one cycle from rest under the pulse and
the pressure jump, mid-range parameters. ``--columns 3`` marches three loads at once. Methods of plugins go by their
names in a scene. ``--edge 1.7`` takes the mesh of a ball in place of the brain's.
"""

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import bicgstab, splu
from threadpoolctl import threadpool_limits

from dacore.algebra.linear_solver import prepared
from dacore.domains.ball import Ball
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.dynamics.system import StepSystem, load_profiles
from dacore.plugins.registry import load
from dacore_biot.model import Biot
from dacore_imaging.brain import Brain
from dacore_skfem.backend import SkfemBackend

REFERENCES = ("splu", "splu-colamd", "bicgstab")
STEP = 5e-4


class Reference:
    """A solver of scipy's on the system scaled to unit diagonal, started from the last solution."""

    def __init__(self, matrix, method, tolerance):
        self.scale = 1.0 / np.sqrt(np.abs(matrix.diagonal()))
        diagonal = diags_array(self.scale)
        self.matrix = (diagonal @ matrix @ diagonal).tocsr()
        self.tolerance, self.iterations, self.last = tolerance, 0, None
        self.factor = None
        if method.startswith("splu"):
            self.factor = splu(
                csc_array(self.matrix),
                permc_spec="COLAMD" if method.endswith("colamd") else "MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": not method.endswith("colamd")},
            )

    def solve(self, rhs):
        load = self.scale * rhs[:, 0]
        if self.factor is None:
            self.last, failed = bicgstab(
                self.matrix, load, x0=self.last, rtol=self.tolerance, maxiter=5000, callback=self._count
            )
            if failed:
                raise RuntimeError("bicgstab did not converge")
        else:
            self.last = self.factor.solve(load)
        return (self.scale * self.last)[:, None]

    def _count(self, _):
        self.iterations += 1


def peak_memory(fresh=False):
    """Peak resident memory [GiB] of this process, from now on if `fresh` (Linux)."""
    if fresh:
        Path("/proc/self/clear_refs").write_text("5")
    return int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 2**20


def scales(matrix, definite):
    """One over the roots of the diagonals of A and C + B diag(A)⁻¹ Bᵀ: residuals are measured in that scale."""
    diagonal = np.abs(matrix.diagonal())
    coupling = (diags_array((~definite).astype(float)) @ matrix @ diags_array(definite / np.sqrt(diagonal))).tocsr()
    return 1.0 / np.sqrt(diagonal + coupling.power(2).sum(axis=1))


def measure(options):
    """One method's figures as a dict."""
    mesh = Ball(8.0, 2.0, edge=options.edge).mesh() if options.edge else Brain(nodes=options.nodes).mesh()
    model = Biot().build(lambda fields: SkfemBackend().discretize(mesh, fields))
    scheme = Newmark()
    system = StepSystem(model, scheme, STEP)
    parameters = system.middle
    step = system.at(parameters)
    before = peak_memory(fresh=True)
    name = options.methods[0]
    clock = time.process_time
    start = clock()
    layout = model.space.layout
    nodes = np.concatenate([np.tile(np.arange(layout.nodes[f.name]), f.components) for f in layout.fields])
    if name in REFERENCES:
        analysis_time, start = 0.0, clock()
        solver = Reference(step.matrix, name, options.tolerance)
    else:
        method = load().get("solver", name)()
        analysis = method.analyse(step.matrix, system.definite, nodes[system.free])
        analysis_time, start = clock() - start, clock()
        solver = prepared(method, step.matrix, system.definite, options.tolerance, analysis)
    setup = clock() - start
    profiles = load_profiles(model.loads, STEP * np.arange(1.0, options.steps + 1.0))
    whole = model.amplitudes(parameters)[:, None]
    # The loads that move something, alone; the mean over the columns is what a trajectory costs.
    alone = np.diag(whole[:, 0])[:, np.flatnonzero(whole[:, 0])]
    amplitudes = whole if options.columns == 1 else alone[:, : options.columns]
    state, times = State.at_rest(np.zeros((model.space.n_dofs, amplitudes.shape[1]))), []
    scale, residual = scales(step.matrix, system.definite)[:, None], 0.0
    for k in range(options.steps):
        weights = profiles[:, k, None] * amplitudes
        rhs = step.right_side(state, weights)
        value = np.empty_like(state.value)
        value[system.constrained] = system.prescribed @ weights
        start = clock()
        value[system.free] = solver.solve(rhs)
        times.append(clock() - start)
        left = np.linalg.norm(scale * (rhs - step.matrix @ value[system.free]), axis=0)
        residual = max(residual, float((left / np.linalg.norm(scale * rhs, axis=0)).max()))
        state = scheme.advance(state, value, STEP)
    final = state.value[system.free].sum(axis=1)
    return {
        "nodes": len(mesh.points),
        "unknowns": len(system.free),
        "columns": amplitudes.shape[1],
        "method": name,
        "analysis": analysis_time,
        "setup": setup,
        "step": float(np.mean(times)),
        "iterations": getattr(solver, "iterations", 0) / options.steps / amplitudes.shape[1],
        "memory": peak_memory() - before,
        "residual": residual,
        "norm": float(np.linalg.norm(final[system.definite])),
        "pressure": float(np.linalg.norm(final[~system.definite])),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", default="5k", choices=("5k", "33k", "100k"), help="of the brain")
    parser.add_argument("--edge", type=float, help="edge of the mesh of a ball [cm] in place of the brain")
    parser.add_argument("--methods", nargs="+", default=["direct", "krylov"], help=f"in a scene, or {REFERENCES}")
    parser.add_argument("--columns", type=int, default=1, help="loads that are marched at once")
    parser.add_argument("--tolerance", type=float, default=1e-10)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        with threadpool_limits(1):
            print(json.dumps(measure(options)))
        return
    print("CPU seconds, one thread; memory beyond the assembled matrices, GiB")
    print(f"{'method':14s} {'nodes':>7s} {'unknowns':>8s} {'k':>2s} {'analysis':>8s} {'set-up':>7s} {'a step':>7s} "
          f"{'its':>5s} {'GiB':>5s} {'residual':>8s} {'|u|':>12s} {'|p|':>12s}")  # fmt: skip
    for method in options.methods:
        command = [sys.executable, __file__, "--one", "--methods", method, "--nodes", options.nodes]
        command += ["--tolerance", str(options.tolerance), "--steps", str(options.steps)]
        command += ["--columns", str(options.columns)]
        command += ["--edge", str(options.edge)] if options.edge else []
        row = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout.splitlines()[-1])
        print(
            f"{row['method']:14s} {row['nodes']:7d} {row['unknowns']:8d} {row['columns']:2d} {row['analysis']:8.2f} "
            f"{row['setup']:7.2f} {row['step']:7.3f} {row['iterations']:5.1f} {row['memory']:5.2f} "
            f"{row['residual']:8.1e} {row['norm']:12.7f} {row['pressure']:12.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
