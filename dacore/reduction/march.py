"""Marching a reduced model for many parameter vectors at once, with the scheme of the full one.

The schemes of `dacore.dynamics` act on each entry of a state alone, so they march reduced states as they
are; the samples are the columns. Only the matrix of the step differs from sample to sample.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from dacore.core.arrays import Array
from dacore.core.model import Load
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.scheme import Scheme, State, StepRule
from dacore.dynamics.system import load_profiles
from dacore.errors import ConvergenceError
from dacore.reduction.galerkin import Tested
from dacore.reduction.solver import Balance, ReducedSolver, Watcher, combined

_CHUNK_BYTES = 256 * 2**20

Solve = Callable[[Array], Array]


@dataclass(frozen=True, eq=False, repr=False)
class ReducedMarch(ReducedSolver):
    """A reduced model, its time grid and its scheme.

    Parameters
    ----------
    tested : Tested
        The projected model.
    loads : tuple of Load
        For their profiles.
    scheme : Scheme
    grid : TimeGrid
    steady : bool
        Start from the equilibrium under the loads at t = 0, or from zero.
    flow : tuple of bool
        For each field, whether its rows are divided by −c, which makes the step symmetric.
    initial : (r, n_loads) array
        Coefficients at t = 0 of the state that each load gives there, zero where it gives none.
    """

    tested: Tested
    loads: tuple[Load, ...]
    scheme: Scheme
    grid: TimeGrid
    steady: bool
    flow: tuple[bool, ...]
    initial: Array

    @classmethod
    def of(cls, marched: MarchedModel, tested: Tested, flow: tuple[bool, ...], initial: Array) -> "ReducedMarch":
        """Return the reduced model that marches as the full one does."""
        steady = marched.start == "steady"
        return cls(tested, marched.model.loads, marched.scheme, marched.grid, steady, flow, initial)

    @property
    def times(self) -> Array:
        """Recorded times (t,) [s]."""
        return self.grid.times

    @property
    def start(self) -> Array:
        """Coefficients (r, n_loads) at t = 0 of the state that each load gives there."""
        return self.initial

    def on(self, tested: Tested, directions: Mapping[str, Array]) -> Self:
        """Return the same on fewer coordinates."""
        parts = [directions[name].T @ self.initial[rows] for name, rows in self.tested.rows.items()]
        return replace(self, tested=tested, initial=np.concatenate(parts))

    def run(self, coefficients: Array, amplitudes: Array, watch: Watcher | None = None) -> Array:
        """March K samples.

        Parameters
        ----------
        coefficients : (n_terms, K) array
        amplitudes : (n_loads, K) array
        watch : callable, optional
            Called at every step with the samples (a slice) and what the step balances.

        Returns
        -------
        (r + n_loads, t, K) array
            Reduced states at the recorded times.

        Raises
        ------
        ConvergenceError
            If a step is singular.
        """
        r, count = len(self.tested.forces), coefficients.shape[1]
        out = np.empty((r + len(self.loads), self.grid.steps, count))
        width = max(int(_CHUNK_BYTES / (8 * max(r, 1) ** 2)), 1)
        for first in range(0, count, width):
            part = slice(first, min(first + width, count))
            seen = partial(watch, part) if watch else None
            out[:, :, part] = self._run(coefficients[:, part], amplitudes[:, part], seen)
        return out

    def _run(self, coefficients: Array, amplitudes: Array, watch: Callable[[Balance], None] | None) -> Array:
        tested, scheme, grid = self.tested, self.scheme, self.grid
        r = len(tested.forces)
        times = np.concatenate([[0.0], grid.ends])
        profiles = load_profiles(self.loads, times)
        out = np.empty((r + len(self.loads), grid.steps, coefficients.shape[1]))
        state = self._start(coefficients, amplitudes)
        rule: StepRule | None = None
        done = 0
        for k, (length, keep) in enumerate(zip(grid.lengths.tolist(), grid.recorded, strict=True)):
            if (new := scheme.rule(state, length)) != rule:
                rule = new
                solve, scale = self._solver(coefficients, rule)
            before, after = profiles[:, k, None] * amplitudes, profiles[:, k + 1, None] * amplitudes
            w = rule.weight
            mean = after if w == 1 else w * after + (1 - w) * before
            target = after if w == 1 else (1 - w) * state.value[r:] + w * after
            mass, rate = scheme.mass_history(state, length), scheme.rate_history(state, length)
            ahead = np.concatenate([np.zeros((r, target.shape[1])), target])
            right = tested.forces @ mean
            right += tested.apply(2, coefficients, mass - rule.mass_factor * ahead)
            right += tested.apply(1, coefficients, rate - rule.rate_factor * ahead)
            right -= tested.lift(0, coefficients, target)
            value = np.concatenate([solve(scale[:, None] * right), target])
            if watch:
                watch(Balance(value, rule.rate_factor * value - rate, rule.mass_factor * value - mass, mean))
            state = scheme.advance(state, value, length)
            if keep:
                out[:, done] = state.value
                done += 1
        return out

    def _start(self, coefficients: Array, amplitudes: Array) -> State:
        r, count = len(self.tested.forces), coefficients.shape[1]
        profile = load_profiles(self.loads, np.zeros(1))
        value = np.zeros((r + len(self.loads), count))
        if not self.steady:
            given = np.array([load.initial is not None for load in self.loads], dtype=bool)
            value[:r] = self.initial @ amplitudes
            value[r:][given] = amplitudes[given]
            return State.at_rest(value, lag=np.inf if profile.any() else 0.0)
        value[r:] = profile * amplitudes
        right = self.tested.forces @ value[r:] - self.tested.apply(0, coefficients, value)
        solve, scale = self._solver(coefficients, StepRule(0.0, 0.0))
        value[:r] = solve(scale[:, None] * right)
        return State.at_rest(value)

    def _solver(self, coefficients: Array, rule: StepRule) -> tuple[Solve, Array]:
        """What solves the steps of each sample with one rule, and the factors (r,) of their rows."""
        factors = np.array(
            [{2: rule.mass_factor, 1: rule.rate_factor, 0: 1.0}[term.order] for term in self.tested.terms]
        )
        weights = factors[:, None] * coefficients
        r = len(self.tested.forces)
        scale = np.ones(r)
        for rows, flow in zip(self.tested.rows.values(), self.flow, strict=True):
            if flow:
                scale[rows] = -1.0 / rule.rate_factor if rule.rate_factor else -1.0
        # Samples that differ in the amplitudes of loads only have one matrix.
        distinct, which = np.unique(weights, axis=1, return_inverse=True)
        solvers = [
            (np.flatnonzero(which.ravel() == k), *self._factored(sample, scale)) for k, sample in enumerate(distinct.T)
        ]

        def solve(right: Array) -> Array:
            out = np.empty_like(right)
            for columns, lu, unit in solvers:
                part = lu_solve(lu, unit[:, None] * right[:, columns], overwrite_b=True, check_finite=False)
                out[:, columns] = unit[:, None] * part
            return out

        return solve, scale

    def _factored(self, weights: Array, scale: Array) -> tuple[tuple[Array, Array], Array]:
        """Factors of the step with given weights (n_terms,) of its terms, and the scaling (r,) of both its sides."""
        matrix = combined(self.tested, weights)
        matrix *= scale[:, None]
        diagonal = np.abs(np.diag(matrix))
        if not diagonal.min(initial=1.0) > 0:
            raise ConvergenceError("reduced model: a step is singular; raise training.reduction or train in full")
        unit = 1.0 / np.sqrt(diagonal)
        matrix *= unit[:, None] * unit[None, :]
        return lu_factor(matrix, overwrite_a=True, check_finite=False), unit
