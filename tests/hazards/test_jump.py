"""A pressure that jumps at t = 0: what a mesh coarser than the layer of seepage, and shorter first steps, can do."""

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from tests.hazards.column import Column, at, difference, diffusivity

CYCLE = 0.02
LAYER = float(np.sqrt(diffusivity() * CYCLE))
"""√(c_v T) [cm]: how far a jump has seeped in after a cycle, 0.07 cm."""
PLAIN, GRADED = TimeGrid(5e-4, 40), TimeGrid(5e-4, 40, graded=8)


def column(size, **settings):
    """Ten layers of tissue in cells of `size` layers."""
    return Column(round(10 / size), inertia=False, height=10 * LAYER, **settings)


@pytest.fixture(scope="module")
def exact():
    fine = column(1 / 64, width=1, stabilization="lumped")
    return fine.solve("load", TimeGrid(5e-4, 40, substeps=4, graded=10))


def errors(exact, size, grid, **settings):
    """Errors of the first pressure, of all, and of the fluid that has left after the first and the last step."""
    heights, pressure, displacement = column(size, **settings).solve("load", grid)
    p, u = at(heights, (exact[0], exact[1], exact[2]))
    left = displacement[-1] / u[-1] - 1
    return difference(pressure[:, :1], p[:, :1]), difference(pressure, p), left[0], left[-1]


def test_fluid_that_leaves_needs_cells_of_half_the_layer(exact):
    """In one cycle, on elements of each kind."""
    for settings, coarse in (
        ({"order": 2}, 0.4),
        ({"stabilization": "projected"}, 0.4),
        ({"stabilization": "lumped"}, 1.0),
    ):
        assert errors(exact, 5, PLAIN, **settings)[3] > coarse
        assert abs(errors(exact, 0.5, PLAIN, **settings)[3]) < 0.03
    # Plain elements get the fluid right by chance, since the pressure that drives it is wrong by half as much again.
    assert errors(exact, 5, PLAIN)[0] > 1.2
    assert errors(exact, 0.5, PLAIN)[0] < 0.1


def test_shorter_first_steps_do_nothing_for_a_coarse_mesh(exact):
    for settings in ({}, {"order": 2}, {"stabilization": "lumped"}):
        plain, graded = errors(exact, 5, PLAIN, **settings), errors(exact, 5, GRADED, **settings)
        assert graded == pytest.approx(plain, rel=0.15)


def test_shorter_first_steps_pay_once_the_layer_of_a_step_is_resolved(exact):
    plain, graded = errors(exact, 0.125, PLAIN), errors(exact, 0.125, GRADED)
    assert graded[0] < 0.4 * plain[0]
    assert graded[1] < 0.6 * plain[1]
