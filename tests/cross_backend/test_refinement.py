"""Observables of different libraries and element orders converge to each other under refinement."""

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore_biot.model import Biot
from dacore_imaging.quantities import VolumeMean
from dacore_imaging.voxels import Voxels
from tests.backends import READY, backend

pytestmark = pytest.mark.skipif(len(READY) < 2, reason="one backend is installed: nothing to compare")

ROLES = {"neck": ("y-",), "ventricles": ("y+",), "mre": ("x-", "x+")}
LEVELS = (4, 8, 16, 32)


def observables(name, order, divisions):
    """Voxel averages of u and p and the mean of p over a plate of 4 cm, after eight steps."""
    mesh = Box((0.0, 0.0), (4.0, 4.0), (divisions, divisions), ROLES).mesh()
    physics = Biot(displacement_order=order, ranges={"kappa": (1e-6, 1e-6), "E": (1e4, 1e4), "nu": (0.3, 0.3)})
    model = physics.build(lambda fields: backend(name).discretize(mesh, fields))
    # Ramped by eight steps of a slow pulse; the pressure jump of the start is left out.
    marched = MarchedModel(model, TimeGrid(2e-3, 8), Newmark())
    parameters = {p.name: p.low for p in marched.parameters.parameters} | {"p_ventricles": 1e4}
    state = marched.solve(parameters).states[:, -1]
    operators = (Voxels(field="u", size=1.0), Voxels(field="p", size=1.0), VolumeMean("p"))
    return [operator.functionals(model.space)(state) for operator in operators]


@pytest.mark.parametrize(("fine", "coarse"), [(READY[-1], READY[0]), (READY[0], READY[-1])])
def test_first_and_second_order_meet(fine, coarse):
    gaps = []
    for divisions in LEVELS:
        linear, quadratic = observables(coarse, 1, divisions), observables(fine, 2, divisions)
        gaps.append([np.abs(a - b).max() / np.abs(b).max() for a, b in zip(linear, quadratic, strict=True)])
    gaps = np.array(gaps)
    assert (gaps[-1] < 0.02).all(), gaps
    # The pressure jumps where two roles meet, which costs regularity there: less than the full second order.
    rates = np.log2(gaps[0] / gaps[-1]) / (len(LEVELS) - 1)
    assert (rates > 1.2).all(), (gaps, rates)
