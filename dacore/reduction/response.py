"""A reduced model oscillating at one frequency, for many parameter vectors at once.

The modes of a field are real, and hold the real and the imaginary parts of its amplitudes alike. So the projected
system has the structure of the full one (`dacore.dynamics.harmonic_system`): what takes energy stays positive
semidefinite, and wherever the full system is damped the reduced one has a solution.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from dacore.core.arrays import Array
from dacore.dynamics.harmonic import HarmonicModel, phases
from dacore.dynamics.harmonic_system import Complex
from dacore.errors import ConvergenceError
from dacore.reduction.galerkin import Tested
from dacore.reduction.solver import Balance, ReducedSolver, Watcher, combined


@dataclass(frozen=True, eq=False, repr=False)
class ReducedResponse(ReducedSolver):
    """A reduced model in its limit cycle.

    Parameters
    ----------
    tested : Tested
        The projected model, losses as friction (`HarmonicModel.viscous`).
    factors : (n_loads,) complex array
        The amplitude of each load's profile: 1 for a cosine, −i for a sine.
    frequency : float [Hz]
    flow : tuple of bool
        For each field, whether its rows are those of a flow.
    """

    tested: Tested
    factors: Complex
    frequency: float
    flow: tuple[bool, ...]

    @classmethod
    def of(cls, model: HarmonicModel, tested: Tested, flow: tuple[bool, ...]) -> "ReducedResponse":
        """Return the reduced model that oscillates as the full one does."""
        return cls(tested, model.factors, model.frequency, flow)

    @property
    def times(self) -> Array:
        """The two recorded times (2,) [s], 0 and a quarter of the period."""
        return np.array([0.0, 0.25 / self.frequency])

    @property
    def start(self) -> Array:
        """Zeros (r, n_loads): a cycle has no start."""
        return np.zeros(self.tested.forces.shape)

    def on(self, tested: Tested, directions: Mapping[str, Array]) -> Self:
        """Return the same on fewer coordinates."""
        del directions  # of a start, which there is none
        return replace(self, tested=tested)

    def run(self, coefficients: Array, amplitudes: Array, watch: Watcher | None = None) -> Array:
        """Solve K samples: reduced states (r + n_loads, 2, K) at t = 0 and t = T/4; see `ReducedSolver.run`."""
        tested, omega = self.tested, 2 * np.pi * self.frequency
        r, count = len(tested.forces), coefficients.shape[1]
        orders = np.array([{2: -(omega**2), 1: 1j * omega, 0: 1.0}[term.order] for term in tested.terms])
        weights = orders[:, None] * coefficients
        loads = self.factors[:, None] * amplitudes
        right = tested.forces @ loads
        for term, row in zip(tested.terms, weights, strict=True):
            right -= row * (term.lifted @ loads)
        found = np.empty((r + len(loads), count), dtype=np.complex128)
        found[r:] = loads
        # Samples that differ in the amplitudes of loads only have one matrix.
        distinct, which = np.unique(coefficients, axis=1, return_inverse=True)
        for k, sample in enumerate((orders[:, None] * distinct).T):
            columns = np.flatnonzero(which.ravel() == k)
            found[:r, columns] = self._solved(sample, right[:, columns])
        states = np.moveaxis(phases(found), -1, 1)
        if watch:
            pushed = phases(loads)
            for k, (here, later) in enumerate(((0, omega), (1, -omega))):
                # ẏ is ω times the state a quarter of the period later; at T/4 that is −y(0).
                value, rate = states[:, here], later * states[:, 1 - here]
                watch(slice(0, count), Balance(value, rate, -(omega**2) * value, pushed[:, :, k]))
        return states

    def _solved(self, weights: Complex, right: Complex) -> Complex:
        """Solutions (r, k) of the system with given weights (n_terms,) of its terms."""
        tested = self.tested
        scale = np.ones(len(right))
        for rows, flow in zip(tested.rows.values(), self.flow, strict=True):
            if flow:
                scale[rows] = 0.5 / np.pi / self.frequency
        size = np.zeros(len(right))
        for term, weight in zip(tested.terms, np.abs(weights), strict=True):
            for name, rows in tested.rows.items():
                if (name, name) in term.blocks:
                    # Stiffness and inertia count though they cancel at a resonance.
                    size[rows] += weight * np.abs(np.diag(term.blocks[name, name]))
        size *= scale
        if not size.min(initial=1.0) > 0:
            raise ConvergenceError("reduced model: a mode has no stiffness, inertia or damping; train in full")
        unit = 1.0 / np.sqrt(size)
        matrix = combined(tested, weights)
        matrix *= (scale * unit)[:, None] * unit[None, :]
        factors = lu_factor(matrix, overwrite_a=True, check_finite=False)
        solution = lu_solve(factors, (scale * unit)[:, None] * right, overwrite_b=True, check_finite=False)
        if not np.isfinite(solution).all():
            raise ConvergenceError(
                f"reduced model: {self.frequency:g} Hz is a resonance that nothing damps; give the material a loss, or "
                "change the frequency"
            )
        return np.asarray(unit[:, None] * solution)
