"""The model keeps every promise of a physics, on the reference elements and on scikit-fem's."""

from functools import partial

import numpy as np

from dacore.core.mesh import Mesh
from dacore.testing import model_suite
from dacore.testing.meshes import shuffled_box
from dacore_biot.model import Biot
from dacore_skfem.backend import SkfemBackend

LOADS = ("xi", "p_csf", "p_ventricles", "neck_displacement")


def head(dim: int, n: int) -> Mesh:
    """An uneven box of 5 cm with a hole in its middle, held on the left."""
    box = shuffled_box(dim, n, bumpy=True, hole=True)
    tags = np.where(box.facet_tags == box.roles["right"], box.roles["side"], box.facet_tags)
    roles = {"neck": box.roles["left"], "mre": box.roles["side"], "ventricles": box.roles["hole"]}
    return Mesh(5.0 * box.points, box.cells, box.facets, tags, roles)


test_solid = model_suite(Biot(), partial(head, 3, 3), affine_in=LOADS).as_test()
test_taylor_hood = model_suite(
    Biot(displacement_order=2, pulse_axis=0, pressure_on_neck="csf", log_uniform=("kappa",)),
    partial(head, 2, 5),
    backend=SkfemBackend(),
    affine_in=LOADS,
).as_test()
test_lumped = model_suite(Biot(stabilization="lumped"), partial(head, 2, 5), affine_in=LOADS).as_test()
test_projected = model_suite(Biot(stabilization="projected"), partial(head, 2, 5), affine_in=LOADS).as_test()
