"""Consolidation from the sudden load itself: the undrained jump, the overshoot of Mandel and Cryer, the settlement."""

import numpy as np
import pytest

from dacore_biot.analytic import Mandel, Medium
from tests.backends import READY
from tests.verification.consolidation import BALL, BLOCK, COLUMN, cryer, mandel, terzaghi
from tests.verification.setting import errors, march_graded

LEVELS = 7
TISSUE = Mandel(Medium(alpha=1.0, skempton=0.99))
"""Nearly incompressible constituents, as in the brain: the stronger overshoot."""


def history(case, scale, per_level, end=0.5):
    return march_graded(case, end * scale, per_level, LEVELS)


def at_point(case, states, point, field="p", component=0):
    """Values (t,) of a component at a point."""
    layout = case.model.space.layout
    row = case.model.space.discretization.evaluation(np.array([point]), field)
    return (row @ states[layout.component(field, component)])[0]


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize("piston", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
def test_terzaghi_settles_in_time(name, dim, piston):
    case = terzaghi(name, dim, 1, 16, piston)
    found = history(case, COLUMN.time_scale, 16)
    top = (0.1,) * (dim - 1) + (1.0,)
    seen = -at_point(case, found.states, top, "u", dim - 1)
    expected = np.array([COLUMN.settlement(t) for t in found.times])
    late = found.times > 0.004 * COLUMN.time_scale
    np.testing.assert_allclose(seen[late], expected[late], rtol=4e-3)
    assert errors(case, found, [0.125 * COLUMN.time_scale])["p"] < 4e-3
    # Far from the drain p is still what it was at once; the thin layer at the drain is not resolved yet.
    deep = (0.1,) * (dim - 1) + (0.9 if piston else 0.1,)
    assert at_point(case, found.states, deep)[0] == pytest.approx(COLUMN.initial_pressure, rel=1e-3)


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda name: mandel(name, 1, 16, "given", TISSUE), TISSUE),
        (lambda name: mandel(name, 1, 16, "tied", TISSUE), TISSUE),
        (lambda name: mandel(name, 2, 8, "tied", TISSUE), TISSUE),
        (lambda name: cryer(name, 1, 8), BALL),
    ],
    ids=["Mandel, plate given", "Mandel, plate rigid", "Mandel, P2–P1", "Cryer"],
)
def test_pressure_rises_before_it_falls(name, make, problem):
    """The Mandel–Cryer effect: its height and its time, by steps of 4% of the time that has passed."""
    case = make(name)
    found = history(case, problem.time_scale, 16)
    centre = (0.0,) * case.model.space.discretization.mesh.dim
    seen = at_point(case, found.states, centre)
    exact = np.array([problem.pressure(np.zeros(1), t)[0] for t in found.times])
    rise, expected = seen.max() / problem.initial_pressure, exact.max() / problem.initial_pressure
    assert expected > 1.05
    # A tenth of the rise itself: an answer without the effect is off by all of it.
    assert rise - 1 == pytest.approx(expected - 1, rel=0.1)
    peak, late = exact.argmax(), found.times > 0.02 * problem.time_scale
    assert found.times[seen.argmax()] == pytest.approx(found.times[peak], rel=0.2)
    np.testing.assert_allclose(seen[late], exact[late], atol=0.03 * problem.initial_pressure)


@pytest.mark.parametrize("name", READY)
def test_mandels_plate_moves_as_the_formula_says(name):
    """Only the force is given: its motion is the answer, the pressure's push included."""
    case = mandel(name, 1, 16, "tied")
    found = history(case, BLOCK.time_scale, 16)
    seen = at_point(case, found.states, (0.3, 1.0), "u", 1)
    np.testing.assert_allclose(at_point(case, found.states, (0.9, 1.0), "u", 1), seen, rtol=1e-13)
    expected = np.array([BLOCK.plate(t) for t in found.times])
    late = found.times > 0.004 * BLOCK.time_scale
    np.testing.assert_allclose(seen[late], expected[late], rtol=2e-3)


def test_steps_of_backward_euler_converge_with_order_one():
    """On one mesh, in steps ever finer: against the finest."""
    case = mandel(READY[0], 1, 8, "tied")
    states = [history(case, BLOCK.time_scale, per_level).states[:, -1] for per_level in (8, 16, 32, 256)]
    for field in ("u", "p"):
        rows = case.model.space.layout.block(field)
        gaps = [np.linalg.norm((state - states[-1])[rows]) for state in states[:-1]]
        # Against a reference of 256 steps the ratios are (1/8 − 1/256)/(1/16 − 1/256) = 2.07 and 2.14.
        assert 2.0 < gaps[0] / gaps[1] < 2.15
        assert 2.05 < gaps[1] / gaps[2] < 2.25
