"""The stability map: what the theory admits is stable, what it refuses is not, on modes and on real matrices."""

import numpy as np
import pytest

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.amplification import Amplification, mode_radii
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.dynamics.system import StepSystem
from dacore.studies.stability import STABLE, Modes, UncheckedNewmark, newmark_map, oscillator_radii
from tests.unit.test_march import THETA, N, rod

RULES = ("backward_euler", "newmark")


@pytest.mark.parametrize("rule", RULES)
def test_the_measured_region_is_that_of_the_theory(rule):
    """Points a little inside and a little outside of 2β ≥ γ ≥ 1/2, and far from it."""
    gammas = np.array([0.3, 0.45, 0.499, 0.5, 0.6, 0.75, 1.0, 1.25])
    edges = np.concatenate([gammas / 2 - 1e-3, gammas / 2, gammas / 2 + 0.02])
    found = newmark_map(np.unique(np.append(edges, [0.1, 0.8])), gammas, rule, Modes.extreme(6.0, 4))
    np.testing.assert_array_equal(found.stable, found.admitted)
    assert found.admitted.any()
    assert not found.admitted.all()


@pytest.mark.parametrize("rho", [0.0, 0.2, 0.5, 0.9, 1.0])
def test_generalised_alpha_is_stable_for_every_mode(rho):
    assert Modes.extreme().radii(GeneralizedAlpha(rho)).max() <= STABLE


def test_the_largest_growth_of_the_range_the_paper_allows():
    """β = 1/4, γ = 1 multiplies the stiffest motions by 2 + √5 in each step, with either rule for the flow."""
    for rule in RULES:
        radius = Modes.extreme().radii(UncheckedNewmark(0.25, 1.0, rule)).max()
        assert radius == pytest.approx(2 + np.sqrt(5), rel=1e-4)


def test_backward_euler_does_not_widen_the_region():
    """γ = 1 needs β = 1/2 for weak flow (k τ² alone) and for strong flow (b²τ/κ alone)."""
    one, none = np.ones(1), np.zeros(1)
    scheme = UncheckedNewmark(0.45, 1.0, "backward_euler")
    assert mode_radii(scheme, 1.0, one, 1e6 * one, none, one, none) > 1.1
    assert mode_radii(scheme, 1.0, one, none, 1e3 * one, none, 1e-3 * one) > 1.1
    # Conditionally stable: T = 2dτ/m + kτ²/m up to 4/(2γ − 4β) = 20.
    assert oscillator_radii(scheme, np.sqrt([19.9])) <= STABLE
    assert oscillator_radii(scheme, np.sqrt([20.2])) > STABLE
    assert oscillator_radii(scheme, np.array([1e-3]), damping=9.9e3) <= STABLE
    assert oscillator_radii(scheme, np.array([1e-3]), damping=10.1e3) > STABLE


@pytest.mark.parametrize(
    "scheme", [Newmark(), Newmark(0.25, 0.5, "newmark"), GeneralizedAlpha(0.0), GeneralizedAlpha(0.7)]
)
def test_amplification_of_a_system_is_one_step(scheme):
    """Against MarchedModel without loads."""
    model, tau = rod(loads=()), 0.02
    system = StepSystem(model, scheme, tau)
    operator = Amplification(system, THETA)
    rng = np.random.default_rng(0)
    motion = rng.standard_normal((operator.size, 1))
    full = np.zeros((scheme.carried, 2 * N, 1))
    full[:, system.free] = motion.reshape(scheme.carried, system.free.size, 1)
    start = scheme.joined(tuple(full), tau)
    assert isinstance(start, State)
    end = MarchedModel(model, TimeGrid(tau, 1), scheme, tolerance=1e-13).march(THETA, start).states[system.free]
    moved = operator.apply(motion)
    np.testing.assert_allclose(moved[: system.free.size], end, rtol=0, atol=1e-8 * np.abs(end).max())
    np.testing.assert_allclose(operator.dense() @ motion, moved, rtol=0, atol=1e-9 * np.abs(moved).max())


@pytest.mark.parametrize("storage", [0.05, 1e-12, 0.0])
@pytest.mark.parametrize("mobility", [0.3, 1e-9])
def test_a_rod_is_stable_exactly_where_the_inequality_holds(storage, mobility):
    theta = THETA | {"storage": storage, "mobility": mobility}
    accepted = [
        Newmark(),
        Newmark(0.25, 0.5),
        Newmark(0.3, 0.6, "newmark"),
        GeneralizedAlpha(0.0),
        GeneralizedAlpha(1.0),
    ]
    for tau in (1e-4, 1e-2, 1.0):
        for scheme in accepted:
            assert Amplification(StepSystem(rod(), scheme, tau), theta).radius() < 1 + 1e-5, (scheme, tau)
    for rule in RULES:
        for beta, gamma in ((0.25, 1.0), (0.3, 0.7)):
            system = StepSystem(rod(), UncheckedNewmark(beta, gamma, rule), 1.0)
            assert Amplification(system, theta).radius() > 1.05


def test_large_systems_are_measured_by_iteration(monkeypatch):
    import dacore.dynamics.amplification as module

    system = StepSystem(rod(), UncheckedNewmark(0.25, 1.0, "newmark"), 0.1)
    dense = Amplification(system, THETA).radius()
    monkeypatch.setattr(module, "_LARGEST_DENSE", 0)
    assert Amplification(system, THETA).radius() == pytest.approx(dense, rel=1e-3)


def test_what_a_step_leaves_of_an_oscillator():
    omega = np.array([1e-3, 1e4])
    np.testing.assert_allclose(oscillator_radii(GeneralizedAlpha(0.5), omega), [1.0, 0.5], atol=0.01)
    np.testing.assert_allclose(oscillator_radii(Newmark(0.25, 0.5, "newmark"), omega), [1.0, 1.0], atol=1e-6)
    # β = 1/2, γ = 1, ωτ = 1: (z − 1)² + (z² + z)/2 = 3/2 z² − 3/2 z + 1 = 0, so |z|² = 2/3.
    np.testing.assert_allclose(oscillator_radii(Newmark(), np.array([1.0])), np.sqrt(2 / 3), rtol=1e-12)
    assert oscillator_radii(GeneralizedAlpha(0.5), np.array([0.1]), damping=0.1).item() < 0.996
