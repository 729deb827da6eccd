"""Memory of each phase from a scene to one trajectory: the peak in the phase, and what is held after it.

Run as a script: ``python tests/benchmarks/memory.py examples/brain/demo.toml --set domain.nodes='"33k"'``. Resident
memory as Linux counts it, the peak reset before each phase; CPU seconds beside it.
"""

import argparse
import re
import time
from pathlib import Path

from dacore.io.scene import read_scene
from dacore.workflow.build import Builder

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class Phases:
    """Prints a line for each phase that ends."""

    def __init__(self):
        self.highest, self.start = 0.0, time.process_time()

    def end(self, name):
        peak, held = (int(re.search(rf"{key}:\s+(\d+)", STATUS.read_text())[1]) / 2**20 for key in ("VmHWM", "VmRSS"))
        seconds = time.process_time() - self.start
        print(f"{name:<28} peak {peak:.2f} GiB, after it {held:.2f} GiB, {seconds:.1f} s")
        self.highest = max(self.highest, peak)
        RESET.write_text("5")
        self.start = time.process_time()


def main():
    """Build the scene's model and solve once, with parameters in the middle of their ranges."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("--set", action="append", default=[], dest="changes", metavar="KEY=VALUE")
    options = parser.parse_args()
    phases = Phases()
    builder = Builder(read_scene(options.scene, options.changes), str(options.scene), options.scene.parent)
    builder.check()
    phases.end("libraries")
    mesh = builder.domain.mesh()
    phases.end("mesh")
    built = builder.assemble(mesh)
    phases.end("assembly")
    model = builder.complete(built)
    phases.end("pattern of a step")
    _ = model.analysis
    phases.end("analysis")
    model.solve({each.name: float(each.quantile(0.5)) for each in builder.parameters(model).parameters})
    phases.end("solver and march")
    print(f"highest {phases.highest:.2f} GiB, {model.space.n_dofs} dofs")


if __name__ == "__main__":
    main()
