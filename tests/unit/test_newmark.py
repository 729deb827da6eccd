"""Newmark's family: the derivation, the stability region and the printed formula that is wrong."""

import numpy as np
import pytest

from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.errors import ShapeError, UnstableError

SCHEMES = [(0.25, 0.5), (0.3025, 0.6), (0.5, 1.0), (0.5, 0.5), (0.8, 1.2)]


def unchecked(beta: float, gamma: float, first_order: str = "newmark") -> Newmark:
    """A scheme that Newmark would refuse, to show why."""
    scheme = object.__new__(Newmark)
    for name, value in (("beta", beta), ("gamma", gamma), ("first_order", first_order)):
        object.__setattr__(scheme, name, value)
    return scheme


def take_step(scheme, tau, mass, damping, stiffness, force, old):
    matrix = scheme.mass_factor(tau) * mass + scheme.rate_factor(tau) * damping + stiffness
    right = force + mass @ scheme.mass_history(old, tau) + damping @ scheme.rate_history(old, tau)
    return scheme.advance(old, np.linalg.solve(matrix, right), tau)


def amplification(scheme, tau, mass, damping, stiffness):
    """The map (y, ẏ, ÿ) -> the same one step later, of an unforced system."""
    n = len(mass)
    columns = []
    for unit in np.eye(3 * n):
        old = State(*(part[:, None] for part in unit.reshape(3, n)))
        new = take_step(scheme, tau, mass, damping, stiffness, np.zeros((n, 1)), old)
        columns.append(np.concatenate([new.value, new.rate, new.acceleration])[:, 0])
    return np.array(columns).T


def radius(scheme, frequency_step, damping=0.0):
    """Spectral radius for ÿ + d ẏ + ω² y = 0 with ωτ given, τ = 1."""
    m, c, k = (np.array([[value]]) for value in (1.0, damping, frequency_step**2))
    return float(np.abs(np.linalg.eigvals(amplification(scheme, 1.0, m, c, k))).max())


@pytest.fixture
def system():
    rng = np.random.default_rng(0)
    n = 6
    mass, damping, stiffness = (b @ b.T + np.eye(n) for b in rng.standard_normal((3, n, n)))
    old = State(*rng.standard_normal((3, n, 2)))
    return mass, damping, stiffness, rng.standard_normal((n, 2)), old


@pytest.mark.parametrize(("beta", "gamma"), SCHEMES)
def test_step_satisfies_the_equation_and_both_updates(system, beta, gamma):
    mass, damping, stiffness, force, old = system
    tau = 0.3
    new = take_step(Newmark(beta, gamma, "newmark"), tau, mass, damping, stiffness, force, old)
    residual = mass @ new.acceleration + damping @ new.rate + stiffness @ new.value - force
    assert np.abs(residual).max() < 1e-11
    # Newmark's own form of the updates: a Taylor step with an averaged acceleration.
    value = old.value + tau * old.rate + tau**2 * ((0.5 - beta) * old.acceleration + beta * new.acceleration)
    rate = old.rate + tau * ((1 - gamma) * old.acceleration + gamma * new.acceleration)
    np.testing.assert_allclose(new.value, value, atol=1e-12)
    np.testing.assert_allclose(new.rate, rate, atol=1e-12)


def test_backward_euler_takes_the_difference_quotient_in_first_order_terms(system):
    mass, damping, stiffness, force, old = system
    tau = 0.3
    new = take_step(Newmark(0.5, 1.0, "backward_euler"), tau, mass, damping, stiffness, force, old)
    residual = mass @ new.acceleration + damping @ (new.value - old.value) / tau + stiffness @ new.value - force
    assert np.abs(residual).max() < 1e-11


@pytest.mark.parametrize("beta", [0.5, 0.75, 1.0])
def test_right_side_is_not_the_printed_one(system, beta):
    """Printed for γ = 1: (1−2β)/(2β)(M+C)ÿ + (M/(βτ²)+C/(βτ))(y+τẏ); −Cẏ and a factor τ are missing."""
    mass, damping, _, _, old = system
    tau = 0.3
    scheme = Newmark(beta, 1.0, "newmark")
    ours = mass @ scheme.mass_history(old, tau) + damping @ scheme.rate_history(old, tau)
    rest = (1 - 2 * beta) / (2 * beta)
    moved = (mass / (beta * tau**2) + damping / (beta * tau)) @ (old.value + tau * old.rate)
    printed = rest * (mass + damping) @ old.acceleration + moved
    corrected = rest * (mass + tau * damping) @ old.acceleration + moved - damping @ old.rate
    np.testing.assert_allclose(ours, corrected, rtol=1e-12, atol=1e-11)
    assert np.abs(ours - printed).max() > 0.1


@pytest.mark.parametrize(
    ("beta", "gamma", "inequality", "amount"),
    [
        (0.25, 1.0, "2 beta >= gamma", "0.5 below"),
        (0.0, 0.5, "2 beta >= gamma", "0.5 below"),
        (0.5, 0.4, "gamma >= 1/2", "0.1 too small"),
        (0.49, 1.0, "2 beta >= gamma", "0.02 below"),
    ],
)
def test_unstable_choices_are_refused_with_the_inequality_that_fails(beta, gamma, inequality, amount):
    with pytest.raises(UnstableError, match=f"{inequality} fails.*{amount}"):
        Newmark(beta, gamma)


@pytest.mark.parametrize(("beta", "gamma"), [(float("nan"), 1.0), (0.5, float("inf"))])
def test_numbers_must_be_finite(beta, gamma):
    with pytest.raises(ShapeError, match="finite"):
        Newmark(beta, gamma)


def test_unknown_rule_is_refused():
    with pytest.raises(ShapeError, match="backward_euler"):
        Newmark(first_order="trapezoidal")


@pytest.mark.parametrize(("beta", "gamma"), [(0.25, 1.0), (0.49, 1.0), (0.5, 0.45), (0.2, 0.5)])
def test_refused_choices_do_blow_up(beta, gamma):
    assert max(radius(unchecked(beta, gamma), w) for w in np.logspace(-1, 3, 200)) > 1.001


def test_the_published_choice_multiplies_by_four_in_each_step():
    """β = 1/4 with γ = 1, inside the range the paper allows: radius 2 + √5 for stiff modes."""
    assert radius(unchecked(0.25, 1.0), 1e4) == pytest.approx(2 + np.sqrt(5), rel=1e-6)


@pytest.mark.parametrize(("beta", "gamma"), SCHEMES)
def test_accepted_choices_do_not(beta, gamma):
    scheme = Newmark(beta, gamma, "newmark")
    assert max(radius(scheme, w, d) for w in np.logspace(-2, 4, 60) for d in (0.0, 0.1, 10.0)) < 1 + 1e-6


@pytest.mark.parametrize("first_order", ["newmark", "backward_euler"])
@pytest.mark.parametrize(("beta", "gamma"), SCHEMES)
def test_coupled_flow_without_mass_is_stable(beta, gamma, first_order):
    """m ü + k u − a p = 0, S ṗ + a u̇ + κ p = 0, the smallest poroelastic system."""
    scheme = Newmark(beta, gamma, first_order)
    rng = np.random.default_rng(1)
    for m, k, a, s, kappa in 10.0 ** rng.uniform(-2, 2, (200, 5)):
        mass, damping, stiffness = np.diag([m, 0.0]), np.array([[0.0, 0], [a, s]]), np.array([[k, -a], [0, kappa]])
        values = np.linalg.eigvals(amplification(scheme, 1.0, mass, damping, stiffness))
        assert np.abs(values).max() < 1 + 1e-6


@pytest.mark.parametrize(("beta", "gamma", "order"), [(0.25, 0.5, 2), (0.5, 1.0, 1), (0.3025, 0.6, 1)])
def test_order_on_an_oscillator(beta, gamma, order):
    errors = []
    for steps in (100, 200, 400):
        tau = 1.0 / steps
        one = np.ones((1, 1))
        state = State(one, 0 * one, -9.0 * one)
        for _ in range(steps):
            state = take_step(Newmark(beta, gamma, "newmark"), tau, one, 0 * one, 9 * one, 0 * one, state)
        errors.append(abs(state.value[0, 0] - np.cos(3.0)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - order) < 0.1)


def test_shapes_of_a_state_must_agree():
    with pytest.raises(ShapeError, match="one shape"):
        State(np.zeros((3, 1)), np.zeros((3, 2)), np.zeros((3, 1)))
