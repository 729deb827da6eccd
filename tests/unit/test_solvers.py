"""Linear solvers: what they promise, how they fail, what they keep."""

import pickle
import re

import numpy as np
import pytest
from scipy.sparse import block_array, csr_array, diags_array, eye_array, kron

from dacore.algebra import auto, blockwise, solvers
from dacore.algebra.elimination import Ordering
from dacore.algebra.factorisation import Factorisation
from dacore.algebra.linear_solver import CorrectingSolver, product
from dacore.algebra.triangular import GaussSeidel
from dacore.errors import ConvergenceError, ShapeError
from tests.solvers import make_solver

METHODS = ("direct", "krylov", "auto")


def line(count):
    return diags_array([-np.ones(count - 1), 2.0 * np.ones(count), -np.ones(count - 1)], offsets=(-1, 0, 1))


def laplacian(count):
    """The seven-point Laplacian on a cube of count³ nodes."""
    one, unit = line(count), eye_array(count)
    return csr_array(kron(kron(one, unit), unit) + kron(kron(unit, one), unit) + kron(kron(unit, unit), one))


def flow(count=7, storage=1e-3, shuffle=None):
    """A step of the shape of a poroelastic one: two displacement components, one pressure, units far apart."""
    stiff = laplacian(count) + 3.0 * eye_array(count**3)
    slope = diags_array([np.ones(count - 1), -np.ones(count - 1)], offsets=(1, -1))
    unit = eye_array(count)
    across, along = kron(kron(slope, unit), unit), kron(kron(unit, slope), unit)
    resist = storage * (laplacian(count) + eye_array(count**3))
    matrix = csr_array(
        block_array([[stiff, None, across.T], [None, stiff, along.T], [across, along, -resist]], format="csr")
    )
    units = np.repeat([1e3, 1e3, 1e-5], count**3)
    matrix = csr_array(diags_array(units) @ matrix @ diags_array(units))
    definite = np.repeat([True, True, False], count**3)
    if shuffle is not None:
        order = shuffle.permutation(len(definite))
        matrix, definite = csr_array(matrix[order][:, order]), definite[order]
    return matrix, definite, 1.0 / np.sqrt(np.abs(matrix.diagonal()))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(), (1,), (3,)])
def test_solutions_agree_with_a_dense_solve_in_any_order_of_rows(method, shape):
    rng = np.random.default_rng(1)
    matrix, definite, scale = flow(5, shuffle=rng)
    wanted = scale.reshape(-1, *[1] * len(shape)) * rng.normal(size=(len(scale), *shape))
    solution = make_solver(matrix, definite, method, 1e-11).solve(matrix @ wanted)
    assert solution.shape == wanted.shape
    dense = np.linalg.solve(
        matrix.toarray() * scale * scale[:, None], scale[:, None] * (matrix @ wanted).reshape(-1, max(shape, default=1))
    )
    np.testing.assert_allclose((solution / scale.reshape(-1, *[1] * len(shape))).reshape(dense.shape), dense, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
def test_the_true_residual_meets_the_tolerance(method, tolerance):
    rng = np.random.default_rng(2)
    matrix, definite, scale = flow(6)
    rhs = rng.normal(size=(len(scale), 2)) / scale[:, None] * [1.0, 1e-20]
    solution = make_solver(matrix, definite, method, tolerance).solve(rhs)
    left = np.linalg.norm(scale[:, None] * (rhs - matrix @ solution), axis=0)
    # The solver's own scale has C + B diag(A)⁻¹ Bᵀ in place of C: within a factor of it here.
    assert (left <= 60.0 * tolerance * np.linalg.norm(scale[:, None] * rhs, axis=0)).all()


def test_the_iteration_stops_at_the_tolerance_asked_for():
    matrix, definite, scale = flow(6)
    rhs = np.random.default_rng(3).normal(size=len(scale)) / scale
    counts = []
    for tolerance in (1e-3, 1e-6, 1e-10):
        solver = make_solver(matrix, definite, "krylov", tolerance)
        solver.solve(rhs)
        counts.append(solver.iterations)
    assert counts[0] < counts[1] < counts[2] < 100


@pytest.mark.parametrize("method", METHODS)
def test_positive_definite_systems(method):
    matrix = laplacian(9)
    rng = np.random.default_rng(4)
    wanted = rng.normal(size=(matrix.shape[0], 2))
    solution = make_solver(matrix, np.ones(matrix.shape[0], dtype=bool), method, 1e-12).solve(matrix @ wanted)
    np.testing.assert_allclose(solution, wanted, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_guess_and_earlier_solutions_change_the_work_only(method):
    rng = np.random.default_rng(5)
    matrix, definite, scale = flow(5)
    wanted = scale * rng.normal(size=len(scale))
    rhs = matrix @ wanted
    fresh = make_solver(matrix, definite, method, 1e-12).solve(rhs)
    used = make_solver(matrix, definite, method, 1e-12)
    for _ in range(25):
        used.solve(rng.normal(size=len(scale)) / scale)
    np.testing.assert_allclose(used.solve(rhs) / scale, fresh / scale, atol=1e-8)
    np.testing.assert_allclose(used.solve(rhs, guess=1e3 * wanted[::-1]) / scale, fresh / scale, atol=1e-8)
    guess, before = 1.01 * wanted, rhs.copy()
    kept = guess.copy()
    used.solve(rhs, guess)
    np.testing.assert_array_equal(guess, kept)
    np.testing.assert_array_equal(rhs, before)


def test_a_repeated_system_costs_hardly_an_iteration():
    matrix, definite, scale = flow(5)
    rhs = np.random.default_rng(6).normal(size=(len(scale), 2)) / scale[:, None]
    solver = make_solver(matrix, definite, "krylov", 1e-8)
    solver.solve(rhs)
    made = solver.iterations
    solver.solve(rhs @ np.array([[2.0], [-3.0]]))
    assert solver.iterations < 1.1 * made


@pytest.mark.parametrize("method", METHODS)
def test_zero_right_sides_have_zero_solutions(method):
    matrix, definite, scale = flow(4)
    rhs = np.zeros((len(scale), 2))
    rhs[:, 1] = 1.0 / scale
    solution = make_solver(matrix, definite, method).solve(rhs, guess=np.ones_like(rhs))
    assert not solution[:, 0].any()
    assert solution[:, 1].any()


@pytest.mark.parametrize("method", METHODS)
def test_negative_definite_systems(method):
    matrix = -laplacian(6)
    wanted = np.random.default_rng(12).normal(size=matrix.shape[0])
    solution = make_solver(csr_array(matrix), np.zeros(matrix.shape[0], dtype=bool), method, 1e-12).solve(
        matrix @ wanted
    )
    np.testing.assert_allclose(solution, wanted, atol=1e-9)


def test_a_guess_too_large_for_arithmetic_is_no_solution():
    solver = make_solver(csr_array(np.array([[2.0, 1.0], [1.0, -2.0]])), np.array([True, False]), "direct")
    with np.errstate(all="ignore"), pytest.raises(ConvergenceError, match=r"nan|inf"):
        solver.solve(np.ones(2), guess=np.full(2, 1.1e308))


@pytest.mark.parametrize("storage", [1e-6, 1e-10, 1e-13])
def test_a_vanishing_storage_is_borne(storage):
    matrix, definite, scale = flow(6, storage)
    scale = np.where(definite, 1e-3, 1e5)
    wanted = scale * np.random.default_rng(7).normal(size=len(scale))
    rhs = matrix @ wanted
    solution = make_solver(matrix, definite, "direct", 1e-9).solve(rhs)
    assert np.linalg.norm(scale * (rhs - matrix @ solution)) <= 1e-8 * np.linalg.norm(scale * rhs)


@pytest.mark.parametrize("method", METHODS)
def test_singular_matrices_are_refused_with_advice(method):
    count = 40
    matrix = csr_array(line(count))
    data = matrix.toarray()
    data[0, 0] = data[-1, -1] = 1.0  # constants are in the kernel
    rhs = np.ones(count)
    with pytest.raises(ConvergenceError, match=r"expected a nonsingular|wanted 1\.0e-10") as caught:
        make_solver(csr_array(data), np.ones(count, dtype=bool), method).solve(rhs)
    assert "\n" not in str(caught.value)


def test_indefinite_matrices_are_refused():
    matrix = csr_array(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(ConvergenceError, match="not positive definite"):
        make_solver(matrix, np.ones(2, dtype=bool), "direct")


def test_unsymmetric_matrices_are_found_out():
    matrix = csr_array(np.array([[2.0, 1.5], [-1.5, 2.0]]))
    with pytest.raises(ConvergenceError, match="symmetric"):
        make_solver(matrix, np.ones(2, dtype=bool), "direct").solve(np.ones(2))


def test_the_iteration_says_what_it_reached():
    matrix = csr_array(line(30_000))
    with pytest.raises(ConvergenceError, match=r"conjugate gradients .* wanted 1\.0e-10, .*direct"):
        make_solver(matrix, np.ones(30_000, dtype=bool), "krylov").solve(np.ones(30_000))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"definite": np.ones(5, dtype=bool)}, "flags"),
        ({"matrix": csr_array(np.ones((3, 4)))}, "flags"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"definite": np.array([True, True, True, True])}, "2 of 4 rows"),
        ({"matrix": csr_array(np.diag([1.0, 1.0, 0.0, -1.0]))}, "1 of 4 rows"),
        ({"matrix": csr_array(np.diag([1.0, np.nan, -1.0, -1.0]))}, "1 of 4 rows"),
    ],
)
def test_wrong_input_is_refused(change, message):
    given = {
        "matrix": csr_array(np.diag([1.0, 1.0, -1.0, -1.0])),
        "definite": np.array([True, True, False, False]),
        "method": "auto",
        "tolerance": 1e-10,
    }
    with pytest.raises(ShapeError, match=message):
        make_solver(**(given | change))


@pytest.mark.parametrize("rhs", [np.ones(3), np.ones((3, 2)), np.array([1.0, np.nan]), np.ones((2, 1, 1))])
def test_wrong_right_sides_are_refused(rhs):
    solver = make_solver(csr_array(np.diag([1.0, -1.0])), np.array([True, False]))
    with pytest.raises(ShapeError, match="right-hand side"):
        solver.solve(rhs)


@pytest.mark.parametrize("method", METHODS)
def test_no_columns_are_no_work_and_a_broken_guess_is_refused(method):
    matrix, definite, scale = flow(3)
    solver = make_solver(matrix, definite, method)
    assert solver.solve(np.empty((len(scale), 0))).shape == (len(scale), 0)
    with pytest.raises(ShapeError, match="guess"):
        solver.solve(scale, guess=np.full(len(scale), np.nan))


def test_an_ordering_survives_pickling_and_serves_other_values():
    rng = np.random.default_rng(8)
    matrix, definite, scale = flow(6)
    nodes = np.tile(np.arange(216), 3)
    ordering = pickle.loads(pickle.dumps(Ordering.of(matrix, definite, nodes)))
    np.testing.assert_array_equal(np.sort(ordering.permutation), np.arange(len(scale)))
    for storage in (1e-3, 1.0):
        other, _, scale = flow(6, storage)
        wanted = scale * rng.normal(size=len(scale))
        solver = make_solver(other, definite, "direct", 1e-12, ordering)
        np.testing.assert_allclose(solver.solve(other @ wanted) / scale, wanted / scale, atol=1e-7)


def test_an_ordering_serves_a_matrix_in_which_entries_cancelled_and_no_stranger(monkeypatch):
    matrix, definite, scale = flow(5)
    ordering = Ordering.of(matrix, definite)
    thinner = matrix.tolil()
    thinner[np.ix_([0, 1], [250, 251])] = 0.0
    thinner[np.ix_([250, 251], [0, 1])] = 0.0
    thinner = csr_array(thinner)
    made = []
    original = Ordering.of
    monkeypatch.setattr(Ordering, "of", staticmethod(lambda *given: made.append(1) or original(*given)))
    stranger, split, far = flow(5, shuffle=np.random.default_rng(9))
    for other, flags, units, orderings in (
        (matrix, definite, scale, 0),
        (thinner, definite, scale, 0),
        (stranger, split, far, 1),
    ):
        solution = make_solver(other, flags, "direct", 1e-10, ordering).solve(1.0 / units)
        assert np.linalg.norm(units * (other @ solution) - 1.0) < 1e-8
        assert len(made) == orderings


def test_nested_dissection_fills_less_than_the_natural_order():
    matrix = laplacian(24)
    ordering = Ordering.of(matrix, np.ones(24**3, dtype=bool))
    band = 24**3 * 24**2  # the natural order fills the band
    assert ordering.factor_entries < 0.4 * band


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_factorisation_is_as_accurate_as_its_precision(dtype):
    matrix, definite, scale = flow(6)
    scaled = csr_array(diags_array(scale) @ matrix @ diags_array(scale))
    ordering = Ordering.of(scaled, definite)
    wanted = np.random.default_rng(10).normal(size=(len(scale), 2))
    solution = Factorisation(ordering, ordering.scatter, scaled.data, dtype).solve(scaled @ wanted)
    error = np.linalg.norm(scaled @ (solution - wanted)) / np.linalg.norm(scaled @ wanted)
    assert error < 100 * np.finfo(dtype).eps


def test_single_precision_gives_way_to_double_where_it_must():
    rng = np.random.default_rng(11)
    basis, _ = np.linalg.qr(rng.normal(size=(60, 60)))
    matrix = csr_array(basis @ np.diag(np.logspace(0, -9, 60)) @ basis.T)
    matrix = csr_array(0.5 * (matrix + matrix.T))
    wanted = rng.normal(size=60)
    solver = make_solver(matrix, np.ones(60, dtype=bool), "direct", 1e-11)
    rhs = matrix @ wanted
    assert np.linalg.norm(matrix @ solver.solve(rhs) - rhs) < 1e-9 * np.linalg.norm(rhs)
    assert re.search("double", solver.name)


def test_disconnected_and_dense_systems():
    for matrix in (csr_array(np.diag(np.arange(1.0, 2001.0))), csr_array(np.eye(300) + np.ones((300, 300)))):
        n = matrix.shape[0]
        solution = make_solver(matrix, np.ones(n, dtype=bool), "direct").solve(matrix @ np.ones(n))
        np.testing.assert_allclose(solution, 1.0, atol=1e-8)


def test_products_agree_for_few_and_for_many_columns():
    matrix, _, _ = flow(4)
    for columns in (0, 1, 3, 9):
        vectors = np.random.default_rng(columns).normal(size=(matrix.shape[1], columns))
        np.testing.assert_allclose(product(matrix, vectors), matrix.toarray() @ vectors, rtol=1e-12, atol=1e-9)


def test_a_gauss_seidel_sweep_is_what_its_formula_says():
    matrix = csr_array(laplacian(4) + diags_array(np.linspace(0.0, 3.0, 64)))
    dense, load = matrix.toarray(), np.random.default_rng(1).normal(size=64)
    lower, diagonal = np.tril(dense), np.diag(dense)
    wanted = np.linalg.solve(lower.T, diagonal * np.linalg.solve(lower, load))
    sweep = GaussSeidel(matrix)
    solution, image = sweep.with_image(load.astype(np.float32))
    np.testing.assert_allclose(solution, wanted, atol=1e-6)
    np.testing.assert_allclose(image, dense @ wanted, atol=1e-5)
    np.testing.assert_array_equal(sweep(load.astype(np.float32)), solution)
    wider = GaussSeidel(csr_array(block_array([[matrix, matrix + eye_array(64)]])))
    np.testing.assert_array_equal(wider(load.astype(np.float32)), solution)


def test_the_memory_grows_with_the_columns_and_forgets_the_oldest():
    matrix, definite, scale = flow(4)
    rng = np.random.default_rng(2)
    solver = make_solver(matrix, definite, "krylov", 1e-6)
    used, first = [], rng.normal(size=(len(scale), 2)) / scale[:, None]
    solver.solve(first)
    for _ in range(60):
        before, rhs = solver.iterations, rng.normal(size=(len(scale), 2)) / scale[:, None]
        solution = solver.solve(rhs)
        used.append(solver.iterations - before)
        assert (np.linalg.norm(scale[:, None] * (rhs - matrix @ solution), axis=0) < 1e-4).all()
    # 2 · 40 of the 122 solutions are kept: the last ones are known, up to what was replaced since, the first are not.
    costs = []
    for again in (rhs, first):
        before = solver.iterations
        solver.solve(again)
        costs.append(solver.iterations - before)
    assert costs[0] < 0.5 * np.mean(used) < 0.7 * costs[1]


def test_auto_turns_to_a_factor_where_the_iteration_is_slow(monkeypatch):
    count = 400
    # A thin shell of nearly singular stiffness: conjugate gradients take far more iterations than patience allows.
    matrix = csr_array(line(count) + 1e-7 * eye_array(count))
    wanted = np.random.default_rng(3).normal(size=count)
    monkeypatch.setattr(solvers, "_DIRECT_UNKNOWNS", 100)
    solver = make_solver(matrix, np.ones(count, dtype=bool), "auto", 1e-10)
    assert "conjugate" in solver.name
    monkeypatch.setattr(auto, "PATIENCE", 20)
    monkeypatch.setattr(blockwise, "_CONJUGATE", 30)
    solution = solver.solve(matrix @ wanted)
    assert "direct solver" in solver.name
    assert np.linalg.norm(matrix @ (solution - wanted)) <= 1e-9 * np.linalg.norm(matrix @ wanted)
    iterations = solver.iterations
    solver.solve(np.ones(count))
    assert solver.iterations == iterations


def test_auto_keeps_to_the_iteration_where_a_factor_would_be_too_large(monkeypatch):
    count = 400
    matrix = csr_array(line(count) + 1e-7 * eye_array(count))
    monkeypatch.setattr(solvers, "_DIRECT_UNKNOWNS", 100)
    monkeypatch.setattr(auto, "PATIENCE", 20)
    monkeypatch.setattr(auto, "LARGEST_FACTOR", 100)
    monkeypatch.setattr(blockwise, "_CONJUGATE", 30)
    solver = make_solver(matrix, np.ones(count, dtype=bool), "auto", 1e-10)
    with pytest.raises(ConvergenceError, match="conjugate gradients"):
        solver.solve(np.ones(count))


def test_auto_turns_to_a_factor_in_a_flow_too(monkeypatch):
    matrix, definite, scale = flow(5)
    monkeypatch.setattr(solvers, "_DIRECT_UNKNOWNS", 100)
    monkeypatch.setattr(auto, "PATIENCE", 3)
    monkeypatch.setattr(blockwise, "_CYCLE", 8)
    rng = np.random.default_rng(4)
    solver = make_solver(matrix, definite, "auto", 1e-10)
    for shape in [(), (2,), (1,)]:
        wanted = scale.reshape(-1, *[1] * len(shape)) * rng.normal(size=(len(scale), *shape))
        solution = solver.solve(matrix @ wanted)
        left = (scale * (matrix @ (solution - wanted)).T).T
        assert np.linalg.norm(left) <= 1e-8 * np.linalg.norm((scale * (matrix @ wanted).T).T)
    assert "direct solver" in solver.name


def test_solvers_are_linear_solvers_and_name_themselves():
    matrix, definite, _ = flow(3)
    for method in METHODS:
        solver = make_solver(matrix, definite, method)
        assert isinstance(solver, CorrectingSolver)
        assert solver.name


def test_nearly_repeated_right_hand_sides_do_not_spoil_the_memory():
    """A memory of nearly dependent solutions once led the solver away from the true residual."""
    rng = np.random.default_rng(0)
    n = 60
    factor = rng.standard_normal((n, n))
    matrix = csr_array(factor @ factor.T / n + 3 * np.eye(n))
    solver = make_solver(matrix, np.ones(n, dtype=bool), "direct", tolerance=1e-12)
    base = rng.standard_normal(n)
    for k in range(40):
        rhs = base + 10.0 ** -(k % 13) * rng.standard_normal(n)
        found = solver.solve(rhs)
        assert np.linalg.norm(matrix @ found - rhs) <= 1e-11 * np.linalg.norm(rhs)
