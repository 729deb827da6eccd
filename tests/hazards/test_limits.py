"""κ → 0, S → 0 (B → 1 with α = 1), τ → 0: steps stay solvable and errors bounded where the elements are stable."""

import pytest

from dacore.errors import ShapeError
from dacore_biot import material
from dacore_biot.model import Biot
from tests.hazards.manufactured import TISSUE, one_step

STABLE = [{"stabilization": "lumped"}, {"stabilization": "projected"}, {"order": 2}]
LIMITS = [
    {"kappa": 1e-20}, {"skempton": 1.0}, {"kappa": 1e-20, "skempton": 1.0}, {"kappa": 0.0}, {"step": 1e-12},
    {"step": 1e-12, "skempton": 1.0},
]  # fmt: skip


def named(changes):
    return ", ".join(f"{key} = {value}" for key, value in changes.items())


@pytest.mark.parametrize("limit", LIMITS, ids=named)
@pytest.mark.parametrize("remedy", STABLE, ids=named)
def test_errors_are_those_of_the_limit(remedy, limit):
    """No more than what the elements give at a thousandth of the parameters' own distance from the limit."""
    near = one_step(16, wild=True, **remedy, kappa=TISSUE["kappa"] * 1e-3, skempton=0.99999)
    found = one_step(16, wild=True, **remedy, **limit)
    assert found.pressure < 1.1 * near.pressure + 1e-3
    assert found.displacement < 1.1 * near.displacement


def test_plain_elements_get_ever_worse_on_the_way():
    errors = [one_step(16, wild=True, skempton=1.0, kappa=kappa).pressure for kappa in (1e-8, 1e-11, 1e-14)]
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] > 10 * one_step(16, wild=True, skempton=1.0, kappa=1e-14, stabilization="projected").pressure


def test_where_nothing_is_left_that_determines_the_pressure_the_scene_is_refused():
    assert material.storage(TISSUE | {"skempton": 1.0}) == 0.0
    with pytest.raises(ShapeError, match=r"kappa: got 0 with alpha · skempton = 1"):
        Biot(skempton=1.0, ranges={"kappa": (0.0, 1e-8)})
