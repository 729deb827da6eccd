"""The models that can be reduced, and what reduction asks of each: matrices, a reduced solver, tests of a residual."""

import numpy as np

from dacore.algebra.linear_solver import prepared
from dacore.core.arrays import Array
from dacore.core.model import AffineModel
from dacore.core.parameters import Parameters
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.system import StepSystem
from dacore.reduction.galerkin import Tested
from dacore.reduction.march import ReducedMarch
from dacore.reduction.response import ReducedResponse
from dacore.reduction.solver import ReducedSolver

Reducible = MarchedModel | HarmonicModel

_TOLERANCE = 1e-6


def affine_of(model: Reducible) -> AffineModel:
    """Return the affine model to project: of a harmonic one that with losses as friction."""
    return model.viscous if isinstance(model, HarmonicModel) else model.model


def reduced_solver(model: Reducible, tested: Tested, flow: tuple[bool, ...], start: Array) -> ReducedSolver:
    """Return what moves the projected model as `model` moves.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    tested : Tested
        Its projection.
    flow : tuple of bool
        For each field, whether its rows are those of a flow.
    start : (r, n_loads) array
        Coefficients at t = 0 of the state that each load gives; a cycle has none.
    """
    if isinstance(model, HarmonicModel):
        return ReducedResponse.of(model, tested, flow)
    return ReducedMarch.of(model, tested, flow, start)


def dual_solutions(model: Reducible, parameters: Parameters, z: Array) -> Array:
    """Solve Sᵀ y = z on the free dofs, S the matrix of a step or of the oscillation.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    parameters : mapping of str to float
    z : (n_dofs, k) array

    Returns
    -------
    (n_dofs, k) array, or (n_dofs, 2, k) for an oscillation: real and imaginary part.

    Raises
    ------
    ConvergenceError
        If the solver fails.
    """
    tolerance = max(model.tolerance, _TOLERANCE)
    if isinstance(model, HarmonicModel):
        complex_y = model.duals(parameters, z, tolerance)
        return np.stack([complex_y.real, complex_y.imag], axis=1)
    system = StepSystem(model.model, model.scheme, float(model.grid.lengths[-1]))
    step = system.at(parameters)
    solver = prepared(model.method, step.matrix, system.definite, tolerance, model.analysis)
    y = np.zeros_like(z)
    y[system.free] = step.scale[:, None] * solver.solve(z[system.free])
    return y
