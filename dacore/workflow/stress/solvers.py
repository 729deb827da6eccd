"""Linear solvers at tolerances too loose, too tight and impossible."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.workflow.stress.case import CEILING, Case, Outcome
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.marching import march
from dacore.workflow.stress.physics import SLACK, STEPS, compare, outcome

# An iteration ends with a residual of what it finds hardest, which does more than one of random signs.
_ITERATED = 3.0 * SLACK


def _solved(solver: str, tolerance: float, factor: float = 1.0, slack: float = SLACK, **changes: float) -> Any:
    def run(context: Context) -> Outcome:
        method = context.plugin("solver", solver)()
        values = context.parameters(**changes)
        return compare(context, context.model, values, factor * context.step, method, tolerance, slack=slack)

    return run


def _loose(solver: str, tolerance: float) -> Any:
    """A loose tolerance was asked for: an error of its order is announced, one far above it is not."""

    def run(context: Context) -> Outcome:
        method = context.plugin("solver", solver)()
        values = context.parameters()
        own = MarchedModel(context.model, TimeGrid(context.step, STEPS), context.scheme, "zero", method, tolerance)
        found = context.ask(lambda: own.solve(values).states)
        expected = march(context.model, values, context.scheme, context.step, STEPS)
        result = outcome(context, found, expected, tolerance)
        told = f"solver.tolerance = {tolerance:g} was asked for" if result.error <= 100 * tolerance else ""
        return Outcome(result.error, min(result.bound, CEILING), told, result.note)

    return run


def _singular(solver: str) -> Any:
    """A system with a row and column that repeat others: no solution, or many."""

    def run(context: Context) -> Outcome:
        method = context.plugin("solver", solver)()
        n = 60
        a = context.rng(2).standard_normal((n, n - 1))
        matrix = csr_array(a @ a.T)
        right = context.rng(3).standard_normal(n)
        found = context.ask(lambda: method.prepare(matrix, np.ones(n, dtype=bool), 1e-10).solve(right))
        return Outcome(np.inf, 0.0, note=f"largest value {np.abs(found).max():.1e}, but there is no solution")

    return run


CASES = (
    Case(
        "direct, tolerance 1e-13",
        "solvers",
        "three digits above round-off",
        "refinement must not stall",
        _solved("direct", 1e-13),
    ),
    Case(
        "krylov, tolerance 1e-13",
        "solvers",
        "three digits above round-off",
        "restarts may stagnate",
        _solved("krylov", 1e-13),
    ),
    Case(
        "direct, tolerance 1e-3", "solvers", "a loose tolerance", "errors add up over the steps", _loose("direct", 1e-3)
    ),
    Case(
        "krylov, tolerance 1e-3", "solvers", "a loose tolerance", "errors add up over the steps", _loose("krylov", 1e-3)
    ),
    Case(
        "direct, tolerance 1e-18", "solvers", "below round-off", "no residual is that small", _solved("direct", 1e-18)
    ),
    Case(
        "krylov, tolerance 1e-18", "solvers", "below round-off", "no residual is that small", _solved("krylov", 1e-18)
    ),
    Case(
        "krylov, nu = 0.499999",
        "solvers",
        "nearly incompressible, iterated",
        "the preconditioner knows no λ",
        _solved("krylov", 1e-10, nu=0.499999),
    ),
    Case(
        "krylov, time step x 1e6",
        "solvers",
        "a static problem, iterated",
        "inertia no longer helps",
        _solved("krylov", 1e-10, 1e6, _ITERATED),
    ),
    Case(
        "direct, singular matrix",
        "solvers",
        "rank n − 1",
        "the residual can be small in a wrong way",
        _singular("direct"),
    ),
    Case(
        "krylov, singular matrix",
        "solvers",
        "rank n − 1",
        "the residual can be small in a wrong way",
        _singular("krylov"),
    ),
)
