"""States without motion to start from: equilibria under static loads, and consistent starts."""

import numpy as np
from scipy.sparse import csr_array

from dacore.algebra.linear_solver import prepared
from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.model import AffineModel, combine
from dacore.core.parameters import Parameters
from dacore.core.solver import SolverMethod
from dacore.dynamics.scheme import State
from dacore.dynamics.system import load_profiles, stack
from dacore.errors import CapabilityError, ConvergenceError


def steady_state(
    model: AffineModel,
    parameters: Parameters,
    weights: Array,
    method: SolverMethod | None = None,
    tolerance: float = 1e-10,
) -> Array:
    """Solve A(θ) y = F for the state that does not move under static loads.

    The antisymmetric rows (the flow) must not see the other fields at rest, as in poroelasticity:
    they are solved first, and the momentum balance with the pressure they give.

    Parameters
    ----------
    model : AffineModel
    parameters : mapping of str to float
    weights : (n_loads, k) array
        Amplitude of each load in k states.
    method : SolverMethod, optional
        The built-in choice by default.
    tolerance : float
        Relative residual of each solve.

    Returns
    -------
    (n_dofs, k) array

    Raises
    ------
    CapabilityError
        If the flow is coupled to the other fields at rest.
    ConvergenceError
        If a solve fails; a steady state needs a field held somewhere on the boundary.
    """
    n = model.space.n_dofs
    stiffness = combine(model.zeroth_order, parameters, n)
    force = stack([load.force for load in model.loads], n) @ weights
    state = stack([load.prescribed for load in model.loads], n) @ weights
    flow = np.flatnonzero(model.antisymmetric & ~model.constrained)
    rest = np.flatnonzero(~model.antisymmetric & ~model.constrained)
    coupling = stiffness[flow][:, np.flatnonzero(~model.antisymmetric)]
    if np.any(coupling.data):
        raise CapabilityError("steady start: the antisymmetric rows see other fields at rest; start from zero instead")
    for rows in (flow, rest):
        if not rows.size:
            continue
        right = force[rows] - stiffness[rows] @ state
        if not np.abs(stiffness.diagonal()[rows]).min() > 0:
            raise ConvergenceError(
                "steady start: some equations vanish at rest (a permeability of zero?), so the state at rest is not "
                "determined; start from zero instead"
            )
        _check_determined(model, stiffness, rows)
        if right.any():
            state[rows] = _solve(stiffness, rows, right, method or Auto(), tolerance)
    return state


def _check_determined(model: AffineModel, stiffness: Sparse, rows: IntArray) -> None:
    """ConvergenceError if the constants of a field change nothing: it is held nowhere, and any constant is as good."""
    block = csr_array(stiffness[rows][:, rows])
    layout = model.space.layout
    for field in layout.fields:
        for component in range(field.components):
            part = layout.component(field.name, component)
            constant = ((rows >= part.start) & (rows < part.stop)).astype(np.float64)
            largest = float((abs(block) @ constant).max(initial=0.0))
            if constant.any() and float(np.abs(block @ constant).max()) <= 1e-12 * largest:
                which = f"component {component} of {field.name}" if field.components > 1 else field.name
                raise ConvergenceError(
                    f"steady start: {which} is held nowhere, so the state at rest is determined up to a constant only; "
                    "hold it on some part of the boundary, or start from zero instead"
                )


def consistent_start(model: AffineModel, parameters: Parameters, start: State, tolerance: float = 1e-12) -> State:
    """Complete a smooth start so that the equations hold at t = 0.

    Values and the rates of dofs with mass are kept. Free dofs without mass get the rate
    ``C ẏ = F − A y``, free dofs with mass the acceleration ``M ÿ = F − C ẏ − A y``; rates and
    accelerations of constrained dofs are taken from `start`. A scheme of second order needs this.

    Parameters
    ----------
    model : AffineModel
    parameters : mapping of str to float
    start : State
    tolerance : float
        Of the linear solves.

    Returns
    -------
    State
    """
    n = model.space.n_dofs
    groups = (model.second_order, model.first_order, model.zeroth_order)
    mass, damping, stiffness = (combine(terms, parameters, n) for terms in groups)
    forces = stack([load.force for load in model.loads], n)
    factors = model.amplitudes(parameters) * load_profiles(model.loads, np.zeros(1))[:, 0]
    residual = (forces @ factors)[:, None] - stiffness @ start.value
    moved = np.diff(mass.indptr) > 0
    heavy, light = (np.flatnonzero(which & ~model.constrained) for which in (moved, ~moved))
    rate, acceleration = start.rate.copy(), start.acceleration.copy()
    if light.size:
        rate[light] = 0.0
        rate[light] = _solve(damping, light, (residual - damping @ rate)[light], Auto(), tolerance)
    if heavy.size:
        acceleration[heavy] = 0.0
        right = residual - damping @ rate - mass @ acceleration
        acceleration[heavy] = _solve(mass, heavy, right[heavy], Auto(), tolerance)
    return State(start.value, rate, acceleration)


def _solve(matrix: Sparse, rows: IntArray, right: Array, method: SolverMethod, tolerance: float) -> Array:
    """Solve the symmetric positive definite block of `matrix` at `rows`."""
    block = csr_array(matrix[rows][:, rows])
    return prepared(method, block, np.ones(rows.size, dtype=bool), tolerance).solve(right)
