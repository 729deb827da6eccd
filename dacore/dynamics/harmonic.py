"""Motions at one frequency: an affine model solved for its amplitude and phase, without marching.

y(t) = Re(ŷ e^{iωt}), ŷ complex. A trajectory holds it as two states, those at t = 0 and at t = T/4::

    y(0) = Re ŷ,        y(T/4) = −Im ŷ

so that y(t) = y(0) cos ωt + y(T/4) sin ωt at any time. Both are states like any others: whatever observes, compresses
or estimates states over time does the same with amplitudes and phases, and the mean of squares over the two
is that over the cycle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np

from dacore.algebra.solvers import Direct
from dacore.core.arrays import Array, IntArray, check_shape
from dacore.core.display import Card, count, listed
from dacore.core.model import AffineModel, AffineTerm, Coefficient, Trajectory
from dacore.core.parameters import Parameters
from dacore.core.solver import SolverMethod
from dacore.dynamics.harmonic_system import Complex, HarmonicSystem
from dacore.dynamics.solved import SolvedModel
from dacore.errors import ShapeError


def phases(amplitude: Complex) -> Array:
    """Return the states (..., n, 2) at t = 0 and t = T/4 of complex amplitudes (..., n): Re ŷ and −Im ŷ."""
    return np.stack([amplitude.real, -amplitude.imag], axis=-1)


def amplitude(states: Array) -> Complex:
    """Return the complex amplitudes (..., n) of states (..., n, 2) at t = 0 and t = T/4."""
    if np.ndim(states) < 1 or np.shape(states)[-1] != 2:
        raise ShapeError(f"states: got shape {np.shape(states)}, expected two phases, (..., 2)")
    return np.asarray(states[..., 0] - 1j * states[..., 1])


@dataclass(frozen=True)
class Friction:
    """θ -> c(θ) η(θ) / ω: the term of first order that takes what a loss factor η takes at one frequency."""

    coefficient: Coefficient
    loss: Coefficient
    omega: float

    def __call__(self, parameters: Parameters) -> float:
        """Coefficient at θ."""
        return float(self.coefficient(parameters) * self.loss(parameters) / self.omega)


@final
class HarmonicModel(SolvedModel):
    """An affine model driven at one frequency, in its limit cycle.

    Parameters
    ----------
    model : AffineModel
        Its loads are sines and cosines of the frequency (`dacore.dynamics.profiles`).
    frequency : float [Hz]
    losses : mapping of str to callable, optional
        Loss factors of terms of zeroth order by their names: θ -> η >= 0, which makes E to E(1 + iη). Module-level
        functions or objects, as coefficients are.
    method : SolverMethod, optional
        What solves the systems; `dacore.algebra.solvers.Direct` by default.
    tolerance : float
        Relative residual of every solve.
    analysis : object, optional
        What ``method.analyse`` found, if it is known; found when first needed otherwise.

    Raises
    ------
    ShapeError
        If the frequency is not positive, a load is no oscillation of it, or a loss names no term.
    AccuracyError
        If the system is not symmetric on the free dofs.

    Notes
    -----
    One factorisation of `dacore.dynamics.harmonic_system` serves all loads. A pickle holds the settings and the
    analysis; the matrices on the free dofs are made anew.
    """

    def __init__(
        self,
        model: AffineModel,
        frequency: float,
        losses: Mapping[str, Coefficient] | None = None,
        method: SolverMethod | None = None,
        tolerance: float = 1e-10,
        analysis: Any = None,
    ) -> None:
        if not (np.isfinite(frequency) and frequency > 0):
            raise ShapeError(f"frequency: got {frequency}, expected a positive number of Hz")
        if not 0 < tolerance < 1:
            raise ShapeError(f"tolerance: got {tolerance}, expected a number between 0 and 1")
        if method is not None and not isinstance(method, SolverMethod):
            raise ShapeError(f"method: got {method!r}, expected a SolverMethod such as dacore.algebra.solvers.Direct()")
        super().__init__(model, method or Direct(), tolerance, analysis)
        self.frequency, self.losses = float(frequency), dict(losses or {})
        self._system = HarmonicSystem(model, self.frequency, self.losses)

    def _analyse(self, nodes: IntArray) -> Any:
        system = self._system
        return self.method.analyse(system.at(system.middle).doubled, system.definite, np.tile(nodes[system.free], 2))

    @property
    def _lag(self) -> float:
        return 1.0 / self._system.omega

    def __reduce__(self) -> tuple[Any, ...]:
        settings = (self.model, self.frequency, self.losses, self.method, self.tolerance)
        return HarmonicModel, (*settings, self.analysis)

    def _card(self) -> Card:
        return Card(
            "HarmonicModel",
            (
                ("fields", listed([each.name for each in self.space.fields])),
                ("degrees of freedom", count(self.space.n_dofs)),
                ("frequency", f"{self.frequency:g} Hz; states at t = 0 and a quarter of the period"),
                ("losses", listed(list(self.losses)) or "none"),
                ("solver", type(self.method).__name__),
                ("free parameters", listed([each.name for each in self.parameters.free])),
                ("loads", listed([each.name for each in self.model.loads])),
            ),
        )

    @property
    def times(self) -> Array:
        """The two recorded times (2,) [s], 0 and a quarter of the period."""
        return np.array([0.0, 0.25 / self.frequency])

    @cached_property
    def viscous(self) -> AffineModel:
        """The affine model that moves the same at this frequency, with losses as terms of first order."""
        terms = [
            AffineTerm(f"loss of {each.name}", each.matrix, Friction(each.coefficient, loss, self._system.omega))
            for each in self.model.zeroth_order
            if (loss := self.losses.get(each.name)) is not None
        ]
        return replace(self.model, first_order=(*self.model.first_order, *terms))

    @property
    def factors(self) -> Complex:
        """Complex amplitude (n_loads,) of each load's profile: 1 for a cosine, −i for a sine."""
        return self._system.factors

    def solve(self, parameters: Parameters) -> Trajectory:
        """Solve with all loads in one right-hand side.

        Parameters
        ----------
        parameters : mapping of str to float

        Returns
        -------
        Trajectory
            States (n_dofs, 2) at t = 0 and t = T/4.

        Raises
        ------
        ShapeError
            If a parameter is missing or outside what the physics allows, or a loss is negative.
        ConvergenceError
            If the residual is not reached: the frequency is a resonance that nothing damps.
        """
        self._check(parameters)
        weights = self._system.factors * self.model.amplitudes(parameters)
        return Trajectory(phases(self._solve(parameters, weights[:, None])[:, 0]), self.times)

    def motions(self, parameters: Parameters, amplitudes: Array) -> Array:
        """Solve for several combinations of the loads, with one factorisation for all of them.

        Parameters
        ----------
        parameters : mapping of str to float
            The loads' own amplitudes in it have no influence.
        amplitudes : (n_loads, k) array
            Amplitude of each load in each combination, in front of its profile.

        Returns
        -------
        (k, n_dofs, 2) array
            States at t = 0 and t = T/4.

        Raises
        ------
        ShapeError, ConvergenceError
            As `solve`.
        """
        return phases(self.amplitudes(parameters, self.factors[:, None] * np.asarray(amplitudes)).T)

    def duals(self, parameters: Parameters, z: Array, tolerance: float) -> Complex:
        """Solve Sᵀ y = z on the free dofs, S = −ω²M + iωC + A with losses: what tests a residual for its error.

        Parameters
        ----------
        parameters : mapping of str to float
        z : (n_dofs, k) array
        tolerance : float
            Relative residual.

        Returns
        -------
        (n_dofs, k) complex array
            Zero on the constrained dofs.

        Raises
        ------
        ShapeError, ConvergenceError
            As `solve`.
        """
        self._check(parameters)
        system = self._system
        out = np.zeros(z.shape, dtype=np.complex128)
        right = z[system.free].astype(np.complex128)
        solved = system.at(parameters).solve(right, self.method, tolerance, self.analysis)
        out[system.free] = system.scale[:, None] * solved
        return out

    def amplitudes(self, parameters: Parameters, weights: Complex) -> Complex:
        """Solve for loads of complex amplitudes of your own, with one factorisation for all of them.

        Parameters
        ----------
        parameters : mapping of str to float
            The loads' own amplitudes in it have no influence.
        weights : (n_loads, k) complex array
            Each load's amplitude in k motions, in place of its own and of its profile: 1 pushes as cos ωt.

        Returns
        -------
        (n_dofs, k) complex array
            ŷ of y(t) = Re(ŷ e^{iωt}).

        Raises
        ------
        ShapeError, ConvergenceError
            As `solve`.
        """
        self._check(parameters)
        given = np.asarray(weights, dtype=np.complex128)
        check_shape("weights", given, (len(self.model.loads), given.shape[-1] if given.ndim == 2 else 1))
        return self._solve(parameters, given)

    def _solve(self, parameters: Parameters, weights: Complex) -> Complex:
        """Complex amplitudes (n_dofs, k) for loads (n_loads, k), the factors of their profiles included."""
        system = self._system
        at = system.at(parameters)
        out = np.empty((self.space.n_dofs, weights.shape[1]), dtype=np.complex128)
        out[system.constrained] = system.prescribed @ weights
        out[system.free] = at.solve(at.right_side(weights), self.method, self.tolerance, self.analysis)
        return out
