"""The linear system of one time step: everything free of parameters is made once.

Constrained dofs are eliminated, the rows marked ``antisymmetric`` are scaled by −1/(factor of C),
and what is left on the free dofs is symmetric quasi-definite.
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array, dia_array

from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.model import AffineModel, AffineTerm, Load
from dacore.core.parameters import Parameters
from dacore.dynamics.newmark import Newmark, State
from dacore.dynamics.pattern import PatternSum
from dacore.errors import AccuracyError, ShapeError

_SYMMETRY_TOLERANCE = 1e-10


class StepSystem:
    """One step of a scheme for an affine model, for any parameters.

    Parameters
    ----------
    model : AffineModel
    scheme : Newmark
    step : float [s]

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

    def __init__(self, model: AffineModel, scheme: Newmark, step: float) -> None:
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
        scale = np.where(self.definite, 1.0, -1.0 / scheme.rate_factor(step))
        self._forces = scale[:, None] * stack([load.force for load in model.loads], model.space.n_dofs)[self.free]
        self._second = _restrict(model.second_order, self.free, scale)
        self._first = _restrict(model.first_order, self.free, scale)
        zeroth = _restrict(model.zeroth_order, self.free, scale)
        self._terms = (*model.second_order, *model.first_order, *model.zeroth_order)
        self._factors = np.repeat(
            [scheme.mass_factor(step), scheme.rate_factor(step), 1.0],
            [len(self._second), len(self._first), len(zeroth)],
        )
        rows = [*self._second, *self._first, *zeroth]
        self._sum = PatternSum([block[:, self.free] for block in rows], (self.free.size, self.free.size))
        self._lifts = [block[:, self.constrained] @ self.prescribed for block in rows]
        self.middle = {p.name: float(p.quantile(np.array(0.5))) for p in model.parameters.parameters}
        _check_symmetry(self.at(self.middle).matrix, self.definite)

    def at(self, parameters: Parameters) -> "Step":
        """Return the step for one parameter vector."""
        coefficients = np.array([term.coefficient(parameters) for term in self._terms])
        second, first = len(self._second), len(self._first)
        loads = self._forces.copy()
        for weight, lift in zip(coefficients * self._factors, self._lifts, strict=True):
            loads -= weight * lift
        return Step(
            self._sum.combine(coefficients * self._factors),
            loads,
            tuple(zip(coefficients[:second], self._second, strict=True)),
            tuple(zip(coefficients[second : second + first], self._first, strict=True)),
            self.scheme,
            self.step,
        )


class Step:
    """The system of one step at one parameter vector.

    Attributes
    ----------
    matrix : (n_free, n_free) csr_array
        Symmetric quasi-definite.
    loads : (n_free, n_loads) array
        Right-hand side per unit of each load, prescribed values included.
    """

    def __init__(
        self,
        matrix: Sparse,
        loads: Array,
        second: Sequence[tuple[float, Sparse]],
        first: Sequence[tuple[float, Sparse]],
        scheme: Newmark,
        step: float,
    ) -> None:
        self.matrix, self.loads = matrix, loads
        self._second, self._first, self._scheme, self._step = second, first, scheme, step

    def right_side(self, old: State, weights: Array) -> Array:
        """Return the right-hand side (n_free, k) after the state `old` under loads weighted by (n_loads, k)."""
        total = self.loads @ weights
        if self._second:
            history = self._scheme.mass_history(old, self._step)
            for coefficient, rows in self._second:
                total += coefficient * (rows @ history)
        if self._first:
            history = self._scheme.rate_history(old, self._step)
            for coefficient, rows in self._first:
                total += coefficient * (rows @ history)
        return np.asarray(total)


def stack(columns: Sequence[Array], n: int) -> Array:
    """Columns as one (n, k) array, also for k = 0."""
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


def load_profiles(loads: Sequence[Load], times: Array) -> Array:
    """Profiles (n_loads, t) of the loads at times (t,) [s]."""
    return np.array([load.profile(times) for load in loads]).reshape(len(loads), len(times))


def _restrict(terms: Sequence[AffineTerm], rows: IntArray, scale: Array) -> list[Sparse]:
    """Scaled rows (n_free, n_dofs) of the terms."""
    diagonal = dia_array((scale[None, :], [0]), shape=(len(scale), len(scale)))
    return [csr_array(diagonal @ term.matrix[rows]) for term in terms]


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
    error = float(np.abs((scaled - scaled.T).data).max(initial=0.0))
    if error > _SYMMETRY_TOLERANCE * float(np.abs(scaled.data).max()):
        raise AccuracyError(
            f"step matrix: unsymmetric by {error:.1e} after scaling; every step must be symmetric: mark the rows "
            "of a flow as antisymmetric, and hold one of two coupled fields on every part of the boundary"
        )
