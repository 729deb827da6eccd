"""Contracts of a finite element backend."""

from functools import partial

from dacore.core.discretization import Backend
from dacore.testing.backends import conduct, declaration, entries, evaluation, identities, weights
from dacore.testing.backends.stand import Stand
from dacore.testing.meshes import graded_box, islands, shuffled_box
from dacore.testing.suite import Suite, bind, expect_kind


def backend_suite(backend: Backend) -> Suite:
    """Make every check of a backend: one case for each check and mesh.

    Forms are compared entry by entry with an independent computation, on meshes in two and three
    dimensions: "bumpy" (renumbered, uneven boundary, a hole), "graded" (cells of very different size and
    shape), "islands" (two cells that do not touch, each facet with its own role) and "box" (flat sides).

    Parameters
    ----------
    backend : Backend
        Its library is loaded when the first case runs.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If it is no backend.
    """
    expect_kind("backend_suite", backend, Backend)
    cases = list(bind(declaration.CHECKS, backend))
    on_any = (*entries.CHECKS, *weights.CHECKS, *evaluation.GENERAL)
    for dim in (2, 3):
        bumpy = partial(shuffled_box, dim, 3, seed=1, bumpy=True, hole=True)
        for name, make, checks in (
            ("bumpy", bumpy, (*on_any, *identities.GENERAL, *evaluation.WITH_A_HOLE)),
            ("graded", partial(graded_box, dim, 3, seed=2), on_any),
            ("islands", partial(islands, dim, seed=3), (*on_any, identities.sums, identities.green)),
            ("box", partial(shuffled_box, dim, 2, seed=4), (*identities.ON_A_BOX, *evaluation.ON_A_BOX)),
            ("small", partial(shuffled_box, dim, 4 - dim, seed=5, bumpy=True), conduct.CHECKS),
        ):
            cases += bind(checks, Stand(backend, f"{name} {dim}-D mesh", make), f"{name}{dim}d")
    return Suite(tuple(cases))
