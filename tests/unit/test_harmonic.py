"""Motions at one frequency of any affine model: against dense algebra, at resonances, and what is refused."""

import pickle
from dataclasses import replace
from operator import itemgetter

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csr_array

from dacore.algebra.flexible import flexible_gmres
from dacore.algebra.solvers import Direct, Krylov
from dacore.core.model import Load, combine
from dacore.dynamics.harmonic import HarmonicModel, amplitude, phases
from dacore.dynamics.harmonic_system import HarmonicSystem, harmonic_factor
from dacore.dynamics.profiles import Constant, Cosine, Ramp, Sine
from dacore.errors import AccuracyError, ConvergenceError, ShapeError
from tests.rods import matrices, rod

F = 2.0
ETA = {"modulus": itemgetter("eta")}


def driven(n=40, frequency=F, profile=None, **changes):
    """The poroelastic rod under oscillations only: a pull in sin ωt, pressures in cos ωt and sin ωt."""
    pull, inflow, outflow = rod(n, ranges={"eta": (0.0, 0.4)}).loads
    loads = (
        replace(pull, profile=profile or Sine(frequency)),
        replace(inflow, profile=Cosine(frequency)),
        replace(outflow, profile=Sine(frequency)),
    )
    return rod(n, ranges={"eta": (0.0, 0.4)}, **{"loads": loads, **changes})


def dense(model, theta, frequency, eta=0.0):
    """Complex amplitudes (n_dofs, n_loads) by dense algebra on the equations as they stand."""
    n, omega = model.space.n_dofs, 2 * np.pi * frequency
    mass, rate = (combine(terms, theta, n).toarray() for terms in (model.second_order, model.first_order))
    rest = combine([t for t in model.zeroth_order if t.name != "modulus"], theta, n).toarray()
    elastic = combine([t for t in model.zeroth_order if t.name == "modulus"], theta, n).toarray()
    whole = -(omega**2) * mass + 1j * omega * rate + rest + (1 + 1j * eta) * elastic
    free = ~model.constrained
    out = np.stack([load.prescribed for load in model.loads], axis=1).astype(complex)
    force = np.stack([load.force for load in model.loads], axis=1)
    out[free] = np.linalg.solve(whole[np.ix_(free, free)], force[free] - whole[np.ix_(free, ~free)] @ out[~free])
    return out


def near(found, wanted, tolerance=1e-8):
    return np.abs(found - wanted).max() < tolerance * np.abs(wanted).max()


@pytest.mark.parametrize("method", [Direct(), Krylov()])
@pytest.mark.parametrize("eta", [0.0, 1e-6, 0.01, 0.4])
def test_amplitudes_are_those_of_dense_algebra(eta, method):
    model = driven()
    theta = model.parameters.middle | {"eta": eta}
    found = HarmonicModel(model, F, ETA, method, tolerance=1e-11).solve(theta)
    factors = np.array([-1j, 1.0, -1j])
    wanted = dense(model, theta, F, eta) @ (factors * model.amplitudes(theta))
    assert np.array_equal(found.times, [0.0, 0.25 / F])
    for rows in (slice(0, 40), slice(40, 80)):
        assert near(amplitude(found.states)[rows], wanted[rows])


def test_a_frame_without_a_flow_and_one_without_mass():
    """The rod's elastic half alone (elastodynamics), and its pressure alone (diffusion)."""
    model, n = driven(), 40
    theta = model.parameters.middle | {"eta": 0.1}
    for held, gone in ((slice(n, 2 * n), ("alpha", "mobility", "storage")), (slice(0, n), ("alpha", "rho", "modulus"))):
        constrained = model.constrained.copy()
        constrained[held] = True
        part = {
            group: tuple(term for term in getattr(model, group) if term.name not in gone)
            for group in ("second_order", "first_order", "zeroth_order")
        }
        loads = tuple(
            replace(load, force=np.where(constrained, 0, load.force)) for load in model.loads
            if not load.prescribed[held].any()
        )  # fmt: skip
        alone = replace(model, constrained=constrained, loads=loads, **part)
        if "alpha" in gone and held.start == 0:
            alone = replace(alone, antisymmetric=np.zeros(2 * n, dtype=bool))
        losses = ETA if held.start else None
        found = HarmonicModel(alone, F, losses).amplitudes(theta, np.eye(len(loads)))
        assert near(found, dense(alone, theta, F, 0.1 if held.start else 0.0))


def test_loads_alone_add_up_and_their_amplitudes_have_no_influence():
    model = HarmonicModel(driven(), F, ETA)
    theta = model.parameters.middle
    alone = model.responses(theta | {"pull": 77.0})
    assert alone.states.shape == (3, 80, 2)
    assert alone.loads == ("pull", "inflow", "outflow")
    whole = model.solve(theta)
    assert near(alone.superpose(model.model.amplitudes(theta)).states, whole.states)
    assert near(model.responses(theta, ["outflow"]).states[0], alone.states[2])
    with pytest.raises(ShapeError, match="got push, expected any of pull"):
        model.responses(theta, ["push"])


def test_profiles_are_known_by_their_factor():
    none = np.zeros(3)

    def of(profile, initial=None):
        return harmonic_factor(Load("x", itemgetter("a"), profile, none, none, initial), 5.0)

    assert of(Cosine(5.0)) == pytest.approx(1.0)
    assert of(Sine(5.0)) == pytest.approx(-1j)
    for profile in (Constant(), Sine(5.1), Sine(10.0), Ramp(0.1)):
        with pytest.raises(ShapeError, match="load x: got a profile that is no oscillation of the frequency, expected"):
            of(profile)
    with pytest.raises(ShapeError, match="load x: is a state to start from"):
        of(Cosine(5.0), np.ones(3))


def test_phases_and_amplitudes_are_each_others_inverse():
    y = np.random.default_rng(0).standard_normal((3, 5, 2)) @ [1, 1j]
    assert np.array_equal(amplitude(phases(y)), y)
    t = 0.3
    assert np.allclose(phases(y) @ [np.cos(t), np.sin(t)], (y * np.exp(1j * t)).real)
    with pytest.raises(ShapeError, match=r"got shape \(4, 3\), expected two phases"):
        amplitude(np.zeros((4, 3)))


def dry(n=30):
    """An elastic rod without a fluid: pressures are held, so nothing takes energy. Its resonances [Hz]."""
    model = driven(n)
    constrained = model.constrained.copy()
    constrained[n:] = True
    model = replace(model, constrained=constrained, loads=(replace(model.loads[0], profile=Cosine(F)),))
    mass, stiffness, _ = (each.toarray()[1:, 1:] for each in matrices(n))
    theta = model.parameters.middle
    values, shapes = eigh(theta["modulus"] * stiffness, theta["rho"] * mass)
    return model, np.sqrt(values) / (2 * np.pi), shapes


def at(model, frequency):
    return replace(model, loads=(replace(model.loads[0], profile=Cosine(frequency)),))


def test_undamped_resonances_are_peaks_that_a_loss_bounds():
    model, resonances, shapes = dry()
    theta = model.parameters.middle
    first = resonances[0]

    def response(frequency, eta):
        found = HarmonicModel(at(model, frequency), frequency, ETA).solve(theta | {"eta": eta})
        return float(np.abs(amplitude(found.states)[29]))

    # Within a share ε of a resonance an undamped amplitude is the mode's static one over 2ε.
    still = abs(theta["pull"]) * shapes[-1, 0] ** 2 / (2 * np.pi * first) ** 2
    for share in (1e-2, 1e-4):
        assert response(first * (1 - share), 0.0) == pytest.approx(still / (2 * share), rel=0.1)
    for eta in (0.02, 0.1, 0.4):
        assert response(first, eta) == pytest.approx(still / eta, rel=0.05 + 0.2 * eta)
    scan = np.linspace(0.5 * first, 1.1 * resonances[1], 60)
    sizes = np.array([response(f, 0.02) for f in scan])
    peaks = scan[1:-1][(sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] > sizes[2:])]
    assert len(peaks) == 2
    assert np.allclose(peaks, resonances[:2], atol=scan[1] - scan[0])


def test_on_an_undamped_resonance_there_is_no_answer():
    model, resonances, _ = dry()
    frequency = float(resonances[1])
    exact = HarmonicModel(at(model, frequency), frequency, tolerance=1e-12)
    with pytest.raises(
        ConvergenceError, match=r"harmonic response at [\d.]+ Hz: .*resonance .* give the material a loss"
    ):
        exact.solve(model.parameters.middle)


def test_the_residual_is_reached_all_over_the_ranges_and_beyond():
    model = driven()
    system = HarmonicSystem(model, F, ETA)
    for change in ({}, {"modulus": 1e-3}, {"modulus": 1e6}, {"mobility": 1e-12}, {"storage": 1e-12}, {"eta": 0.0}):
        theta = model.parameters.middle | {"eta": 1e-3} | change
        one = system.at(theta)
        right = one.right_side(np.diag(system.factors))
        residual = (right - one.matrix @ one.solve(right, Direct(), 1e-10)) / one.size[:, None]
        assert (np.linalg.norm(residual, axis=0) <= 1e-10 * np.linalg.norm(right / one.size[:, None], axis=0)).all()


def test_a_pickle_solves_alike_and_knows_the_analysis():
    model = HarmonicModel(driven(), F, ETA)
    theta = model.parameters.middle
    copy = pickle.loads(pickle.dumps(model))
    assert np.array_equal(copy.solve(theta).states, model.solve(theta).states)
    assert copy._given is not None
    assert model.times.shape == (2,)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"frequency": 0.0}, "frequency: got 0.0, expected a positive number of Hz"),
        ({"frequency": float("nan")}, "frequency: got nan"),
        ({"tolerance": 0.0}, "tolerance: got 0.0"),
        ({"method": "direct"}, "method: got 'direct', expected a SolverMethod"),
        ({"losses": {"stiffness": abs}}, "losses: got stiffness, expected terms of zeroth order: modulus, alpha"),
        ({"losses": {"rho": abs}}, "losses: got rho"),
    ],
)
def test_settings_are_checked_when_made(settings, message):
    with pytest.raises(ShapeError, match=message):
        HarmonicModel(**{"model": driven(), "frequency": F, **settings})


def test_what_does_not_fit_is_refused():
    model = driven()
    made = HarmonicModel(model, F, ETA)
    with pytest.raises(ShapeError, match=r"loss of modulus: got -0\.1, expected a number, zero or more"):
        made.solve(made.parameters.middle | {"eta": -0.1})
    with pytest.raises(ShapeError, match="parameters: rho, modulus"):
        made.solve({})
    with pytest.raises(ShapeError, match="weights"):
        made.amplitudes(made.parameters.middle, np.ones(3))
    with pytest.raises(ShapeError, match="every dof is constrained"):
        HarmonicModel(replace(model, constrained=np.ones(80, dtype=bool)), F)
    with pytest.raises(ShapeError, match="term rho: antisymmetric rows have mass"):
        HarmonicModel(replace(model, antisymmetric=np.ones(80, dtype=bool)), F)
    free = model.constrained.copy()
    free[79] = False  # neither field is held at the right end: the boundary term is missing
    loads = model.loads[:2]
    with pytest.raises(AccuracyError, match="harmonic system: unsymmetric by"):
        HarmonicModel(replace(model, constrained=free, loads=loads), F)


def test_it_shows_itself():
    text = repr(HarmonicModel(driven(), F, ETA))
    assert "HarmonicModel" in text
    assert "2 Hz" in text
    assert "modulus" in text


def test_cautions_are_asked_for_the_rate_of_the_frequency():
    seen = []

    def caution(parameters, lag):
        seen.append(lag)
        return "beware" if len(seen) == 1 else ""

    model = HarmonicModel(replace(driven(), cautions=(caution, caution)), F)
    assert model.cautions(model.parameters) == ("beware",)
    assert seen == [pytest.approx(1 / (2 * np.pi * F))] * 2


class TestFlexibleGMRES:
    rng = np.random.default_rng(1)
    matrix = np.diag(np.linspace(1, 3, 30)) * (1 + 0.3j) + 0.05 * rng.standard_normal((30, 30))
    right = rng.standard_normal((30, 2)) @ [1, 1j]

    def solve(self, precondition=lambda r: r, tolerance=1e-12, iterations=60, matrix=None):
        matrix = self.matrix if matrix is None else matrix
        return flexible_gmres(lambda x: matrix @ x, precondition, self.right, tolerance, iterations)

    def test_solves_and_says_the_true_residual(self):
        x, left, used = self.solve()
        assert np.linalg.norm(self.right - self.matrix @ x) / np.linalg.norm(self.right) == pytest.approx(
            left, abs=1e-15
        )
        assert left <= 1e-12
        assert used <= 45

    def test_a_preconditioner_that_varies(self):
        inverse, calls = np.linalg.inv(self.matrix), []

        def about(r):
            calls.append(0)
            return inverse @ r * (1 + 0.1 * np.sin(len(calls) + np.arange(30)))

        x, left, used = self.solve(about)
        assert left <= 1e-12
        assert used < 20
        assert np.allclose(self.matrix @ x, self.right)

    def test_stops_when_told_and_where_nothing_is_gained(self):
        _, left, used = self.solve(iterations=5)
        assert used == 5
        assert left > 1e-6
        singular = np.diag([0.0, *range(1, 30)]).astype(complex)
        x, left, _ = self.solve(matrix=singular)
        assert left == pytest.approx(abs(self.right[0]) / np.linalg.norm(self.right), rel=1e-6)
        assert np.isfinite(x).all()

    def test_zero_right_side_and_infinite_preconditioners(self):
        x, left, used = flexible_gmres(lambda x: x, lambda r: r, np.zeros(4, dtype=complex), 1e-10, 5)
        assert not x.any()
        assert (left, used) == (0.0, 0)
        with pytest.raises(ConvergenceError, match="infinite"):
            self.solve(lambda r: np.full_like(r, np.inf))


def test_matrices_of_the_system_are_the_right_ones():
    """K = B + iD is complex symmetric, and the doubled system [[D, B], [B, −D]] where the motion is damped."""
    model = driven()
    system = HarmonicSystem(model, F, ETA)
    one = system.at(model.parameters.middle | {"eta": 0.3})
    n = len(system.free)
    whole = one.doubled.toarray()
    k = one.matrix.toarray()
    assert np.abs(k - k.T).max() < 1e-12 * np.abs(k).max()
    assert np.array_equal(whole[:n, n:], k.real)
    assert np.array_equal(whole[:n, :n], -whole[n:, n:])
    assert np.array_equal(whole[:n, :n], k.imag)
    assert np.linalg.eigvalsh(k.imag)[0] > 0
    bare = system.at(model.parameters.middle | {"eta": 0.0})
    assert np.linalg.eigvalsh(bare.matrix.toarray().imag)[0] > -1e-12
    assert np.linalg.eigvalsh(bare.doubled.toarray()[:n, :n])[0] > 0
    assert isinstance(bare.doubled, csr_array)
