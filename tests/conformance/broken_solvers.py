"""Solvers that are wrong in one way each: the built-in direct one, changed."""

from dataclasses import dataclass

import numpy as np

from dacore.algebra.solvers import Direct
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.errors import ConvergenceError, ShapeError
from dacore.testing import solver_suite
from tests.conformance.mutants import Mutant

MUTANTS = []


def caught_by(check, says="", also=()):
    def declare(cls):
        MUTANTS.append(Mutant(cls.__name__, lambda: solver_suite(cls()), (check, *also), says))
        return cls

    return declare


class Solver(LinearSolver):
    """Passes on to the direct solver, and lets its method change what goes in and comes out."""

    def __init__(self, method, inner, matrix, tolerance):
        self.method, self.inner, self.matrix, self.tolerance = method, inner, matrix, tolerance
        self.count = 0

    @property
    def name(self):
        return self.method.called(self.inner.name)

    def solve(self, rhs, guess=None):
        self.count += 1
        return self.method.change(self, rhs, guess)


@dataclass(frozen=True)
class Sound(SolverMethod):
    def analyse(self, matrix, definite, nodes):
        return Direct().analyse(matrix, definite, nodes)

    def prepare(self, matrix, definite, tolerance, analysis=None):
        return Solver(self, Direct().prepare(matrix, definite, tolerance, analysis), matrix, tolerance)

    def called(self, name):
        return name

    def change(self, solver, rhs, guess):
        return solver.inner.solve(rhs, guess)


@caught_by("reaches_the_tolerance", "column 1 has the relative residual")
class WrongSecondColumn(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        if x.ndim == 2 and x.shape[1] > 1:
            x[:, 1] *= 1.0 + 1e-3
        return x


@caught_by("reaches_the_tolerance", "raise ConvergenceError where it is not reached")
class StopsEarly(Sound):
    def prepare(self, matrix, definite, tolerance, analysis=None):
        return Solver(self, Direct().prepare(matrix, definite, 1e-3, analysis), matrix, tolerance)

    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        return x * (1.0 + 3.0 * solver.tolerance)


@caught_by("reaches_the_tolerance", "expected|residual")
class ResidualOfTheLargestColumn(Sound):
    """Columns are measured against the largest one."""

    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        return x if x.ndim == 1 else x + 1e-3 * solver.tolerance * np.abs(x).max() * np.ones_like(x)


@caught_by("reaches_the_tolerance", "on a poroelastic step with the tolerance 1e-04 raises RuntimeError: out of memory")
class FailsOnCoupledSystems(Sound):
    def prepare(self, matrix, definite, tolerance, analysis=None):
        if not definite.all():
            raise RuntimeError("out of memory")
        return super().prepare(matrix, definite, tolerance, analysis)


@caught_by("many_solves_stay_exact", "on a poroelastic step, solve returns a list, no array")
class ReturnsAList(Sound):
    def change(self, solver, rhs, guess):
        return solver.inner.solve(rhs, guess).tolist()


@caught_by("a_guess_is_only_a_guess", "from a guess", also=("many_solves_stay_exact",))
class AddsTheGuess(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs)
        return x if guess is None else x + 1e-9 * guess


@caught_by("nothing_given_is_changed", "writes into what it is given")
class OverwritesTheRightSide(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        rhs -= solver.matrix @ x
        return x


@caught_by("nothing_given_is_changed", "changes its settings")
class RemembersInItsSettings(Sound):
    def change(self, solver, rhs, guess):
        object.__setattr__(self, "last", solver.count)
        return solver.inner.solve(rhs, guess)


@caught_by("nothing_given_is_changed", "returns the memory of the guess")
class ReturnsTheGuess(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs)
        if guess is None:
            return x
        flags = guess.flags.writeable
        guess.setflags(write=True) if guess.base is None else guess.base.setflags(write=True)
        out = guess
        try:
            out.flags.writeable = True
            out[:] = x
        finally:
            out.flags.writeable = flags
        return out


@caught_by("solvers_do_not_disturb_each_other", "with other solvers in use")
class LastPreparedWins(Sound):
    last = []  # noqa: RUF012  shared on purpose

    def prepare(self, matrix, definite, tolerance, analysis=None):
        made = super().prepare(matrix, definite, tolerance, analysis)
        self.last[:] = [made.inner]
        return made

    def change(self, solver, rhs, guess):
        inner = self.last[0]
        same = len(inner.matrix.indptr) == len(rhs) + 1
        return (inner if same else solver.inner).solve(rhs, guess)


@caught_by("an_analysis_serves_the_pattern", "its analysis cannot be pickled")
class UnpicklableAnalysis(Sound):
    def analyse(self, matrix, definite, nodes):
        return lambda: None

    def prepare(self, matrix, definite, tolerance, analysis=None):
        return super().prepare(matrix, definite, tolerance)


@caught_by("an_analysis_serves_the_pattern", "another matrix with a pickled analysis")
class AnalysisHoldsTheNumbers(Sound):
    def analyse(self, matrix, definite, nodes):
        return matrix

    def prepare(self, matrix, definite, tolerance, analysis=None):
        return super().prepare(matrix if analysis is None else analysis, definite, tolerance)


@caught_by("many_solves_stay_exact", "the solution of a column of zeros is not zero")
class ZeroIsTheGuess(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        return x if guess is None or rhs.ndim == 1 else np.where((rhs == 0).all(axis=0), guess, x)


@caught_by("many_solves_stay_exact", "relative residual")
class Drifts(Sound):
    def change(self, solver, rhs, guess):
        return solver.inner.solve(rhs, guess) * (1.0 + 1e-9 * solver.count**3)


@caught_by("answers_are_new", "whose last solution was overwritten")
class OneBuffer(Sound):
    def change(self, solver, rhs, guess):
        if getattr(solver, "kept", np.zeros(0)).shape != rhs.shape:
            solver.kept = solver.inner.solve(rhs, guess)
        return solver.kept


@caught_by("a_matrix_may_change_later", "that the caller has overwritten")
class KeepsTheCallersMatrix(Sound):
    def change(self, solver, rhs, guess):
        x = solver.inner.solve(rhs, guess)
        return x if solver.matrix.data.any() else np.zeros_like(x)


@caught_by("wrong_shapes_are_refused", "raises ValueError|raises nothing")
class ChecksNothing(Sound):
    def change(self, solver, rhs, guess):
        try:
            return solver.inner.solve(rhs, guess)
        except ShapeError:
            return np.zeros_like(rhs)


@caught_by("what_cannot_be_solved_is_said", "a singular matrix, column|a tolerance of 1e-19, column")
class NeverComplains(Sound):
    def prepare(self, matrix, definite, tolerance, analysis=None):
        try:
            return super().prepare(matrix, definite, tolerance, analysis)
        except ConvergenceError:
            return Solver(self, None, matrix, tolerance)

    def called(self, name):
        return "never complains"

    def change(self, solver, rhs, guess):
        try:
            return solver.inner.solve(rhs, guess)
        except (ConvergenceError, AttributeError):
            return np.linalg.lstsq(solver.matrix.toarray(), rhs, rcond=None)[0]


@caught_by("has_a_name", "the name of its solver is ''")
class Nameless(Sound):
    def called(self, name):
        return ""


@caught_by("settings_are_equal_to_their_copy", "cannot be pickled")
class UnpicklableSettings(Sound):
    def __reduce__(self):
        raise TypeError("holds a communicator")
