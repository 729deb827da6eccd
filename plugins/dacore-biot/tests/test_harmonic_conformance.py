"""The harmonic model keeps every promise of a physics, on the reference elements and on scikit-fem's."""

from functools import partial

import numpy as np

from dacore.core.mesh import Mesh
from dacore.testing import model_suite
from dacore.testing.meshes import shuffled_box
from dacore_biot.harmonic import BiotHarmonic
from dacore_biot.inclusions import Inclusion
from dacore_skfem.backend import SkfemBackend

LOADS = ("xi", "p_csf", "p_ventricles", "neck_displacement")


def head(dim: int, n: int) -> Mesh:
    """An uneven box of 5 cm with a hole in its middle, held on the left."""
    box = shuffled_box(dim, n, bumpy=True, hole=True)
    tags = np.where(box.facet_tags == box.roles["right"], box.roles["side"], box.facet_tags)
    roles = {"neck": box.roles["left"], "mre": box.roles["side"], "ventricles": box.roles["hole"]}
    return Mesh(5.0 * box.points, box.cells, box.facets, tags, roles)


PHASES = {"phase_xi": (-0.3, 0.3), "phase_csf": (-1.0, 1.0), "phase_ventricles": (-1.0, 1.0), "p_csf": (50.0, 100.0)}

test_solid = model_suite(BiotHarmonic(), partial(head, 3, 3), affine_in=LOADS).as_test()
test_phases = model_suite(BiotHarmonic(ranges=PHASES), partial(head, 2, 5), affine_in=LOADS).as_test()
test_taylor_hood = model_suite(
    BiotHarmonic(displacement_order=2, pulse_axis=0, pressure_on_neck="csf", log_uniform=("kappa",)),
    partial(head, 2, 5),
    backend=SkfemBackend(),
    affine_in=LOADS,
).as_test()
test_projected = model_suite(
    BiotHarmonic(stabilization="projected", inclusions=(Inclusion((1.0, 1.0), 1.0, 3.0),)),
    partial(head, 2, 5),
    affine_in=LOADS,
).as_test()
test_without_loss = model_suite(
    BiotHarmonic(ranges={"loss": (0.0, 0.0)}, frequency=20.0), partial(head, 2, 5), affine_in=LOADS
).as_test()
