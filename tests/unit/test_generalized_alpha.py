"""The generalised-α scheme: its equations, its published weights, what it keeps and what it damps."""

import numpy as np
import pytest

from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.errors import ShapeError, UnstableError

RHOS = [0.0, 0.3, 0.5, 0.8, 1.0]


def take_step(scheme, tau, mass, damping, stiffness, force, old):
    """One step with a constant force; returns the new state and y_*."""
    rule = scheme.rule(old, tau)
    matrix = rule.mass_factor * mass + rule.rate_factor * damping + stiffness
    right = force + mass @ scheme.mass_history(old, tau) + damping @ scheme.rate_history(old, tau)
    solved = np.linalg.solve(matrix, right)
    return scheme.advance(old, solved, tau), solved


@pytest.fixture
def system():
    """An oscillator of four masses, damped by something unsymmetric, and a state on it."""
    rng = np.random.default_rng(0)
    n = 4
    mass, stiffness = (b @ b.T + np.eye(n) for b in rng.standard_normal((2, n, n)))
    damping = 0.3 * rng.standard_normal((n, n))
    value, rate = rng.standard_normal((2, n, 2))
    force = rng.standard_normal((n, 2))
    acceleration = np.linalg.solve(mass, force - damping @ rate - stiffness @ value)
    return mass, damping, stiffness, force, State(value, rate, acceleration)


@pytest.mark.parametrize("rho", RHOS)
def test_equal_steps_are_the_published_scheme(system, rho):
    """Jansen, Whiting and Hulbert's weights on (y, v), written out as in their paper."""
    mass, damping, stiffness, force, start = system
    tau, scheme = 0.2, GeneralizedAlpha(rho)
    old, _ = take_step(scheme, tau, mass, damping, stiffness, force, start)
    new, _ = take_step(scheme, tau, mass, damping, stiffness, force, old)
    alpha_m, alpha_f = 0.5 * (3 - rho) / (1 + rho), 1 / (1 + rho)
    gamma = 0.5 + alpha_m - alpha_f

    def rates_at(one, other):
        return (1 - alpha_m) * one + alpha_m * other

    def values_at(one, other):
        return (1 - alpha_f) * one + alpha_f * other

    rate, velocity = rates_at(old.slope, new.slope), values_at(old.rate, new.rate)
    np.testing.assert_allclose(rate, velocity, atol=1e-12)
    balance = mass @ rates_at(old.acceleration, new.acceleration) + damping @ rate
    balance += stiffness @ values_at(old.value, new.value) - force
    assert np.abs(balance).max() < 1e-11
    mean = (1 - gamma) * old.slope + gamma * new.slope
    np.testing.assert_allclose(new.value, old.value + tau * mean, atol=1e-12)
    mean = (1 - gamma) * old.acceleration + gamma * new.acceleration
    np.testing.assert_allclose(new.rate, old.rate + tau * mean, atol=1e-12)


def test_one_is_the_trapezoidal_rule(system):
    mass, damping, stiffness, force, start = system
    one = other = start
    for tau in (0.2, 0.2, 0.1, 0.5):
        one, _ = take_step(GeneralizedAlpha(1.0), tau, mass, damping, stiffness, force, one)
        other, _ = take_step(Newmark(0.25, 0.5, "newmark"), tau, mass, damping, stiffness, force, other)
        np.testing.assert_allclose(one.value, other.value, atol=1e-11)
        np.testing.assert_allclose(one.rate, other.rate, atol=1e-11)


@pytest.mark.parametrize("tau", [0.3, 0.6, 0.1])
def test_zero_is_bdf2_also_when_the_step_changes(system, tau):
    """ẏ₁ = τ⁻¹ ((1 + 2r)/(1 + r) y₁ − (1 + r) y₀ + r²/(1 + r) y₋₁) with r the ratio of the steps."""
    mass, damping, stiffness, force, start = system
    scheme = GeneralizedAlpha(0.0)
    before, _ = take_step(scheme, 0.3, mass, damping, stiffness, force, State(*_arrays(start), None, np.inf))
    middle, _ = take_step(scheme, 0.3, mass, damping, stiffness, force, before)
    new, solved = take_step(scheme, tau, mass, damping, stiffness, force, middle)
    r = tau / 0.3
    rate = ((1 + 2 * r) / (1 + r) * new.value - (1 + r) * middle.value + r**2 / (1 + r) * before.value) / tau
    np.testing.assert_allclose(solved, new.value, atol=0)
    np.testing.assert_allclose(rate, new.rate, atol=1e-11)
    acceleration = ((1 + 2 * r) / (1 + r) * new.rate - (1 + r) * middle.rate + r**2 / (1 + r) * before.rate) / tau
    residual = mass @ acceleration + damping @ rate + stiffness @ new.value - force
    assert np.abs(residual).max() < 1e-10


@pytest.mark.parametrize("rho", RHOS)
def test_unknown_rates_begin_with_backward_euler(system, rho):
    mass, damping, stiffness, force, start = system
    start, tau = State(*_arrays(start), None, np.inf), 0.2
    new, _ = take_step(GeneralizedAlpha(rho), tau, mass, damping, stiffness, force, start)
    np.testing.assert_allclose(new.rate, (new.value - start.value) / tau, atol=1e-12)
    acceleration = (new.rate - start.rate) / tau
    residual = mass @ acceleration + damping @ new.rate + stiffness @ new.value - force
    assert np.abs(residual).max() < 1e-11
    assert new.lag == tau / 2


def _arrays(state):
    return state.value, state.rate, state.acceleration


@pytest.mark.parametrize("start_lag", [0.0, np.inf])
@pytest.mark.parametrize("rho", RHOS)
def test_second_order_with_steps_that_double_and_halve(system, rho, start_lag):
    mass, damping, stiffness, force, start = system
    start = State(*_arrays(start), None, start_lag)
    scheme = GeneralizedAlpha(rho)
    pattern = np.array([1, 1, 2, 4, 2, 1, 0.5, 0.5, 3, 1])
    ends, exact = [], _exact(system, 2.0)
    for refinement in (10, 20, 40):
        lengths = np.repeat(pattern, refinement)
        state = start
        for tau in 2.0 * lengths / lengths.sum():
            state, _ = take_step(scheme, tau, mass, damping, stiffness, force, state)
        ends.append(np.linalg.norm(state.value - exact))
    rates = np.log2(np.array(ends[:-1]) / ends[1:])
    assert abs(rates[-1] - 2) < 0.2, (rates, ends)


def _exact(system, time):
    from scipy.linalg import expm

    mass, damping, stiffness, force, start = system
    n = len(mass)
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    still = np.linalg.solve(stiffness, force)
    moved = expm(time * matrix) @ np.concatenate([start.value - still, start.rate])
    return moved[:n] + still


@pytest.mark.parametrize("rho", RHOS)
def test_the_stiffest_motion_is_multiplied_by_rho(rho):
    """An oscillator with ωτ = 1e6: what a step leaves of it, geometric mean over steps."""
    one = np.eye(1)
    scheme, state = GeneralizedAlpha(rho), State(one, 0 * one, -1e12 * one, None)
    sizes = []
    for _ in range(60):
        state, _ = take_step(scheme, 1.0, one, 0 * one, 1e12 * one, 0 * one, state)
        sizes.append(abs(state.value.item()))
    if rho in (0.0, 1.0):
        assert sizes[-1] == pytest.approx(rho, abs=1e-3)
    else:
        # A double eigenvalue −ρ: n ρⁿ.
        assert (sizes[-1] / sizes[29]) ** (1 / 30) == pytest.approx(rho, rel=0.05)


@pytest.mark.parametrize("rho", RHOS)
def test_energy_falls_by_what_the_scheme_says(rho):
    """½(‖x‖² + ‖x + 2sτẋ‖²) of x = (y, ẏ) loses 4s³‖τ(ẋ₁ − ẋ₀)‖² in each step, s = (1 − ρ)/(2(1 + ρ)), exactly."""
    rng = np.random.default_rng(1)
    n, tau, s = 5, 0.7, (1 - rho) / (2 * (1 + rho))
    mass, stiffness = (b @ b.T + 0.1 * np.eye(n) for b in rng.standard_normal((2, n, n)))
    stiff = np.logspace(0, 1.5, n)
    stiffness = stiffness * stiff[:, None] * stiff
    value, rate = rng.standard_normal((2, n, 1))
    old = State(value, rate, np.linalg.solve(mass, -stiffness @ value), None)
    old, _ = take_step(GeneralizedAlpha(rho), tau, mass, np.zeros((n, n)), stiffness, np.zeros((n, 1)), old)
    first = _energy(mass, stiffness, old.value, old.rate)

    def form(state):
        ahead = state.value + 2 * s * tau * state.slope, state.rate + 2 * s * tau * state.acceleration
        return 0.5 * (_energy(mass, stiffness, state.value, state.rate) + _energy(mass, stiffness, *ahead))

    for _ in range(100):
        new, _ = take_step(GeneralizedAlpha(rho), tau, mass, np.zeros((n, n)), stiffness, np.zeros((n, 1)), old)
        change = _energy(mass, stiffness, tau * (new.slope - old.slope), tau * (new.acceleration - old.acceleration))
        assert form(new) - form(old) == pytest.approx(-4 * s**3 * change, abs=1e-10 * first)
        old = new
    left = _energy(mass, stiffness, old.value, old.rate) / first
    assert left == pytest.approx(1, rel=1e-9) if rho == 1 else left < 0.7


def _energy(mass, stiffness, value, rate):
    return 0.5 * float((rate.T @ mass @ rate + value.T @ stiffness @ value).item())


@pytest.mark.parametrize("rho", [-0.1, 1.1])
def test_growing_choices_are_refused(rho):
    with pytest.raises(UnstableError, match=f"0 <= rho_inf <= 1 fails, rho_inf = {rho}"):
        GeneralizedAlpha(rho)


def test_numbers_must_be_finite():
    with pytest.raises(ShapeError, match="finite"):
        GeneralizedAlpha(float("nan"))


def test_states_are_checked():
    zero = np.zeros((3, 1))
    with pytest.raises(ShapeError, match="slope"):
        State(zero, zero, zero, np.zeros((2, 1)))
    with pytest.raises(ShapeError, match="lag"):
        State(zero, zero, zero, None, -1.0)
