"""The energy of a discrete motion: kept, lost or carried away exactly as the scheme and the equations say."""

from dataclasses import replace

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark, State
from dacore.dynamics.profiles import Sine
from dacore_biot.analytic import Medium
from tests.backends import READY
from tests.verification.motion import Energy, bar, rates_of, shaken, wave
from tests.verification.setting import SECOND_ORDER


def moved(case, scheme, duration, steps):
    """States, rates and accelerations (n_dofs, steps + 1) from rest, and the step."""
    still = np.zeros((case.model.space.n_dofs, 1))
    step = duration / steps
    found = MarchedModel(case.model, TimeGrid(step, steps), scheme, tolerance=1e-13).march(
        case.parameters, State.at_rest(still)
    )
    motion = rates_of(found.states, step, scheme, *(still[:, 0],) * 3)
    return *(np.concatenate([still, part], axis=1) for part in (found.states, *motion)), step


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize("undrained_bar", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
def test_a_free_wave_keeps_its_energy(name, undrained_bar, fixed):
    """β = 1/4, γ = 1/2: to rounding, through reflections at both ends, and it is the energy the pulse brought."""
    problem = bar(undrained_bar, fixed)
    case = wave(name, 2, 1, 32, problem)
    duration = 3.1 * problem.length / problem.speed
    states, rates, _, step = moved(case, SECOND_ORDER, duration, 198)
    energy = Energy(case).total(states, rates)
    free = step * np.arange(199) > problem.pulse.duration
    assert np.ptp(energy[free]) < 1e-9 * energy.max()
    # Until something comes back the end moves with traction/(ρc): ∫ traction²/(ρc) over the pulse and the width.
    pulse, width = problem.pulse, 2 / 32 * problem.length
    brought = 35 / 128 * pulse.load**2 * pulse.duration / (problem.medium.density * problem.speed) * width
    assert energy[-1] == pytest.approx(brought, rel=0.02)


@pytest.mark.parametrize("beta", [0.5, 0.7])
def test_a_damping_scheme_loses_what_theory_says(beta):
    """γ = 1: E + (β − 1/2)τ² (ÿ, Mÿ)/2 falls by (Δy, AΔy)/2 + (β − 1/2)τ² (Δÿ, MΔÿ)/2 a step.

    Hughes, The Finite Element Method (1987), chapter 9.
    """
    problem = bar(False, True)
    case = wave(READY[0], 2, 1, 32, problem)
    scheme = Newmark(beta, 1.0, "newmark")
    states, rates, bends, step = moved(case, scheme, 3.1 * problem.length / problem.speed, 198)
    forms, free = Energy(case), step * np.arange(199) > problem.pulse.duration
    extra = (beta - 0.5) * step**2

    def kinetic(a):
        return 0.5 * (a * (forms.mass @ a)).sum(axis=0)

    total = forms.total(states, rates) + extra * kinetic(bends)
    change = np.diff(states, axis=1)
    loss = 0.5 * (change * (forms.elastic @ change)).sum(axis=0) + extra * kinetic(np.diff(bends, axis=1))
    both = free[1:] & free[:-1]
    np.testing.assert_allclose(-np.diff(total)[both], loss[both], atol=1e-11 * total.max())
    assert (np.diff(total)[both] < 0).all()
    assert total[-1] < 0.7 * total[free][0]


@pytest.mark.parametrize("name", READY)
def test_work_is_stored_or_seeps_away(name):
    """The whole coupled balance over a cycle, every step: ΔE = work of the load − what Darcy's flow takes.

    It holds to rounding if the two couplings are transposes of each other, whatever the mesh.
    """
    case = shaken(name, 2, 1, 8)
    steps, duration = 60, 1 / 60.0
    # A sine starts smoothly, so that rest is a consistent start.
    (load,) = case.model.loads
    profile = Sine(60.0)
    case = replace(case, model=replace(case.model, loads=(replace(load, profile=profile),)))
    states, rates, _, step = moved(case, SECOND_ORDER, duration, steps)
    forms = Energy(case)
    energy, lost = forms.total(states, rates), forms.lost(states, step)
    push = profile(step * np.arange(steps + 1))
    work = 0.5 * (push[1:] + push[:-1]) * (load.force @ np.diff(states, axis=1))
    scale = np.abs(work).sum()
    np.testing.assert_allclose(np.diff(energy), work - lost, atol=1e-9 * scale)
    assert (lost > 0).all()
    assert lost.sum() > 0.05 * scale


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize("undrained_bar", [False, True])
def test_speed_of_the_wave(name, undrained_bar):
    """From the time at which half of the impulse has passed the middle of the bar, without any formula of its shape."""
    problem = bar(undrained_bar, True)
    case = wave(name, 2, 1, 64, problem)
    states, _, _, step = moved(case, SECOND_ORDER, 1.2 * problem.length / problem.speed, 200)
    row = case.model.space.discretization.evaluation(np.array([[0.5, 0.01], [0.75, 0.01]]), "u")
    passed = row @ states[case.model.space.layout.component("u", 0)]
    arrivals = [np.interp(0.5, curve / curve[-1], step * np.arange(201)) for curve in passed * np.sign(passed[:, -1:])]
    assert 0.25 / (arrivals[0] - arrivals[1]) == pytest.approx(problem.speed, rel=5e-3)


def test_the_fast_wave_is_faster():
    """By the factor √(1 + α²/(S(λ + 2μ))); with B close to 1 it is the speed of sound in the fluid that counts."""
    soft = Medium(nu=0.45, alpha=1.0, skempton=0.99, kappa=0.0)
    for medium in (Medium(), soft):
        assert medium.undrained_uniaxial > medium.uniaxial
    assert np.sqrt(soft.undrained_uniaxial / soft.uniaxial) > 3
