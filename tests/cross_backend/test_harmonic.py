"""Amplitudes and phases are the same whatever the library."""

from functools import cache

import numpy as np
import pytest

from dacore.core.mesh import Mesh
from dacore_biot.harmonic import BiotHarmonic
from dacore_biot.inclusions import Inclusion
from tests.backends import READY, backend
from tests.meshes import shuffled_box

OTHERS = [name for name in READY if name != "skfem"]
CASES = [(dim, order) for dim in (2, 3) for order in (1, 2)]

pytestmark = pytest.mark.skipif(len(READY) < 2, reason="one backend is installed: nothing to compare")


@cache
def mesh(dim):
    unit = shuffled_box(dim, n=6 if dim == 2 else 3, seed=3, bumpy=True)
    return Mesh(8.0 * unit.points, unit.cells, unit.facets, unit.facet_tags, unit.roles)


@cache
def solved(name, dim, order, loss):
    physics = BiotHarmonic(
        displacement_order=order, neck="left", ventricles="right", mre="side", tolerance=1e-12,
        inclusions=(Inclusion((4.0,) * dim, 2.5, 3.0),),
    )  # fmt: skip
    model = physics.build(lambda fields: backend(name).discretize(mesh(dim), fields))
    given = {"p_csf": 80.0, "phase_csf": 0.7, "neck_displacement": 1e-4, "loss": loss}
    return model.space.layout, model.solve(model.parameters.middle | given).states


@pytest.mark.parametrize("loss", [0.3, 0.0])
@pytest.mark.parametrize(("dim", "order"), CASES)
@pytest.mark.parametrize("name", OTHERS)
def test_states_agree_to_nine_digits(name, dim, order, loss):
    layout, mine = solved("skfem", dim, order, loss)
    _, theirs = solved(name, dim, order, loss)
    for field in ("u", "p"):
        rows = layout.block(field)
        assert np.abs(mine[rows]).max() > 0
        assert np.abs(theirs[rows] - mine[rows]).max() < 1e-9 * np.abs(mine[rows]).max()
