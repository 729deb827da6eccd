"""Linear solvers side by side on real time steps of poroelasticity: set-up, time a step, iterations, memory.

Run as a script: ``python tests/benchmarks/solvers.py --edge 1.0 --methods direct krylov splu``. Each
method runs in a process of its own, marches the same trajectory (one cycle from rest under the
pulse and the pressure jump), and is compared with the others by its last state. A mesh of one's own
comes as an ``.npz`` file with points, tets, tris and tri_tags (1 neck, 2 ventricles, 3 mre).
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

from dacore.algebra.elimination import Ordering
from dacore.algebra.solvers import Direct, Krylov
from dacore.core.mesh import Mesh
from dacore.domains.ball import Ball
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.dynamics.system import StepSystem, load_profiles
from dacore_biot.model import Biot
from dacore_skfem.backend import SkfemBackend

METHODS = ("direct", "direct+ordering", "krylov", "splu", "splu-colamd", "bicgstab")
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


def read(path):
    data = np.load(path)
    tags = data["tri_tags"].copy()
    low = data["points"][data["tris"]][:, :, 2].max(axis=1) < 1.0
    tags[(tags == 3) & low] = 1
    return Mesh(data["points"], data["tets"], data["tris"], tags, {"neck": 1, "ventricles": 2, "mre": 3})


def peak_memory(fresh=False):
    """Peak resident memory [GiB] of this process, from now on if `fresh` (Linux)."""
    if fresh:
        Path("/proc/self/clear_refs").write_text("5")
    return int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 2**20


def measure(options):
    """One method's figures as a dict."""
    mesh = read(options.mesh) if options.mesh else Ball(8.0, 2.0, edge=options.edge).mesh()
    model = Biot().build(lambda fields: SkfemBackend().discretize(mesh, fields))
    scheme = Newmark()
    system = StepSystem(model, scheme, STEP)
    parameters = system.middle
    step = system.at(parameters)
    before = peak_memory(fresh=True)
    method = options.methods[0]
    clock = time.process_time
    start = clock()
    layout = model.space.layout
    nodes = np.concatenate([np.tile(np.arange(layout.nodes[f.name]), f.components) for f in layout.fields])
    ordering = Ordering.of(step.matrix, system.definite, nodes[system.free]) if method == "direct+ordering" else None
    ordering_time, start = clock() - start, clock()
    if method in ("direct", "direct+ordering", "krylov"):
        kind = Krylov() if method == "krylov" else Direct()
        solver = kind.prepare(step.matrix, system.definite, options.tolerance, ordering)
    else:
        solver = Reference(step.matrix, method, options.tolerance)
    setup = clock() - start
    profiles = load_profiles(model.loads, STEP * np.arange(1.0, options.steps + 1.0))
    amplitudes = model.amplitudes(parameters)[:, None]
    state, times = State.at_rest(np.zeros((model.space.n_dofs, 1))), []
    for k in range(options.steps):
        weights = profiles[:, k, None] * amplitudes
        rhs = step.right_side(state, weights)
        value = np.empty_like(state.value)
        value[system.constrained] = system.prescribed @ weights
        start = clock()
        value[system.free] = solver.solve(rhs)
        times.append(clock() - start)
        state = scheme.advance(state, value, STEP)
    final = state.value[system.free, 0]
    return {
        "nodes": len(mesh.points),
        "unknowns": len(system.free),
        "method": method,
        "ordering": ordering_time,
        "setup": setup,
        "step": float(np.mean(times)),
        "iterations": getattr(solver, "iterations", 0) / options.steps,
        "memory": peak_memory() - before,
        "norm": float(np.linalg.norm(final[system.definite])),
        "pressure": float(np.linalg.norm(final[~system.definite])),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edge", type=float, default=1.7, help="edge of the ball's mesh [cm]")
    parser.add_argument("--mesh", help="an .npz mesh instead")
    parser.add_argument(
        "--methods", nargs="+", choices=METHODS, default=["direct", "direct+ordering", "krylov", "splu"]
    )
    parser.add_argument("--tolerance", type=float, default=1e-10)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        with threadpool_limits(1):
            print(json.dumps(measure(options)))
        return
    print("CPU seconds, one thread; memory beyond the assembled matrices, GiB")
    print(f"{'method':16s} {'nodes':>7s} {'unknowns':>8s} {'ordering':>8s} {'set-up':>8s} {'a step':>8s} "
          f"{'its':>6s} {'memory':>7s} {'|u|':>13s} {'|p|':>13s}")  # fmt: skip
    for method in options.methods:
        command = [sys.executable, __file__, "--one", "--methods", method, "--edge", str(options.edge)]
        command += ["--tolerance", str(options.tolerance), "--steps", str(options.steps)]
        command += ["--mesh", options.mesh] if options.mesh else []
        row = json.loads(subprocess.run(command, capture_output=True, check=True).stdout.splitlines()[-1])
        print(
            f"{row['method']:16s} {row['nodes']:7d} {row['unknowns']:8d} {row['ordering']:8.2f} {row['setup']:8.2f} "
            f"{row['step']:8.4f} {row['iterations']:6.1f} {row['memory']:7.2f} {row['norm']:13.9f} "
            f"{row['pressure']:13.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
