"""The built-in linear solvers by name, for tests."""

from dacore.algebra.solvers import Auto, Direct, Krylov

METHODS = {"auto": Auto(), "direct": Direct(), "krylov": Krylov()}


def make_solver(matrix, definite, method="auto", tolerance=1e-10, analysis=None):
    return METHODS[method].prepare(matrix, definite, tolerance, analysis)
