"""Observation at scale: voxel integrals, Gram matrix of the functionals, its factor, and what solves with it.

Every row is a process of its own. CPU seconds are of one BLAS thread; memory is what the peak rises by once the
state space is there.

    python -m tests.benchmarks.bench_gram --nodes 5k 33k
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dacore.algebra.gram import RieszMap, lower_solve, lower_transpose_solve, orthonormaliser
from dacore.algebra.threads import one_blas_thread
from dacore.workflow.machine import memory_now, peak_memory

SCENE = Path(__file__).parents[2] / "examples" / "brain" / "demo.toml"
#: Settings of the voxels: slices at these heights, or the whole brain; the coverage.
CASES: dict[str, dict[str, Any]] = {
    "one slice": {"slices": [8.5], "coverage": 0.6},
    "three slices": {"slices": [5.5, 8.5, 11.5], "coverage": 0.6},
    "whole brain, 60 % covered": {"slices": [], "coverage": 0.6},
    "whole brain, all voxels": {"slices": [], "coverage": 1e-3},
}
STEPS = 40


def main() -> None:
    out = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    out.add_argument("--nodes", nargs="+", default=["5k", "33k"], choices=["5k", "33k"])
    out.add_argument("--child", nargs=3)
    options = out.parse_args()
    if options.child:
        print(json.dumps(measure(*options.child)))
        return
    print(f"{'':<34}{'m':>6}{'voxels':>9}{'Gram':>8}{'factor':>8}{'R⁻¹, R⁻ᵀ':>10}{'a state':>9}{'MiB':>7}")
    with tempfile.TemporaryDirectory() as cache:
        for nodes in options.nodes:
            for name in CASES:
                done = subprocess.run(
                    [sys.executable, "-m", "tests.benchmarks.bench_gram", "--child", nodes, name, cache],
                    capture_output=True, text=True, check=True,
                )  # fmt: skip
                row = json.loads(done.stdout.splitlines()[-1])
                print(
                    f"{nodes + ', ' + name:<34}{row['m']:6d}{row['voxels']:9.2f}{row['gram']:8.2f}{row['factor']:8.2f}"
                    f"{row['solve']:10.2f}{row['lift']:9.2f}{row['mib']:7.0f}",
                    flush=True,
                )


def forget_peak() -> float:
    """Let the peak start anew from what is held now [MiB], as Linux allows; elsewhere the peak so far."""
    refs = Path("/proc/self/clear_refs")
    if refs.exists():
        refs.write_text("5")
        return memory_now()
    return peak_memory()


def measure(nodes: str, name: str, cache: str) -> dict[str, float]:
    """Seconds and MiB of one case."""
    from dacore.workflow.open import open_scene
    from dacore_imaging.voxels import Slice, Voxels

    settings = CASES[name]
    seconds: dict[str, float] = {}

    def timed(what: str, work: Callable[[], Any]) -> Any:
        started = time.process_time()
        result = work()
        seconds[what] = time.process_time() - started
        return result

    with one_blas_thread():
        space = open_scene(SCENE, [f'domain.nodes="{nodes}"'], cache).model.space
        voxels = Voxels(
            size=1.0, slices=tuple(Slice("z", height) for height in settings["slices"]), coverage=settings["coverage"]
        )
        before = forget_peak()
        functionals = timed("voxels", lambda: voxels.functionals(space))
        riesz = RieszMap(space, functionals, {field.name: 1.0 for field in space.fields})
        blocks = timed("gram", lambda: riesz.blocks)
        factor = timed("factor", lambda: orthonormaliser(blocks, functionals.labels))
        data = np.random.default_rng(0).standard_normal((functionals.count, STEPS))
        weights = timed("solve", lambda: lower_transpose_solve(factor, lower_solve(factor, data)))
        timed("lift", lambda: riesz.lift(weights[:, 0]))
        return {"m": functionals.count, "mib": peak_memory() - before, **seconds}


if __name__ == "__main__":
    main()
