"""An affine model: matrices free of parameters, coefficients and loads that are plain functions, a symmetric step."""

from collections.abc import Callable
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.model import AffineModel, AffineTerm
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.system import StepSystem
from dacore.errors import DacoreError
from dacore.testing.models.stand import Stand
from dacore.testing.suite import fail, require

_SCHEMES = (Newmark(), Newmark(0.25, 0.5, "newmark"))


def terms_are_matrices(stand: Stand) -> None:
    """Terms have different names and finite csr_arrays (n_dofs, n_dofs) of float64."""
    model = stand.affine
    if model is None:
        return
    names = [term.name for term in _terms(model)]
    twice = sorted({name for name in names if names.count(name) > 1})
    require(not twice, f"{stand.name}: the term {', '.join(twice)} is there twice")
    for term in _terms(model):
        good = isinstance(term.matrix, csr_array) and term.matrix.dtype == np.float64
        require(good, f"{stand.name}: the matrix of {term.name} is a {type(term.matrix).__name__}, expected csr_array")
        require(bool(np.isfinite(term.matrix.data).all()), f"{stand.name}: the matrix of {term.name} holds NaN")
        require(term.matrix.nnz > 0, f"{stand.name}: the matrix of {term.name} is empty")


def coefficients_are_functions(stand: Stand) -> None:
    """Coefficients and amplitudes are finite numbers that depend on the parameters alone, and change none of them."""
    model = stand.affine
    if model is None:
        return
    asked: dict[str, Callable[[Any], float]] = {
        f"coefficient of {term.name}": term.coefficient for term in _terms(model)
    }
    asked |= {f"amplitude of {load.name}": load.amplitude for load in model.loads}
    for what, function in asked.items():
        first, other = stand.some(2)
        try:
            value = function(MappingProxyType(first))
        except TypeError as error:
            fail(f"{stand.name}: the {what} writes into the parameters: {error}")
        good = np.ndim(value) == 0 and bool(np.isfinite(value))
        require(good, f"{stand.name}: the {what} is {value!r}, expected a finite number")
        function(other)
        again = function(dict(reversed(list(first.items()))))
        require(again == value, f"{stand.name}: the {what} is {value!r}, then {again!r} for the same parameters")


def matrices_are_free_of_parameters(stand: Stand) -> None:
    """Coefficients and solves leave the matrices, forces, prescribed values and initial states as they are."""
    model = stand.affine
    if model is None:
        return
    arrays = {f"matrix of {term.name}": term.matrix.data for term in _terms(model)}
    arrays |= {f"force of {load.name}": load.force for load in model.loads}
    arrays |= {f"prescribed values of {load.name}": load.prescribed for load in model.loads}
    arrays |= {f"initial state of {load.name}": load.initial for load in model.loads if load.initial is not None}
    kept = {name: array.copy() for name, array in arrays.items()}
    for theta in stand.some(2):
        stand.forward.solve(theta)
    for name, array in arrays.items():
        require(np.array_equal(array, kept[name]), f"{stand.name}: the {name} changes in a solve")


def profiles_are_functions_of_time(stand: Stand) -> None:
    """A profile takes times (t,) to finite factors (t,), one by one as all at once, and leaves the times alone."""
    model = stand.affine
    if model is None:
        return
    times = np.concatenate([[0.0], stand.grid.times])
    for load in model.loads:
        given, where = times.copy(), f"{stand.name}: the profile of {load.name}"
        whole = np.asarray(load.profile(given))
        require(np.array_equal(given, times), f"{where} changes the times it is given")
        require(whole.shape == times.shape, f"{where} has shape {whole.shape} for {len(times)} times")
        require(bool(np.isfinite(whole).all()), f"{where} is not finite")
        alone = np.array([np.asarray(load.profile(times[[k]]))[0] for k in range(len(times))[::-1]])[::-1]
        off = float(np.abs(alone - whole).max())
        require(off <= 1e-12 * max(1.0, np.abs(whole).max()), f"{where} differs by {off:.1e} at times asked one by one")


def flags_fit(stand: Stand) -> None:
    """`constrained` and `antisymmetric` flag dofs, some dof is free, flow rows have no mass, loads give something."""
    model = stand.affine
    if model is None:
        return
    for name in ("constrained", "antisymmetric"):
        flags = getattr(model, name)
        good = flags.shape == (model.space.n_dofs,) and flags.dtype == np.bool_
        require(good, f"{stand.name}: {name} has shape {flags.shape} and type {flags.dtype}, expected bool a dof")
    require(bool((~model.constrained).any()), f"{stand.name}: every dof is constrained")
    for term in model.second_order:
        heavy = term.matrix[np.flatnonzero(model.antisymmetric)].nnz
        require(not heavy, f"{stand.name}: antisymmetric rows have mass in {term.name}, expected first order in time")
    for load in model.loads:
        given = [load.force, load.prescribed, *([] if load.initial is None else [load.initial])]
        finite = all(bool(np.isfinite(each).all()) for each in given)
        require(finite, f"{stand.name}: the load {load.name} holds NaN or infinite values")
        gives = any(bool(each.any()) for each in given)
        require(gives, f"{stand.name}: the load {load.name} neither pushes nor prescribes anything nor starts anywhere")


def steps_are_symmetric(stand: Stand) -> None:
    """A time step is symmetric quasi-definite on the free dofs, for two schemes and all over the ranges."""
    model = stand.affine
    if model is None:
        return
    for scheme in _SCHEMES:
        try:
            system = StepSystem(model, scheme, stand.grid.step)
        except DacoreError as error:
            fail(f"{stand.name}: a step with {scheme} cannot be made: {error}")
        for theta in (stand.at(0.0), stand.at(1.0), *stand.some(3)):
            matrix = system.at(theta).matrix.toarray()
            diagonal = np.abs(np.diag(matrix))
            require(bool((diagonal > 0).all()), f"{stand.name}: a row of the step vanishes with {_short(theta)}")
            matrix /= np.sqrt(np.outer(diagonal, diagonal))
            off = float(np.abs(matrix - matrix.T).max())
            require(
                off < 1e-10,
                f"{stand.name}: the step is unsymmetric by {off:.1e} with {_short(theta)}; scale equations so "
                "that they couple alike, or build a ForwardModel that solves for itself",
            )
            for rows, sign, what in ((system.definite, 1.0, "positive"), (~system.definite, -1.0, "negative")):
                if rows.any():
                    low = float(np.linalg.eigvalsh(sign * matrix[np.ix_(rows, rows)])[0])
                    require(
                        low > 0,
                        f"{stand.name}: the {what} block has the eigenvalue {sign * low:.2g} with {_short(theta)}",
                    )


CHECKS = (
    terms_are_matrices, coefficients_are_functions, matrices_are_free_of_parameters, profiles_are_functions_of_time,
    flags_fit, steps_are_symmetric,
)  # fmt: skip


def _terms(model: AffineModel) -> tuple[AffineTerm, ...]:
    return (*model.second_order, *model.first_order, *model.zeroth_order)


def _short(theta: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.4g}" for name, value in theta.items())
