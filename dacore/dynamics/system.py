"""The linear system of one time step: everything free of parameters is made once.

Constrained dofs are eliminated, the rows marked ``antisymmetric`` are scaled by −1/(factor of C),
and what is left on the free dofs is symmetric quasi-definite.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, dia_array

from dacore.algebra.linear_solver import product
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.model import AffineModel, Load, at_start
from dacore.core.parameters import Parameters
from dacore.core.solver import LinearSolver
from dacore.dynamics.pattern import PatternSum
from dacore.dynamics.scheme import Scheme, State, StepRule
from dacore.errors import AccuracyError, ShapeError

_SYMMETRY_TOLERANCE = 1e-10
# Where in every range symmetry is looked at, beside the middle.
_ASIDE = 0.85
_ROWS = 25_000


class StepSystem:
    """One step of a scheme for an affine model, for any parameters.

    Parameters
    ----------
    model : AffineModel
    scheme : Scheme
    step : float [s]
        Length of the regular steps.

    Attributes
    ----------
    free, constrained : (n_free,), (n_dofs − n_free,) int arrays
        Dofs that are solved for, and dofs with prescribed values.
    definite : (n_free,) bool array
        Rows of the positive definite block; the others form the negative definite block.
    prescribed : (n_dofs − n_free, n_loads) array
        Values of the constrained dofs per unit of each load.
    middle : mapping of str to float
        Every parameter at the middle of its range.

    Raises
    ------
    AccuracyError
        If the step is not symmetric on the free dofs: the model's ``antisymmetric`` rows or its
        boundary conditions do not fit together.
    ShapeError
        If no dof is free, or an antisymmetric row has mass.
    """

    def __init__(self, model: AffineModel, scheme: Scheme, step: float) -> None:
        self.scheme, self.step = scheme, step
        self.free: IntArray = np.flatnonzero(~model.constrained)
        self.constrained: IntArray = np.flatnonzero(model.constrained)
        if not self.free.size:
            raise ShapeError("model: every dof is constrained, expected at least one free dof")
        for term in model.second_order:
            if term.matrix[np.flatnonzero(model.antisymmetric)].nnz:
                raise ShapeError(f"term {term.name}: antisymmetric rows have mass, expected first order in time there")
        self.definite: BoolArray = ~model.antisymmetric[self.free]
        self.prescribed = stack([load.prescribed for load in model.loads], model.space.n_dofs)[self.constrained]
        self.forces = stack([load.force for load in model.loads], model.space.n_dofs)[self.free]
        self._orders = (model.second_order, model.first_order, model.zeroth_order)
        # The model's own matrices, not their free rows: that would be a copy.
        terms = (*model.second_order, *model.first_order, *model.zeroth_order)
        n = model.space.n_dofs
        self._sum = PatternSum([term.matrix for term in terms], (n, n), self.free, (self.free, self.constrained))
        self.middle = model.parameters.middle
        # Not in the middle alone: there, coefficients may agree by chance.
        aside = {each.name: float(each.quantile(np.array(_ASIDE))) for each in model.parameters.parameters}
        for parameters in (self.middle, aside) if aside != self.middle else (self.middle,):
            _check_symmetry(self.at(parameters).matrix, self.definite)

    def at(self, parameters: Parameters, rule: StepRule | None = None) -> "Step":
        """Return the step for one parameter vector, under the rule of the regular steps or another."""
        rule = rule or self.scheme.regular(self.step)
        coefficients = [np.array([t.coefficient(parameters) for t in terms]) for terms in self._orders]
        factors = np.concatenate(
            [rule.mass_factor * coefficients[0], rule.rate_factor * coefficients[1], coefficients[2]]
        )
        scale = np.where(self.definite, 1.0, -1.0 / rule.rate_factor)
        matrix, lift = self._sum.combine(factors)
        second, first = (
            tuple((value, term.matrix) for value, term in zip(values, terms, strict=True))
            for values, terms in zip(coefficients[:2], self._orders[:2], strict=True)
        )
        return Step(self, rule, scale, scale_rows(matrix, scale), scale_rows(lift, scale), second, first)


@dataclass(frozen=True, eq=False)
class Step:
    """The system of one step at one parameter vector.

    Parameters
    ----------
    system : StepSystem
    rule : StepRule
    scale : (n_free,) array
        Factors of the rows.
    matrix : (n_free, n_free) csr_array
        Symmetric quasi-definite.
    lift : (n_free, n_dofs − n_free) csr_array
        The columns of the constrained dofs.
    second, first : tuple of (float, (n_dofs, n_dofs) csr_array)
        Coefficients and matrices of the terms of M and C.
    """

    system: StepSystem
    rule: StepRule
    scale: Array
    matrix: Sparse
    lift: Sparse
    second: tuple[tuple[float, Sparse], ...]
    first: tuple[tuple[float, Sparse], ...]

    def without_matrix(self) -> "Step":
        """Return the step for a march whose solver is prepared and has the matrix in a form of its own."""
        return replace(self, matrix=csr_array(self.matrix.shape))

    @property
    def loads(self) -> Array:
        """Right-hand side (n_free, n_loads) per unit of each load, prescribed values included, where w = 1."""
        return np.asarray(self.scale[:, None] * self.system.forces - self.lift @ self.system.prescribed)

    def target(self, old: State, weights: Array) -> Array:
        """Return y_* (n_dofs − n_free, k) of the constrained dofs that ends in what loads of `weights` prescribe."""
        value, w = self.system.prescribed @ weights, self.rule.weight
        return np.asarray(value if w == 1 else (1 - w) * old.value[self.system.constrained] + w * value)

    def right_side(self, old: State, weights: Array, before: Array | None = None, step: float | None = None) -> Array:
        """Return the right-hand side (n_free, k) of the step after the state `old`.

        Parameters
        ----------
        old : State
        weights, before : (n_loads, k) arrays
            Factors of the loads at the end and at the beginning of the step; `before` matters where w < 1
            and is zero if left out.
        step : float, optional
            Length [s]; that of the regular steps if left out.
        """
        scheme, w = self.system.scheme, self.rule.weight
        length = self.system.step if step is None else step
        mean = weights if w == 1 else w * weights if before is None else w * weights + (1 - w) * before
        total = self.system.forces @ mean
        for terms, histories in ((self.second, scheme.mass_history), (self.first, scheme.rate_history)):
            if terms:
                history = histories(old, length)
                for coefficient, matrix in terms:
                    total += coefficient * product(matrix, history)[self.system.free]
        return np.asarray(self.scale[:, None] * total - self.lift @ self.target(old, weights))

    def take(self, solver: LinearSolver, old: State, weights: Array, before: Array, step: float) -> State:
        """Return the state after a step of `step` seconds; `solver` is prepared for the matrix of this step."""
        value = np.empty_like(old.value)
        value[self.system.constrained] = self.target(old, weights)
        value[self.system.free] = solver.solve(self.right_side(old, weights, before, step))
        return self.system.scheme.advance(old, value, step)


def stack(columns: Sequence[Array], n: int) -> Array:
    """Columns as one (n, k) array, also for k = 0."""
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


def load_profiles(loads: Sequence[Load], times: Array) -> Array:
    """Profiles (n_loads, t) of the loads at times (t,) [s]; that of an initial state is one at t = 0 and zero after."""
    profiles = [load.profile if load.initial is None else at_start for load in loads]
    return np.array([profile(times) for profile in profiles]).reshape(len(loads), len(times))


def initial_states(model: AffineModel) -> Array:
    """States (n_dofs, n_loads) at t = 0 per unit of each load: zero but for loads that give one."""
    none = np.zeros(model.space.n_dofs)
    return stack([none if load.initial is None else load.initial for load in model.loads], model.space.n_dofs)


def scale_rows(matrix: Sparse, scale: Array) -> Sparse:
    """Multiply the rows of a matrix by `scale` (r,) in place, and return it."""
    for begin in range(0, len(scale), _ROWS):  # in parts: the factors of all entries would be as large as the matrix
        starts = matrix.indptr[begin : begin + _ROWS + 1]
        matrix.data[starts[0] : starts[-1]] *= np.repeat(scale[begin : begin + _ROWS], np.diff(starts))
    return matrix


def _check_symmetry(matrix: Sparse, definite: BoolArray) -> None:
    """AccuracyError unless the matrix, scaled to a unit diagonal, is symmetric with the signs promised."""
    diagonal = matrix.diagonal()
    wrong = np.flatnonzero(~(np.where(definite, diagonal, -diagonal) > 0))
    if wrong.size:
        raise AccuracyError(
            f"step matrix: {wrong.size} diagonal entries have the wrong sign (first: free dof {wrong[0]}); "
            "give every dof mass, stiffness or storage, and mark the flow rows as antisymmetric"
        )
    scale = 1.0 / np.sqrt(np.abs(diagonal))
    unit = dia_array((scale[None, :], [0]), shape=matrix.shape)
    scaled = csr_array(unit @ matrix @ unit)
    error = 0.0
    for begin in range(0, len(scale), _ROWS):  # differences of the whole would be as large as the matrix
        part = slice(begin, begin + _ROWS)
        error = max(error, float(np.abs((scaled[part] - scaled[:, part].T).data).max(initial=0.0)))
    if error > _SYMMETRY_TOLERANCE * float(np.abs(scaled.data).max()):
        raise AccuracyError(
            f"step matrix: unsymmetric by {error:.1e} after scaling; every step must be symmetric: mark the rows "
            "of a flow as antisymmetric, hold one of two coupled fields on every part of the boundary, and scale "
            "equations so that they couple alike; a model that is not symmetric solves for itself, as a ForwardModel"
        )
