"""Motions at one frequency against a formula, against marching, and against the balance of power."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.core.model import combine
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.harmonic import HarmonicModel, amplitude, phases
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.scheme import State
from tests.backends import READY
from tests.verification.motion import SHAKEN, shaken
from tests.verification.norms import rates, sizes_and_errors
from tests.verification.setting import SECOND_ORDER, SPOILT

LOSSY = replace(SHAKEN, loss=0.4)
RESONANT = replace(SHAKEN, frequency=190.0, loss=0.05)


class Loss:
    def __init__(self, value):
        self.value = value

    def __call__(self, parameters):
        return self.value


def harmonic(case, column):
    losses = dict.fromkeys(("shear", "dilation"), Loss(column.loss))
    return HarmonicModel(case.model, column.frequency, losses)


def solved(case, column):
    return harmonic(case, column).solve(case.parameters)


def errors_of(case, column):
    """Relative errors of u, grad u, p and grad p over the cycle."""
    total, found = {}, solved(case, column)
    for time, state in zip(found.times, found.states.T, strict=True):
        for name, pair in sizes_and_errors(case.model.space, state, *case.exact(time)).items():
            total[name] = np.asarray(pair) ** 2 + total.get(name, 0.0)
    return {name: float(np.sqrt(error / size)) for name, (error, size) in total.items()}


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize(
    ("column", "dim", "order", "sizes"),
    [
        (SHAKEN, 2, 1, (8, 16)),
        (LOSSY, 2, 1, (8, 16)),
        (RESONANT, 2, 2, (8, 16)),
        (LOSSY, 3, 1, (12, 24)),
        (LOSSY, 2, 2, (8, 16)),
    ],
)
def test_orders_and_errors_against_the_formula(column, dim, order, sizes, name):
    found = [errors_of(shaken(name, dim, order, n, column), column) for n in sizes]
    for each, wanted in {"u": 2, "grad u": order, "p": 2, "grad p": 1}.items():
        (rate,) = rates(sizes, [one[each] for one in found])
        # In three dimensions u has not quite reached its order on meshes that a quick test can afford.
        assert rate > wanted - (0.15 if dim == 2 else 0.2), (each, rate)
    assert found[-1]["u"] < 6e-3
    assert found[-1]["p"] < 6e-3


@pytest.mark.parametrize("what", [key for key in SPOILT if key.endswith("5% high")])
def test_a_coefficient_5_percent_off_is_noticed(what):
    case = shaken(READY[0], 2, 2, 12, LOSSY)
    right, wrong = (errors_of(one, LOSSY) for one in (case, case.spoilt(SPOILT[what])))
    assert max(wrong["u"] / right["u"], wrong["p"] / right["p"]) > 3, what


def test_a_loss_5_percent_off_and_one_of_the_other_sign_are_noticed():
    case = shaken(READY[0], 2, 2, 12, LOSSY)
    right = errors_of(case, LOSSY)
    assert errors_of(case, replace(LOSSY, loss=0.42))["u"] > 3 * right["u"]
    found, exact = solved(case, LOSSY), solved(case, replace(LOSSY, loss=0.0))
    assert np.abs(amplitude(found.states)).max() < np.abs(amplitude(exact.states)).max()


def started(case, column):
    """State, rate and acceleration of the harmonic motion at t = 0."""
    y = amplitude(solved(case, column).states)
    turn = 2j * np.pi * column.frequency
    return State(*((y * turn**k).real[:, None] for k in range(3)))


def test_marching_goes_on_as_the_harmonic_motion_does():
    """One period from its state, rate and acceleration: the difference falls with the square of the step."""
    case = shaken(READY[0], 2, 2, 6)
    period, found = 1 / SHAKEN.frequency, []
    exact = solved(case, SHAKEN).states[:, 0]
    for steps in (40, 80, 160):
        marched = MarchedModel(case.model, TimeGrid(period / steps, steps), SECOND_ORDER, tolerance=1e-12)
        last = marched.march(case.parameters, started(case, SHAKEN)).states[:, -1]
        found.append(np.linalg.norm(last - exact) / np.linalg.norm(exact))
    assert found[-1] < 2e-3
    assert np.all(np.log2(np.array(found[:-1]) / found[1:]) > 1.9), found


def test_a_march_from_rest_ends_in_the_harmonic_motion():
    """Seepage takes the transient away; what is left differs by the square of the step."""
    case, column = shaken(READY[0], 2, 1, 6), SHAKEN
    exact, found, cycles = solved(case, column), [], 40
    for steps in (20, 40, 80):
        grid = TimeGrid(1 / column.frequency / steps, steps, spin_up=(cycles - 1) * steps)
        cycle = MarchedModel(case.model, grid, SECOND_ORDER, tolerance=1e-12).solve(case.parameters)
        # The last recorded state is a whole number of periods after t = 0, and k = steps/4 a quarter.
        seen = cycle.states[:, [-1, steps // 4 - 1]]
        found.append(np.linalg.norm(seen - exact.states) / np.linalg.norm(exact.states))
    assert found[-1] < 1e-3
    assert np.all(np.log2(np.array(found[:-1]) / found[1:]) > 1.9), found


@pytest.mark.parametrize("name", READY)
def test_what_the_load_does_seepage_and_loss_take(name):
    """Mean power over a cycle: ½ Re(F̂·conj(iωû)) = ½ ω η û*K û + ½ p̂*(κ/μ)L p̂."""
    case = shaken(name, 2, 1, 8, LOSSY)
    model, n = case.model, case.model.space.n_dofs
    y = amplitude(solved(case, LOSSY).states)
    terms = {t.name: t for t in model.zeroth_order}
    elastic, seepage = (
        combine([terms[key] for key in keys], case.parameters, n) for keys in (("shear", "dilation"), ("seepage",))
    )
    omega = 2 * np.pi * LOSSY.frequency
    given = 0.5 * (model.loads[0].force @ np.conj(1j * omega * y)).real
    lost = 0.5 * omega * LOSSY.loss * np.vdot(y, elastic @ y).real
    seeped = 0.5 * np.vdot(y, seepage @ y).real
    assert min(lost, seeped) > 1e-3 * given > 0
    assert given == pytest.approx(lost + seeped, rel=1e-8)


def test_phases_are_a_pair_that_gives_every_time():
    case = shaken(READY[0], 2, 1, 4)
    found = solved(case, SHAKEN)
    y = amplitude(found.states)
    assert np.array_equal(phases(y), found.states)
    angle = 1.234
    at = found.states @ [np.cos(angle), np.sin(angle)]
    assert np.allclose(at, (y * np.exp(1j * angle)).real, rtol=1e-13, atol=0)
