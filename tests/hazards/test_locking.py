"""ν → 1/2: displacements of order 1 lock, those of order 2 do not; what the user hears."""

import pytest

from dacore.core.timegrid import TimeGrid
from dacore.domains.ball import Ball
from dacore.dynamics.march import MarchedModel
from dacore.errors import ConvergenceError, ShapeError
from dacore_biot.cautions import LOCKING
from dacore_biot.model import Biot
from tests.backends import backend
from tests.hazards.manufactured import one_step

DRAINED, UNDRAINED = 1e2, 3e-9
NEARLY = (0.4, 0.49, 0.499, 0.4999, 0.49999)


@pytest.mark.parametrize("kappa", [DRAINED, UNDRAINED], ids=["drained", "undrained"])
def test_order_two_does_not_lock(kappa):
    for nu in NEARLY:
        # The residual of a system whose entries cancel to 1 part in 1e5 cannot be less than this.
        found = one_step(16, order=2, kappa=kappa, nu=nu, tolerance=1e-8)
        assert found.displacement < 0.02, nu
        assert found.pressure < 0.02, nu


@pytest.mark.parametrize("kappa", [DRAINED, UNDRAINED], ids=["drained", "undrained"])
@pytest.mark.parametrize("remedy", ["none", "projected", "lumped"])
def test_order_one_locks_with_every_remedy_of_the_pressure(kappa, remedy):
    errors = [one_step(16, stabilization=remedy, kappa=kappa, nu=nu).displacement for nu in (0.4, LOCKING, 0.4999)]
    assert errors[0] < 0.08
    assert errors[1] > 4 * errors[0]
    assert errors[2] > 0.9, "almost nothing is left of the displacement"


@pytest.mark.parametrize(
    ("settings", "heard"),
    [
        ({"ranges": {"nu": (0.4, 0.495)}}, True),
        ({}, False),
        ({"ranges": {"nu": (0.4, 0.495)}, "displacement_order": 2}, False),
    ],
)
def test_a_scene_that_locks_says_so(settings, heard):
    mesh = Ball(edge=2.0).mesh()
    model = Biot(**settings).build(lambda fields: backend("skfem").discretize(mesh, fields))
    said = MarchedModel(model, TimeGrid(5e-4, 4)).cautions(model.parameters)
    assert any("displacement_order = 2" in line and "nu goes up to 0.495" in line for line in said) == heard


def test_one_half_is_refused_and_what_cannot_be_solved_to_the_tolerance_says_so():
    with pytest.raises(ShapeError, match=r"nu: got 0.5, expected a value in \(-1, 0.5\)"):
        Biot(ranges={"nu": (0.45, 0.5)})
    with pytest.raises(ConvergenceError, match="or ask for a larger tolerance"):
        one_step(16, order=2, nu=0.4999999, tolerance=1e-10)
