"""Marching an affine model: one set-up a sample, superposition, starts, symmetry; on a poroelastic rod."""

import pickle
from dataclasses import replace
from operator import itemgetter

import numpy as np
import pytest
from scipy.sparse import csr_array

from dacore.algebra.solvers import Auto, Direct
from dacore.core.fields import Field, Layout
from dacore.core.model import AffineTerm, Load
from dacore.core.space import StateSpace
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.pattern import PatternSum
from dacore.dynamics.profiles import Constant, Course, Pulse, Ramp, Sine, SmoothRamp, ToneBurst
from dacore.dynamics.scheme import State
from dacore.dynamics.static import consistent_start, steady_state
from dacore.dynamics.system import StepSystem
from dacore.errors import AccuracyError, CapabilityError, ShapeError
from tests import rods

N = 12
GRID = TimeGrid(0.05, 6)
THETA = {"rho": 1.3, "modulus": 40.0, "alpha": 0.8, "storage": 0.05, "mobility": 0.3, "pull": -2.0}
THETA |= {"inflow": 5.0, "outflow": 1.0}
SCHEMES = [Newmark(), Newmark(0.25, 0.5, "newmark"), Newmark(0.5, 1.0, "newmark"), Newmark(0.3, 0.55)]
DAMPED = [GeneralizedAlpha(0.0), GeneralizedAlpha(0.5), GeneralizedAlpha(1.0)]


class Rod(StateSpace):
    """u and p on N points of [0, 1]."""

    @property
    def layout(self):
        return Layout((Field("u", 1), Field("p", 1)), {"u": N, "p": N})

    def scalar_product(self, field, kind="l2"):
        return csr_array(np.eye(N))

    def evaluation(self, points, field, derivative=None):
        raise NotImplementedError


def rod(**changes):
    """The rod of N points at THETA, its pressures the other way round, in the Euclidean product."""
    force, left, right = np.eye(2 * N)[[N - 1, N, 2 * N - 1]]
    none = np.zeros(2 * N)
    parts = {
        "space": Rod(),
        "loads": (
            Load("pull", itemgetter("pull"), Sine(1.0), force, none),
            Load("inflow", itemgetter("inflow"), Constant(), none, right),
            Load("outflow", itemgetter("outflow"), Constant(), none, left),
        ),
    }
    return rods.rod(N, {name: (value, value) for name, value in THETA.items()}, **(parts | changes))


class Counter:
    """Counts how often a solver is set up, and how often and for how many columns it is used."""

    def __init__(self, make):
        self.make, self.setups, self.solves, self.columns = make, 0, 0, 0

    def __call__(self, *args):
        self.setups += 1
        solver, counter = self.make(*args), self

        class Counted:
            def solve(self, rhs, guess=None):
                counter.solves += 1
                counter.columns += rhs.shape[1]
                return solver.solve(rhs, guess)

        return Counted()


@pytest.fixture
def counter(monkeypatch):
    count = Counter(Auto.prepare)
    monkeypatch.setattr(Auto, "prepare", lambda *given: count(*given))
    return count


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("start", ["zero", "steady"])
def test_every_step_satisfies_the_equations_of_the_full_system(scheme, start):
    """Dense check that neither elimination nor scaling changed the problem."""
    model, grid = rod(), TimeGrid(0.02, 15)
    states = MarchedModel(model, grid, scheme, start).solve(THETA).states
    mass, damping, stiffness = (
        sum(t.coefficient(THETA) * t.matrix.toarray() for t in terms)
        for terms in (model.second_order, model.first_order, model.zeroth_order)
    )
    y = steady_state(model, THETA, np.array([[0.0], [5.0], [1.0]])) if start == "steady" else np.zeros((2 * N, 1))
    old, free = State.at_rest(y), ~model.constrained
    for k, time in enumerate(grid.times):
        new = scheme.advance(old, states[:, k : k + 1], grid.step)
        euler = (new.value - old.value) / grid.step
        rate = euler if scheme.first_order == "backward_euler" else new.rate
        force = sum(load.amplitude(THETA) * load.profile(np.array([time])) * load.force for load in model.loads)
        residual = mass @ new.acceleration + damping @ rate + stiffness @ new.value - force[:, None]
        assert np.abs(residual[free]).max() < 1e-8 * np.abs(stiffness @ new.value).max()
        assert states[-1, k] == THETA["inflow"]
        assert states[N, k] == THETA["outflow"]
        assert states[0, k] == 0.0
        old = new


@pytest.mark.parametrize("scheme", DAMPED)
@pytest.mark.parametrize("start", ["zero", "steady"])
@pytest.mark.parametrize("graded", [0, 3])
def test_generalised_alpha_balances_forces_between_the_steps(scheme, start, graded):
    model, grid = rod(), TimeGrid(0.02, 8, substeps=2, graded=graded)
    marched = MarchedModel(model, grid, scheme, start)
    matrices = [
        sum(t.coefficient(THETA) * t.matrix.toarray() for t in terms)
        for terms in (model.second_order, model.first_order, model.zeroth_order)
    ]
    y = steady_state(model, THETA, np.array([[0.0], [5.0], [1.0]])) if start == "steady" else np.zeros((2 * N, 1))
    old = State.at_rest(y, lag=np.inf if start == "zero" else 0.0)
    free, time, recorded = ~model.constrained, 0.0, []
    held = np.zeros(2 * N)
    held[[N, 2 * N - 1]] = THETA["outflow"], THETA["inflow"]
    for tau, end, keep in zip(grid.lengths, grid.ends, grid.recorded, strict=True):
        rule = scheme.rule(old, tau)
        w = rule.weight
        value = np.zeros((2 * N, 1))
        value[~free, 0] = ((1 - w) * old.value[:, 0] + w * held)[~free]
        force = np.zeros((2 * N, 1))
        force[N - 1] = THETA["pull"] * ((1 - w) * np.sin(2 * np.pi * time) + w * np.sin(2 * np.pi * end))
        whole = rule.mass_factor * matrices[0] + rule.rate_factor * matrices[1] + matrices[2]
        right = force + matrices[0] @ scheme.mass_history(old, tau) + matrices[1] @ scheme.rate_history(old, tau)
        value[free] = np.linalg.solve(whole[np.ix_(free, free)], (right - whole @ value)[free])
        old, time = scheme.advance(old, value, tau), end
        np.testing.assert_allclose(old.value[~free, 0], held[~free], atol=1e-12)
        if keep:
            recorded.append(old.value[:, 0])
    states = marched.solve(THETA).states
    np.testing.assert_allclose(states, np.array(recorded).T, rtol=0, atol=1e-7 * np.abs(states).max())


def test_responses_share_one_factorisation_and_superposition_costs_no_solve(counter):
    model = MarchedModel(rod(), TimeGrid(0.02, 20), tolerance=1e-12)
    responses = model.responses(THETA)
    assert (counter.setups, counter.solves, counter.columns) == (1, 20, 60)
    for inflow in (0.0, 5.0, 7.0):
        theta = THETA | {"inflow": inflow}
        cheap = responses.superpose(model.model.amplitudes(theta)).states
        assert counter.setups == 1
        assert counter.solves == 20
        monolithic = MarchedModel(rod(), TimeGrid(0.02, 20), tolerance=1e-12).solve(theta).states
        counter.setups, counter.solves = 1, 20
        np.testing.assert_allclose(cheap, monolithic, rtol=0, atol=1e-9 * np.abs(monolithic).max())


def test_responses_of_chosen_loads(counter):
    model = MarchedModel(rod(), TimeGrid(0.02, 5), tolerance=1e-12)
    every, chosen = model.responses(THETA), model.responses(THETA, ["outflow", "pull"])
    assert chosen.loads == ("outflow", "pull")
    assert counter.columns == 5 * 3 + 5 * 2
    np.testing.assert_allclose(chosen.states, every.states[[2, 0]], rtol=0, atol=1e-9)
    with pytest.raises(ShapeError, match="got push, expected any of pull, inflow, outflow"):
        model.responses(THETA, ["push"])


def test_a_trajectory_needs_one_set_up_and_one_column(counter):
    MarchedModel(rod(), TimeGrid(0.02, 20, spin_up=5)).solve(THETA)
    assert (counter.setups, counter.solves, counter.columns) == (1, 25, 25)


def test_superposition_holds_for_a_steady_start_too():
    model = MarchedModel(rod(), TimeGrid(0.02, 10), start="steady")
    expected = model.solve(THETA).states
    states = model.responses(THETA).superpose(model.model.amplitudes(THETA)).states
    np.testing.assert_allclose(states, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_responses_do_not_depend_on_amplitudes():
    model = MarchedModel(rod(), TimeGrid(0.02, 5))
    np.testing.assert_array_equal(model.responses(THETA).states, model.responses(THETA | {"pull": 9.0}).states)


@pytest.mark.parametrize("scheme", SCHEMES + DAMPED)
def test_steady_start_stays_steady_without_a_pulse(scheme):
    model = MarchedModel(rod(), TimeGrid(0.02, 30), scheme, start="steady")
    states = model.solve(THETA | {"pull": 0.0}).states
    np.testing.assert_allclose(states, states[:, :1].repeat(30, axis=1), rtol=0, atol=1e-8 * np.abs(states).max())
    x = np.linspace(0, 1, N)
    np.testing.assert_allclose(states[N:], (1 + 4 * x)[:, None].repeat(30, axis=1), rtol=1e-8)
    # modulus u'' = alpha p' = 4 alpha, u(0) = 0, u'(1) = 0: exact at the nodes.
    exact = THETA["alpha"] / THETA["modulus"] * 4 * (0.5 * x**2 - x)
    np.testing.assert_allclose(states[:N, -1], exact, rtol=0, atol=1e-8 * np.abs(exact).max())


def test_zero_start_drifts_to_the_steady_state():
    """Damping by the scheme and by seepage leaves the equilibrium, however it began."""
    theta = THETA | {"pull": 0.0}
    last = MarchedModel(rod(), TimeGrid(0.05, 1, spin_up=4000)).solve(theta).states[:, 0]
    steady = MarchedModel(rod(), TimeGrid(0.05, 1), start="steady").solve(theta).states[:, 0]
    np.testing.assert_allclose(last, steady, rtol=0, atol=1e-7 * np.abs(steady).max())


@pytest.mark.parametrize("scheme", [*SCHEMES[:2], *DAMPED])
@pytest.mark.parametrize("start", ["zero", "steady"])
def test_superposition_holds_with_graded_steps_and_ramps(scheme, start):
    base = rod()
    loads = (base.loads[0], *(replace(load, profile=SmoothRamp(0.05)) for load in base.loads[1:]))
    for model in (base, rod(loads=loads), rod(loads=(*base.loads[:2], loads[2]))):
        marched = MarchedModel(model, TimeGrid(0.02, 6, spin_up=2, substeps=2, graded=3), scheme, start)
        expected = marched.solve(THETA).states
        states = marched.responses(THETA).superpose(model.amplitudes(THETA)).states
        np.testing.assert_allclose(states, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("scheme", [*SCHEMES, *DAMPED])
def test_substeps_are_the_shorter_steps_and_grading_splits_the_first(scheme):
    fine = MarchedModel(rod(), TimeGrid(0.005, 24), scheme, tolerance=1e-12).solve(THETA)
    same = MarchedModel(rod(), TimeGrid(0.02, 6, substeps=4), scheme, tolerance=1e-12).solve(THETA)
    np.testing.assert_allclose(same.times, fine.times[3::4], rtol=1e-14)
    np.testing.assert_allclose(same.states, fine.states[:, 3::4], rtol=0, atol=1e-9 * np.abs(fine.states).max())
    graded = MarchedModel(rod(), TimeGrid(0.02, 6, substeps=4, graded=2), scheme, tolerance=1e-12).solve(THETA)
    np.testing.assert_array_equal(graded.times, same.times)
    # Its first states: three steps of 1/4, 1/4, 1/2 of 5 ms, by hand.
    model = rod()
    if isinstance(scheme, Newmark):
        system = StepSystem(model, scheme, 0.005)
        old = State.at_rest(np.zeros((2 * N, 1)))
        for tau, end in zip((0.00125, 0.00125, 0.0025), (0.00125, 0.0025, 0.005), strict=True):
            step = system.at(THETA, scheme.regular(tau))
            weights = np.array([[THETA["pull"] * np.sin(2 * np.pi * end)], [5.0], [1.0]])
            value = np.zeros((2 * N, 1))
            value[system.constrained] = system.prescribed @ weights
            right = step.right_side(old, weights, step=tau)
            value[system.free] = np.linalg.solve(step.matrix.toarray(), right)
            old = scheme.advance(old, value, tau)
        first = MarchedModel(model, TimeGrid(0.005, 1, graded=2), scheme, tolerance=1e-12).solve(THETA).states
        np.testing.assert_allclose(first, old.value, rtol=0, atol=1e-8 * np.abs(first).max())


@pytest.mark.parametrize(
    ("scheme", "graded", "setups"),
    [
        (Newmark(), 0, 1),
        (Newmark(), 4, 5),
        (GeneralizedAlpha(0.5), 0, 3),
        (GeneralizedAlpha(0.5), 4, 7),
        (GeneralizedAlpha(1.0), 4, 6),
    ],
)
def test_each_length_of_step_costs_a_factorisation(counter, scheme, graded, setups):
    """Generalised α: backward Euler first, and again where the step before had another length (not for ρ = 1)."""
    grid = TimeGrid(0.02, 10, substeps=2, graded=graded)
    MarchedModel(rod(), grid, scheme).solve(THETA)
    assert (counter.setups, counter.solves) == (setups, 20 + graded)


def test_the_first_step_of_generalised_alpha_depends_on_whether_something_jumps(counter):
    base, scheme, grid = rod(), GeneralizedAlpha(1.0), TimeGrid(0.02, 10)
    MarchedModel(base, grid, scheme, "steady").solve(THETA)
    assert counter.setups == 2 + 1  # the flow and the momentum balance at rest, and the steps
    ramped = tuple(replace(load, profile=SmoothRamp(0.1)) for load in base.loads[1:])
    MarchedModel(rod(loads=(base.loads[0], *ramped)), grid, scheme).solve(THETA)
    assert counter.setups == 3 + 1
    MarchedModel(base, grid, scheme).solve(THETA)
    assert counter.setups == 4 + 2  # backward Euler once, then the steps


def test_a_graded_damped_start_does_not_ring():
    """After a jump at both ends; the trapezoidal rule keeps what its first step did not resolve."""
    theta = THETA | {"pull": 0.0, "alpha": 0.0, "inflow": 1.0, "outflow": 1.0, "storage": 0.01}
    exact = MarchedModel(rod(), TimeGrid(0.02, 10, substeps=400), Newmark(0.5, 1.0)).solve(theta).states[N:]
    errors = {}
    for name, scheme, graded in (
        ("trapezoidal", Newmark(0.25, 0.5, "newmark"), 0),
        ("published", Newmark(), 0),
        ("damped", GeneralizedAlpha(0.5), 0),
        ("graded", GeneralizedAlpha(0.5), 5),
    ):
        states = MarchedModel(rod(), TimeGrid(0.02, 10, graded=graded), scheme).solve(theta).states[N:]
        errors[name] = np.abs(states - exact).max()
    assert errors["trapezoidal"] > 0.2
    assert errors["graded"] < 0.02
    assert errors["graded"] < 0.3 * min(errors["damped"], errors["published"])


def test_spin_up_is_marched_but_not_recorded():
    long = MarchedModel(rod(), TimeGrid(0.02, 30)).solve(THETA)
    late = MarchedModel(rod(), TimeGrid(0.02, 10, spin_up=20)).solve(THETA)
    np.testing.assert_array_equal(late.states, long.states[:, 20:])
    np.testing.assert_allclose(late.times, long.times[20:])


def test_pickled_model_solves_alike():
    model = MarchedModel(rod(), TimeGrid(0.02, 5), Newmark(0.25, 0.5, "newmark"), "steady", Direct(), 1e-9)
    copy = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(copy.solve(THETA).states, model.solve(THETA).states)
    assert (copy.start, copy.method, copy.tolerance) == ("steady", Direct(), 1e-9)


@pytest.mark.parametrize("scheme", SCHEMES + DAMPED)
def test_step_matrix_is_symmetric_quasi_definite(scheme):
    system = StepSystem(rod(), scheme, 0.02)
    matrix = system.at(THETA).matrix.toarray()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-13 * np.abs(matrix).max())
    definite = system.definite
    assert np.linalg.eigvalsh(matrix[np.ix_(definite, definite)]).min() > 0
    assert np.linalg.eigvalsh(matrix[np.ix_(~definite, ~definite)]).max() < 0


def test_a_boundary_where_nothing_is_held_is_refused():
    held = np.zeros(2 * N, dtype=bool)
    with pytest.raises(AccuracyError, match="unsymmetric"):
        MarchedModel(rod(constrained=held, loads=()), TimeGrid(0.02, 3))


def test_unmarked_flow_rows_are_refused():
    with pytest.raises(AccuracyError, match="unsymmetric"):
        MarchedModel(rod(antisymmetric=np.zeros(2 * N, dtype=bool)), TimeGrid(0.02, 3))


def off_the_middle(parameters):
    low, high = rods.RANGES["storage"]
    return parameters["storage"] - 0.5 * (low + high)


def test_a_step_that_is_symmetric_in_the_middle_of_the_ranges_only_is_refused():
    model = rods.rod(N)
    drift = rods.place(rods.matrices(N)[2], 0, 0)
    wrong = replace(model, zeroth_order=(*model.zeroth_order, AffineTerm("drift", drift, off_the_middle)))
    with pytest.raises(AccuracyError, match="unsymmetric"):
        MarchedModel(wrong, GRID)


def test_wrongly_marked_rows_are_refused():
    with pytest.raises(ShapeError, match="antisymmetric rows have mass"):
        MarchedModel(rod(antisymmetric=np.arange(2 * N) < N), TimeGrid(0.02, 3))


def test_a_model_without_free_dofs_is_refused():
    with pytest.raises(ShapeError, match="every dof is constrained"):
        MarchedModel(rod(constrained=np.ones(2 * N, dtype=bool)), TimeGrid(0.02, 3))


def test_missing_parameters_are_named():
    theta = {name: value for name, value in THETA.items() if name != "alpha"}
    with pytest.raises(ShapeError, match="alpha missing"):
        MarchedModel(rod(), TimeGrid(0.02, 3)).solve(theta)


def test_unknown_start_is_refused():
    with pytest.raises(ShapeError, match="'zero' or 'steady'"):
        MarchedModel(rod(), TimeGrid(0.02, 3), start="rest")


def test_a_flow_that_sees_the_displacement_at_rest_has_no_steady_start():
    base = rod()
    sight = AffineTerm("sight", rods.place(rods.matrices(N)[0], 1, 0), itemgetter("alpha"))
    model = rod(zeroth_order=(*base.zeroth_order, sight))
    with pytest.raises(CapabilityError, match="steady start"):
        steady_state(model, THETA, np.eye(3))


def test_consistent_start_satisfies_the_equations_at_time_zero():
    model = rod()
    rng = np.random.default_rng(0)
    given = State(*(rng.standard_normal((2 * N, 1)) for _ in range(3)))
    start = consistent_start(model, THETA, given)
    mass, damping, stiffness = (
        sum(t.coefficient(THETA) * t.matrix for t in terms)
        for terms in (model.second_order, model.first_order, model.zeroth_order)
    )
    residual = mass @ start.acceleration + damping @ start.rate + stiffness @ start.value
    assert np.abs(residual[~model.constrained]).max() < 1e-9
    np.testing.assert_array_equal(start.rate[:N], given.rate[:N])
    np.testing.assert_array_equal(start.rate[model.constrained], given.rate[model.constrained])


def test_energy_is_lost_to_seepage_alone():
    """β = 1/4, γ = 1/2: E₁ − E₀ = −τ κ |∇p_mid|², exactly; E = ½(ẏᵀMẏ + uᵀKu + S pᵀMp)."""
    model, grid = rod(loads=()), TimeGrid(0.03, 60)
    mass, stiffness, _ = rods.matrices(N)
    rng = np.random.default_rng(0)
    value, rate = np.zeros((2 * N, 1)), np.zeros((2 * N, 1))
    value[1:-1] = rng.standard_normal((2 * N - 2, 1))
    value[N] = 0.0
    rate[1:N] = rng.standard_normal((N - 1, 1))
    for mobility in (0.0, 0.3):
        theta = THETA | {"mobility": mobility}
        start = consistent_start(model, theta, State(value, rate, np.zeros_like(value)))
        scheme = Newmark(0.25, 0.5, "newmark")
        states = MarchedModel(model, grid, scheme, tolerance=1e-12).march(theta, start).states
        old, energies, losses = start, [], []
        for column in [None, *states.T]:
            new = old if column is None else scheme.advance(old, column[:, None], grid.step)
            (u, p), v = new.value[:, 0].reshape(2, N), new.rate[:N, 0]
            kinetic, elastic = theta["rho"] * v @ (mass @ v), theta["modulus"] * u @ (stiffness @ u)
            energies.append(0.5 * (kinetic + elastic + theta["storage"] * p @ (mass @ p)))
            middle = 0.5 * (old.value + new.value)[N:, 0]
            losses.append(grid.step * mobility * middle @ (stiffness @ middle))
            old = new
        np.testing.assert_allclose(np.diff(energies), -np.array(losses[1:]), rtol=0, atol=1e-9 * energies[0])
        if mobility:
            assert energies[-1] < 0.9 * energies[0]


@pytest.mark.parametrize("rho", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("mobility", [0.0, 0.3])
def test_energy_of_generalised_alpha_is_lost_to_seepage_and_to_damping_alone(rho, mobility):
    """The exact balance of `dacore.dynamics.generalized_alpha`, of the whole coupled system."""
    model, tau, scheme = rod(loads=()), 0.03, GeneralizedAlpha(rho)
    mass, stiffness, _ = rods.matrices(N)
    theta, s = THETA | {"mobility": mobility}, (1 - rho) / (2 * (1 + rho))
    rng = np.random.default_rng(0)
    value, rate = np.zeros((2 * N, 1)), np.zeros((2 * N, 1))
    value[1:-1] = rng.standard_normal((2 * N - 2, 1))
    value[N] = 0.0
    rate[1:N] = rng.standard_normal((N - 1, 1))

    def energy(values, velocities):
        (u, p), v = values[:, 0].reshape(2, N), velocities[:N, 0]
        kinetic, elastic = theta["rho"] * v @ (mass @ v), theta["modulus"] * u @ (stiffness @ u)
        return 0.5 * (kinetic + elastic + theta["storage"] * p @ (mass @ p))

    def form(state):
        ahead = state.value + 2 * s * tau * state.slope, state.rate + 2 * s * tau * state.acceleration
        return 0.5 * (energy(state.value, state.rate) + energy(*ahead))

    system = StepSystem(model, scheme, tau)
    old = consistent_start(model, theta, State(value, rate, np.zeros_like(value)))
    first, none = energy(old.value, old.rate), np.zeros((0, 1))
    for k in range(60):
        step = system.at(theta, scheme.rule(old, tau))
        new = step.take(Direct().prepare(step.matrix, system.definite, 1e-13), old, none, none, tau)
        w = step.rule.weight
        middle = ((1 - w) * old.value + w * new.value)[N:, 0]
        seepage = tau * mobility * middle @ (stiffness @ middle)
        if k:
            change = energy(tau * (new.slope - old.slope), tau * (new.acceleration - old.acceleration))
            expected = -seepage - 4 * s**3 * change
            assert form(new) - form(old) == pytest.approx(expected, abs=1e-9 * first)
        old = new
    left = energy(old.value, old.rate) / first
    assert left == pytest.approx(1.0, rel=1e-8) if rho == 1 and mobility == 0 else left < 0.9


def test_sum_on_one_pattern_equals_the_sum_of_the_blocks():
    rng = np.random.default_rng(0)
    terms = [csr_array(np.where(rng.random((8, 8)) < 0.4, rng.standard_normal((8, 8)), 0.0)) for _ in range(4)]
    terms.append(terms[1] * 2.0)  # the same pattern
    terms.append(csr_array((np.array([1.0, 2.0, 4.0]), np.array([3, 0, 3]), np.array([0, 0, 3, *[3] * 6])), (8, 8)))
    rows, left, right = np.array([0, 1, 4, 6]), np.array([0, 3, 6]), np.array([1, 2, 7])
    before = [term.toarray() for term in terms]
    total = PatternSum(terms, (8, 8), rows, (left, right))
    for weights in (rng.standard_normal(6), np.array([1.0, 0.0, 0.0, 2.0, 0.0, 0.0])):
        expected = sum(w * t for w, t in zip(weights, before, strict=True))
        for block, columns in zip(total.combine(weights), (left, right), strict=True):
            np.testing.assert_allclose(block.toarray(), expected[np.ix_(rows, columns)], atol=1e-14)
            checked = csr_array((block.data, block.indices, block.indptr), block.shape)
            assert checked.has_canonical_format
    for term, values in zip(terms, before, strict=True):
        np.testing.assert_array_equal(term.toarray(), values)
    empty = PatternSum([], (8, 8), rows, (left, right[:0]))
    assert [(block.shape, block.nnz) for block in empty.combine(np.zeros(0))] == [((4, 3), 0), ((4, 0), 0)]
    with pytest.raises(ShapeError, match="matrices of a sum"):
        PatternSum(terms, (5, 7), rows, (left, right))


def test_profiles():
    times = np.array([0.0, 0.05, 0.1, 0.4])
    np.testing.assert_allclose(Sine(5.0)(times), np.sin(10 * np.pi * times))
    np.testing.assert_allclose(Ramp(0.1)(times), [0, 0.5, 1, 1])
    np.testing.assert_allclose(Constant()(times), 1.0)
    np.testing.assert_allclose(SmoothRamp(0.1)(times), [0, 0.5, 1, 1])
    near = SmoothRamp(1.0)(np.array([1e-4, 1 - 1e-4]))
    np.testing.assert_allclose([near[0], 1 - near[1]], 1e-11, rtol=1e-3)
    for make, value in ((Sine, 0.0), (Ramp, -1.0), (SmoothRamp, 0.0)):
        with pytest.raises(ShapeError, match="positive"):
            make(value)


def test_grids_of_steps():
    grid = TimeGrid(0.4, 3, spin_up=1, substeps=2, graded=2)
    np.testing.assert_allclose(grid.lengths, [0.05, 0.05, 0.1, *[0.2] * 7])
    np.testing.assert_allclose(grid.ends, np.cumsum(grid.lengths))
    np.testing.assert_allclose(grid.times, [0.8, 1.2, 1.6])
    np.testing.assert_allclose(grid.ends[grid.recorded], grid.times)
    np.testing.assert_array_equal(TimeGrid(0.1, 7, 3).ends[3:], TimeGrid(0.1, 7, 3).times)
    fine = grid.divided(3)
    np.testing.assert_array_equal(fine.times, grid.times)
    assert (fine.substeps, len(fine.ends)) == (6, 4 * 6 + 2)
    for wrong, message in (
        ({"substeps": 0}, "substeps: got 0"),
        ({"graded": -1}, "graded: got -1"),
        ({"graded": 31}, "0 to 30"),
    ):
        with pytest.raises(ShapeError, match=message):
            TimeGrid(0.1, 3, **wrong)


def test_an_initial_state_is_where_the_march_starts():
    """Recomputed from the same state handed over by hand; superposed with the other loads; with every scheme."""
    shape = np.sin(np.linspace(0.0, 3.0, 2 * N)) + 0.3
    model = rod()
    warm = replace(model, loads=(*model.loads, Load.at_start("warm", twice, shape)))
    for scheme in (Newmark(), Newmark(0.25, 0.5, "newmark"), GeneralizedAlpha(0.5)):
        for grid in (GRID, replace(GRID, graded=2), replace(GRID, spin_up=3, substeps=2)):
            started = MarchedModel(warm, grid, scheme, tolerance=1e-12)
            states = started.solve(THETA).states
            at = State.at_rest(2.0 * shape[:, None], lag=np.inf)
            by_hand = MarchedModel(model, grid, scheme, tolerance=1e-12).march(THETA, at).states
            assert np.abs(states - by_hand).max() < 1e-9 * np.abs(states).max()
            responses = started.responses(THETA)
            again = responses.superpose(warm.amplitudes(THETA)).states
            assert np.abs(states - again).max() < 1e-9 * np.abs(states).max()
            plain = MarchedModel(model, grid, scheme, tolerance=1e-12).solve(THETA).states
            assert np.abs(states - plain).max() > 1e-3 * np.abs(states).max()


def test_constrained_dofs_have_their_prescribed_values_after_an_initial_state():
    model = rod()
    warm = replace(model, loads=(*model.loads, Load.at_start("warm", twice, np.ones(2 * N))))
    for scheme in (Newmark(), GeneralizedAlpha(0.5)):
        states = MarchedModel(warm, GRID, scheme).solve(THETA).states
        wanted = MarchedModel(model, GRID, scheme).solve(THETA).states
        np.testing.assert_allclose(states[model.constrained], wanted[model.constrained], atol=1e-12)


def test_initial_states_that_fit_nothing_are_refused():
    model = rod()
    warm = Load.at_start("warm", twice, np.ones(2 * N))
    with pytest.raises(ShapeError, match="start: got 'steady' and the initial state of warm, expected one of them"):
        MarchedModel(replace(model, loads=(*model.loads, warm)), GRID, start="steady")
    with pytest.raises(ShapeError, match="load warm: got an initial state of shape"):
        replace(model, loads=(replace(warm, initial=np.ones(3)),))
    with pytest.raises(ShapeError, match="make two loads with the same amplitude"):
        replace(model, loads=(replace(warm, force=np.ones(2 * N)),))


def twice(_):
    return 2.0


def test_pulses_and_bursts():
    times = np.array([0.0, 0.1, 0.25, 0.3 - 0.2, 0.3, 0.7])
    np.testing.assert_array_equal(Pulse(0.25)(times), [1, 1, 1, 1, 0, 0])
    assert Pulse(0.3)(np.array([0.1 * 3]))[0] == 1.0  # a rounding error behind the end
    burst = ToneBurst(50.0, 4.0)
    fine = np.linspace(0.0, 0.1, 20_001)
    values = burst(fine)
    assert not values[fine > 0.08].any()
    assert np.abs(values).max() == pytest.approx(0.96, abs=0.01)  # at 4 cycles no crest is at the top of the bell
    ends = np.abs(np.diff(values, 2)) / (fine[1] ** 2)
    assert ends[[0, 16_000]].max() < 1e-2 * ends.max()  # begins and ends without a jolt


@pytest.mark.parametrize(
    ("settings", "profile"),
    [
        ({}, Constant()),
        ({"kind": "ramp", "duration": 2.0}, Ramp(2.0)),
        ({"kind": "smooth_ramp", "duration": 2.0}, SmoothRamp(2.0)),
        ({"kind": "pulse", "duration": 2.0}, Pulse(2.0)),
        ({"kind": "sine", "frequency": 2.0}, Sine(2.0)),
        ({"kind": "tone_burst", "frequency": 2.0}, ToneBurst(2.0)),
        ({"kind": "tone_burst", "frequency": 2.0, "cycles": 5.0}, ToneBurst(2.0, 5.0)),
    ],
)
def test_courses_of_a_scene(settings, profile):
    assert Course(**settings).profile() == profile


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "bang"}, "course: got 'bang', expected one of constant, ramp"),
        ({"kind": "ramp"}, "course ramp: duration is missing"),
        ({"kind": "sine", "frequency": 1.0, "duration": 1.0}, "course sine: got duration, which it has no use for"),
        ({"kind": "sine", "frequency": 0.0}, "frequency: got 0.0, expected a positive number of Hz"),
        ({"kind": "tone_burst", "frequency": 1.0, "cycles": -1.0}, "cycles: got -1.0, expected a positive number"),
        ({"kind": "pulse", "duration": np.inf}, "duration: got inf"),
    ],
)
def test_courses_that_say_nothing_are_refused(settings, message):
    with pytest.raises(ShapeError, match=message):
        Course(**settings)
