"""Tissue of two stiffnesses has the same matrices with every library."""

import numpy as np
import pytest

from dacore.core.mesh import Mesh
from dacore.workflow.comparison.agreement import relative_difference
from dacore_biot.inclusions import Inclusion
from dacore_biot.model import Biot
from tests.backends import READY, backend
from tests.meshes import shuffled_box

OTHERS = [name for name in READY if name != "skfem"]


@pytest.mark.parametrize("stabilization", ["none", "lumped"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", OTHERS)
def test_matrices_agree(name, dim, order, stabilization):
    unit = shuffled_box(dim, n=6 if dim == 2 else 3, seed=2, bumpy=True)
    mesh = Mesh(8.0 * unit.points, unit.cells, unit.facets, unit.facet_tags, unit.roles)
    balls = (Inclusion((2.0,) * dim, 3.0, 10.0), Inclusion((6.0,) * dim, 2.5, 0.2))
    physics = Biot(
        displacement_order=order, stabilization=stabilization, inclusions=balls,
        neck="left", ventricles="right", mre="side",
    )  # fmt: skip
    ours, theirs = (physics.build(lambda f, n=n: backend(n).discretize(mesh, f)) for n in ("skfem", name))
    plain = Biot(
        displacement_order=order, stabilization=stabilization, neck="left", ventricles="right", mre="side"
    ).build(lambda f: backend(name).discretize(mesh, f))
    changed = set()
    for group in ("second_order", "first_order", "zeroth_order"):
        for mine, other, without in zip(*(getattr(of, group) for of in (ours, theirs, plain)), strict=True):
            assert mine.name == other.name
            assert relative_difference(other.matrix, mine.matrix) < 1e-12, mine.name
            if relative_difference(other.matrix, without.matrix) > 0.1:
                changed.add(mine.name)
    remedy = {"stabilization", "lumping"} if stabilization == "lumped" else set()
    assert changed == {"shear", "dilation", "storage"} | remedy
    assert np.unique(np.round(mesh.volumes, 12)).size > 1
