"""Contracts of a linear solver: it solves what it is given, to the tolerance, or says that it cannot."""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ConvergenceError, ShapeError
from dacore.testing import settings
from dacore.testing.meshes import shuffled_box
from dacore.testing.reference import Reference
from dacore.testing.suite import ContractError, Suite, bind, expect_kind, fail, require

TOLERANCES = (1e-4, 1e-8, 1e-10)


@dataclass(frozen=True, eq=False)
class System:
    """A linear system as `SolverMethod` takes it.

    Parameters
    ----------
    matrix : (n, n) csr_array
    definite : (n,) bool array
    nodes : (n,) int array
    """

    matrix: Sparse
    definite: BoolArray
    nodes: IntArray

    @cached_property
    def scale(self) -> Array:
        """D (n,), one over the roots of the diagonal."""
        return np.asarray(1.0 / np.sqrt(np.abs(self.matrix.diagonal())))

    def residual(self, x: Array, rhs: Array) -> Array:
        """‖D(b − K x)‖ / ‖D b‖ of every column (k,); of a column of zeros, ‖D K x‖."""
        columns = rhs.reshape(len(rhs), -1)
        left = columns - self.matrix @ x.reshape(len(rhs), -1)
        size = np.linalg.norm(self.scale[:, None] * columns, axis=0)
        return np.asarray(np.linalg.norm(self.scale[:, None] * left, axis=0) / np.where(size > 0, size, 1.0))


def poroelastic_step(seed: int = 0, n: int = 3, inertia: float = 400.0, units: float = 1e3) -> System:
    """A time step of displacement and pressure on a cube: symmetric quasi-definite, rows in any order.

    Parameters
    ----------
    seed : int
    n : int
        Cells an axis.
    inertia : float
        Of the mass beside the stiffness.
    units : float
        Factor between the rows of the two fields, as units make it.
    """
    mesh = shuffled_box(3, n, seed, bumpy=True)
    forms = Reference(mesh)
    mass, stiffness = forms.mass(1).matrix, forms.stiffness(1).matrix
    upper = 2.0 * forms.strain(1).matrix + 5.0 * forms.divergence(1).matrix + inertia * np.kron(np.eye(3), mass)
    lower = units**2 * (0.02 * mass + 0.3 * stiffness)
    coupling = units * forms.divergence_coupling(1, 1).matrix
    matrix = np.block([[upper, coupling.T], [coupling, -lower]])
    definite = np.arange(len(matrix)) < len(upper)
    nodes = np.tile(np.arange(len(mesh.points)), 4)
    # Some nodes are held, as boundary conditions leave it, and the rest is shuffled.
    rng = np.random.default_rng(seed)
    held = mesh.boundary_nodes("left")
    kept = rng.permutation(np.flatnonzero(~np.isin(nodes, held) | ~definite))
    return System(csr_array(matrix[np.ix_(kept, kept)]), definite[kept], nodes[kept])


def elastic_step(seed: int = 0, n: int = 3) -> System:
    """The same without pressure: symmetric positive definite."""
    whole = poroelastic_step(seed, n)
    rows = np.flatnonzero(whole.definite)
    return System(csr_array(whole.matrix[rows][:, rows]), whole.definite[rows], whole.nodes[rows])


@dataclass(eq=False)
class Bench:
    """A method and the systems it is tried on.

    Parameters
    ----------
    method : SolverMethod
    """

    method: SolverMethod
    _solvers: dict[tuple[str, float], LinearSolver] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.method).__name__

    @cached_property
    def systems(self) -> dict[str, System]:
        """Systems by what they are."""
        return {
            "a poroelastic step": poroelastic_step(),
            "an elastic step": elastic_step(1),
            "a step in equal units": poroelastic_step(2, units=1.0),
            "one unknown": System(csr_array(np.array([[4.0]])), np.array([True]), np.array([0])),
        }

    def prepare(self, system: System, tolerance: float = 1e-8) -> LinearSolver:
        """Prepare the method as a time march does, with its analysis."""
        analysis = self.method.analyse(system.matrix, system.definite, system.nodes)
        return self.method.prepare(system.matrix, system.definite, tolerance, analysis)

    def right_sides(self, system: System, count: int = 3, seed: int = 0) -> Array:
        """Right-hand sides (n, count) of very different sizes."""
        rng = np.random.default_rng(seed)
        return rng.standard_normal((len(system.nodes), count)) / system.scale[:, None] * 10.0 ** np.arange(count)


def reaches_the_tolerance(bench: Bench) -> None:
    """Every column, of many or alone, has ‖D(b − K x)‖ ≤ tolerance · ‖D b‖ with the true residual."""
    for what, system in bench.systems.items():
        rhs = bench.right_sides(system)
        for tolerance in TOLERANCES:
            with _on(bench, f"{what} with the tolerance {tolerance:.0e}"):
                solver = bench.prepare(system, tolerance)
                require(isinstance(solver, LinearSolver), f"{bench.name}: prepare returns a {type(solver).__name__}")
                for columns in (rhs, rhs[:, 0], rhs[:, [1]]):
                    _solved(bench, what, system, solver.solve(columns), columns, tolerance)


def many_solves_stay_exact(bench: Bench) -> None:
    """Solve after solve, alike or not, with a guess or without, meets the tolerance; a zero gives zero."""
    rng = np.random.default_rng(3)
    for what, system in bench.systems.items():
        rhs = bench.right_sides(system, 2)
        with _on(bench, what):
            solver = bench.prepare(system)
            for k in range(12):
                rhs = rhs + 0.1 * bench.right_sides(system, 2, seed=k)
                guess = None if k % 3 == 0 else rng.standard_normal(rhs.shape) * np.abs(rhs).max()
                _solved(bench, what, system, solver.solve(rhs, guess), rhs, 1e-8)
            mixed = np.stack([np.zeros(len(rhs)), rhs[:, 0]], axis=1)
            given = solver.solve(mixed, np.ones_like(mixed))
        require(not given[:, 0].any(), f"{bench.name}: on {what}, the solution of a column of zeros is not zero")
        _solved(bench, what, system, given, mixed, 1e-8)


def a_guess_is_only_a_guess(bench: Bench) -> None:
    """From the solution, from far away or from zero, the same system is solved."""
    for what, system in bench.systems.items():
        rhs = bench.right_sides(system, 2)
        exact = np.linalg.solve(system.matrix.toarray(), rhs)
        for where, guess in (("the solution", exact), ("far away", 1e6 * exact[::-1]), ("zero", np.zeros_like(rhs))):
            with _on(bench, f"{what} from a guess, {where},"):
                given = bench.prepare(system, 1e-10).solve(rhs, guess)
            _solved(bench, f"{what} from a guess, {where},", system, given, rhs, 1e-10)


def solvers_do_not_disturb_each_other(bench: Bench) -> None:
    """Solvers prepared for other matrices, before or between, change nothing: each solves its own system."""
    systems = list(bench.systems.items())
    pairs = [(what, system, bench.prepare(system)) for what, system in systems]
    first = systems[0][1]
    doubled = System(csr_array(2.0 * first.matrix), first.definite, first.nodes)
    pairs.append(("the first system doubled", doubled, bench.prepare(doubled)))
    for _ in range(2):
        for what, system, solver in pairs:
            rhs = bench.right_sides(system)
            with _on(bench, f"{what}, with other solvers in use,"):
                given = solver.solve(rhs)
            _solved(bench, f"{what}, with other solvers in use,", system, given, rhs, 1e-8)


def an_analysis_serves_the_pattern(bench: Bench) -> None:
    """An analysis can be pickled and serves other numbers in the same pattern; none at all is enough too."""
    system = bench.systems["a poroelastic step"]
    analysis = bench.method.analyse(system.matrix, system.definite, system.nodes)
    try:
        copy = pickle.loads(pickle.dumps(analysis))
    except Exception as error:  # noqa: BLE001  pickle raises many kinds
        fail(f"{bench.name}: its analysis cannot be pickled: {type(error).__name__}: {error}")
    other = poroelastic_step(0, inertia=4e4)
    require(
        np.array_equal(other.matrix.indices, system.matrix.indices), "dacore.testing: the two systems differ in pattern"
    )
    rhs = bench.right_sides(other)
    for what, given in (("a pickled analysis", copy), ("no analysis", None)):
        with _on(bench, f"another matrix with {what}"):
            solution = bench.method.prepare(other.matrix, other.definite, 1e-8, given).solve(rhs)
        _solved(bench, f"another matrix with {what}", other, solution, rhs, 1e-8)


def nothing_given_is_changed(bench: Bench) -> None:
    """Matrix, flags, right-hand sides and guesses stay as they are, may be read-only and stored by rows or columns."""
    system = bench.systems["a poroelastic step"]
    matrix = system.matrix.copy()
    rhs, guess = bench.right_sides(system), np.ones((len(system.nodes), 3))
    given = {"matrix": matrix.data, "indices of the matrix": matrix.indices, "right-hand side": rhs, "guess": guess}
    given |= {"flags": system.definite, "nodes": system.nodes}
    before = {name: array.copy() for name, array in given.items()}
    for array in given.values():
        array.flags.writeable = False
    held = pickle.dumps(bench.method)
    try:
        analysis = bench.method.analyse(matrix, system.definite, system.nodes)
        solver = bench.method.prepare(matrix, system.definite, 1e-8, analysis)
        for columns in (rhs, np.asfortranarray(rhs), rhs[:, ::2]):
            x = solver.solve(columns, guess[:, : columns.shape[1]])
            require(not np.shares_memory(x, guess), f"{bench.name}: returns the memory of the guess")
            _solved(bench, "arrays stored by rows or columns", system, x, columns, 1e-8)
    except ValueError as error:
        if "read-only" in str(error):
            fail(f"{bench.name}: writes into what it is given: {error}")
        raise
    for name, array in given.items():
        require(np.array_equal(array, before[name]), f"{bench.name}: changes the {name}")
    require(pickle.dumps(bench.method) == held, f"{bench.name}: changes its settings when it is used")


def a_matrix_may_change_later(bench: Bench) -> None:
    """A prepared solver solves the matrix it was prepared for, whatever becomes of the caller's arrays."""
    system = bench.systems["an elastic step"]
    matrix, rhs = system.matrix.copy(), bench.right_sides(system)
    solver = bench.method.prepare(matrix, system.definite, 1e-8, None)
    matrix.data[:] = 0.0
    _solved(bench, "a matrix that the caller has overwritten", system, solver.solve(rhs), rhs, 1e-8)


def answers_are_new(bench: Bench) -> None:
    """Overwriting a solution changes no later solution."""
    system = bench.systems["a poroelastic step"]
    solver, rhs = bench.prepare(system), bench.right_sides(system)
    solver.solve(rhs)[:] = np.nan
    _solved(bench, "a system whose last solution was overwritten", system, solver.solve(rhs), rhs, 1e-8)


def wrong_shapes_are_refused(bench: Bench) -> None:
    """Arrays of a wrong shape or with NaN, and matrices that are not as described, raise ShapeError."""
    system = bench.systems["an elastic step"]
    solver, rhs, n = bench.prepare(system), bench.right_sides(system), len(system.nodes)
    spoiled, flat = rhs.copy(), system.matrix.toarray()
    spoiled[3, 1] = np.nan
    flat[:, 3] = flat[3] = 0.0
    hollow = csr_array(flat)
    prepare = bench.method.prepare
    asked: dict[str, Callable[[], object]] = {
        "a right-hand side of another length": lambda: solver.solve(rhs[1:]),
        "a guess of another shape": lambda: solver.solve(rhs, rhs[:, 0]),
        "NaN in the right-hand side": lambda: solver.solve(spoiled),
        "NaN in the guess": lambda: solver.solve(rhs, spoiled),
        "flags of another length": lambda: prepare(system.matrix, np.ones(n + 1, dtype=bool), 1e-8),
        "a matrix that is not square": lambda: prepare(csr_array(system.matrix[1:]), system.definite, 1e-8),
        "a row and column of zeros": lambda: prepare(hollow, system.definite, 1e-8),
    }
    for what, ask in asked.items():
        try:
            ask()
        except ShapeError:
            continue
        except Exception as error:  # noqa: BLE001  anything else is the finding
            fail(f"{bench.name}: {what} raises {type(error).__name__}: {error}; expected ShapeError")
        else:
            fail(f"{bench.name}: {what} raises nothing, expected ShapeError")


def what_cannot_be_solved_is_said(bench: Bench) -> None:
    """A singular matrix or a tolerance that is out of reach raises; a wrong answer is never returned in silence."""
    system = bench.systems["a poroelastic step"]
    matrix = system.matrix.toarray()
    # Positive diagonal, one direction without stiffness: rigid motion of what is held nowhere.
    mesh = shuffled_box(2, 3, 0)
    free = csr_array(Reference(mesh).stiffness(1).matrix)
    singular = System(free, np.ones(free.shape[0], dtype=bool), np.arange(free.shape[0]))
    # A large negative eigenvalue behind a positive diagonal.
    rows = np.flatnonzero(system.definite)[:2]
    indefinite = matrix.copy()
    indefinite[np.ix_(rows, rows)] += 1e3 * np.abs(np.diag(matrix)[rows]).max() * np.array([[0.0, 1.0], [1.0, 0.0]])
    wrong = System(csr_array(indefinite), system.definite, system.nodes)
    for what, case, tolerance in (
        ("a singular matrix", singular, 1e-8),
        ("a matrix that is not quasi-definite", wrong, 1e-8),
        ("a tolerance of 1e-19", system, 1e-19),
    ):
        rhs = bench.right_sides(case)
        try:
            given = bench.prepare(case, tolerance).solve(rhs)
        except (ConvergenceError, ShapeError):
            continue
        except Exception as error:  # noqa: BLE001  anything else is the finding
            fail(f"{bench.name}: {what} raises {type(error).__name__}: {error}; expected ConvergenceError")
        # Solving it all the same is no fault.
        _solved(bench, what, case, given, rhs, tolerance)


def has_a_name(bench: Bench) -> None:
    """A prepared solver has a name for messages."""
    name = bench.prepare(bench.systems["one unknown"]).name
    require(isinstance(name, str) and bool(name), f"{bench.name}: the name of its solver is {name!r}, expected a text")


CHECKS = (
    reaches_the_tolerance, many_solves_stay_exact, a_guess_is_only_a_guess, solvers_do_not_disturb_each_other,
    an_analysis_serves_the_pattern, nothing_given_is_changed, a_matrix_may_change_later, answers_are_new,
    wrong_shapes_are_refused, what_cannot_be_solved_is_said, has_a_name,
)  # fmt: skip


def solver_suite(method: SolverMethod) -> Suite:
    """Make every check of a linear solver, with one choice of its settings.

    Systems are a poroelastic and an elastic time step on a small cube, with rows in any order.

    Parameters
    ----------
    method : SolverMethod

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no solver.
    """
    expect_kind("solver_suite", method, SolverMethod)
    return Suite((*bind(settings.CHECKS, method), *bind(CHECKS, Bench(method))))


@contextmanager
def _on(bench: Bench, what: str) -> Iterator[None]:
    """Say on which system a solver stops, whatever it raises."""
    __tracebackhide__ = True
    try:
        yield
    except ContractError:
        raise
    except Exception as error:
        raise ContractError(f"{bench.name}: on {what} raises {type(error).__name__}: {error}") from error


def _solved(bench: Bench, what: str, system: System, given: Array, rhs: Array, tolerance: float) -> None:
    __tracebackhide__ = True
    require(isinstance(given, np.ndarray), f"{bench.name}: on {what}, solve returns a {type(given).__name__}, no array")
    require(given.shape == rhs.shape, f"{bench.name}: on {what}, the solution has shape {given.shape}, not {rhs.shape}")
    left = system.residual(given, rhs)
    worst = int(np.argmax(np.where(np.isnan(left), np.inf, left)))
    # A little above the tolerance is rounding of the residual itself.
    require(
        bool(left[worst] <= 1.01 * tolerance + 1e-14),
        f"{bench.name}: on {what}, column {worst} has the relative residual {left[worst]:.1e} in the scaled system, "
        f"wanted {tolerance:.0e}; raise ConvergenceError where it is not reached",
    )
