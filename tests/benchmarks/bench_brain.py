"""Cost of each part of the main job on the brain, in CPU seconds of one process and one BLAS thread.

Run with ``make bench``. Nothing is asserted about time: machines differ and are shared.
"""

import resource
import time

import pytest

from dacore.algebra.threads import one_blas_thread
from dacore.core.fespace import FiniteElementSpace
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel

biot = pytest.importorskip("dacore_biot.model")
brain = pytest.importorskip("dacore_imaging.brain")
skfem = pytest.importorskip("dacore_skfem.backend")
voxels = pytest.importorskip("dacore_imaging.voxels")


def timed(label, work):
    started = time.process_time()
    result = work()
    spent = time.process_time() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  {label:<44}{spent:8.2f} s   peak so far {peak:7.0f} MiB")
    return result


@pytest.mark.parametrize("nodes", ["5k", "33k"])
def test_cost_of_the_main_job(nodes):
    print(f"\nbrain {nodes}")
    with one_blas_thread():
        mesh = timed("mesh from the template", brain.Brain(nodes=nodes).mesh)
        backend = skfem.SkfemBackend()
        model = timed("all Biot matrices, P1-P1", lambda: biot.Biot().build(lambda f: backend.discretize(mesh, f)))
        marched = timed("restriction to free dofs, symmetry check", lambda: MarchedModel(model, TimeGrid(5e-4, 40)))
        timed("elimination order, once for all samples", lambda: marched.analysis)
        middle = model.parameters.middle
        timed("one trajectory of 40 steps at 1e-10", lambda: marched.solve(middle))
        space = FiniteElementSpace(backend.discretize(mesh, list(model.space.fields)))
        slices = (voxels.Slice("z", 8.5),)
        timed("voxels of 1 cm, one slice", lambda: voxels.Voxels(size=1.0, slices=slices).functionals(space))
        whole = timed("voxels of 1 cm, whole brain", lambda: voxels.Voxels(size=1.0).functionals(space))
        print(f"  {len(mesh.points):,} nodes, {model.space.n_dofs:,} dofs, {whole.count:,} functionals")
        assert whole.count > 3000
