"""Marching an affine model in time, with one solver set-up for each parameter sample."""

from typing import Any, Literal, final

import numpy as np

from dacore.algebra.linear_solver import prepared
from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array, IntArray, check_shape
from dacore.core.display import Card, count, listed, moments
from dacore.core.model import AffineModel, Trajectory
from dacore.core.parameters import Parameters
from dacore.core.solver import LinearSolver, SolverMethod
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import Scheme, State, StepRule
from dacore.dynamics.solved import SolvedModel
from dacore.dynamics.static import steady_state
from dacore.dynamics.system import StepSystem, initial_states, load_profiles
from dacore.errors import ShapeError

Start = Literal["zero", "steady"]


@final
class MarchedModel(SolvedModel):
    """An affine model, its time grid and the scheme that marches it.

    Parameters
    ----------
    model : AffineModel
    grid : TimeGrid
    scheme : Scheme, optional
        `dacore.dynamics.newmark.Newmark` as published by default.
    start : {"zero", "steady"}
        "zero": y = ẏ = ÿ = 0 at t = 0 on every dof, so that prescribed values jump in the first
        step; y is what the loads' initial states add up to, where some give one, and ẏ = ÿ = 0 then stands
        for rates that are not known. "steady": the equilibrium A(θ) y = F under the loads at t = 0.
    method : SolverMethod, optional
        What solves the steps; `dacore.algebra.solvers.Auto` by default.
    tolerance : float
        Relative residual of every solve.
    analysis : object, optional
        What ``method.analyse`` found, if it is known; found when first needed otherwise.

    Raises
    ------
    ShapeError
        If a setting is none of these, or the start is steady and a load gives an initial state.

    Notes
    -----
    A pickle holds the settings and the analysis; the matrices on the free dofs are made anew.
    """

    def __init__(
        self,
        model: AffineModel,
        grid: TimeGrid,
        scheme: Scheme | None = None,
        start: Start = "zero",
        method: SolverMethod | None = None,
        tolerance: float = 1e-10,
        analysis: Any = None,
    ) -> None:
        if start not in ("zero", "steady"):
            raise ShapeError(f"start: got {start!r}, expected 'zero' or 'steady'")
        if method is not None and not isinstance(method, SolverMethod):
            raise ShapeError(f"method: got {method!r}, expected a SolverMethod such as dacore.algebra.solvers.Direct()")
        given = [load.name for load in model.loads if load.initial is not None]
        if start == "steady" and given:
            raise ShapeError(
                f"start: got 'steady' and the initial state of {', '.join(given)}, expected one of them; set start to "
                "'zero', or leave the initial state out"
            )
        super().__init__(model, method or Auto(), tolerance, analysis)
        self.grid, self.scheme, self.start = grid, scheme or Newmark(), start
        self._system = StepSystem(model, self.scheme, float(grid.lengths[-1]))

    def _analyse(self, nodes: IntArray) -> Any:
        matrix = self._system.at(self._system.middle).matrix
        return self.method.analyse(matrix, self._system.definite, nodes[self._system.free])

    @property
    def _lag(self) -> float:
        # Steps as long as most are.
        return 1.0 / self.scheme.regular(float(self.grid.lengths[-1])).rate_factor

    def __reduce__(self) -> tuple[Any, ...]:
        settings = (self.model, self.grid, self.scheme, self.start, self.method, self.tolerance)
        return MarchedModel, (*settings, self.analysis)

    def _card(self) -> Card:
        grid, space = self.grid, self.space
        start = f"{'at rest from zero' if self.start == 'zero' else 'steady'}"
        parts = "" if grid.substeps == 1 else f", each in {grid.substeps} parts"
        return Card(
            "MarchedModel",
            (
                ("fields", listed([each.name for each in space.fields])),
                ("degrees of freedom", count(space.n_dofs)),
                ("times", moments(grid.times) + parts),
                ("scheme", self.scheme.label),
                ("start", start),
                ("solver", type(self.method).__name__),
                ("free parameters", listed([each.name for each in self.parameters.free])),
                ("loads", listed([each.name for each in self.model.loads])),
            ),
        )

    @property
    def times(self) -> Array:
        """Recorded times (t,) [s]."""
        return self.grid.times

    def solve(self, parameters: Parameters) -> Trajectory:
        """Solve with all loads in one right-hand side.

        Parameters
        ----------
        parameters : mapping of str to float

        Returns
        -------
        Trajectory
            States (n_dofs, t) at the recorded times.

        Raises
        ------
        ShapeError
            If a parameter is missing or outside what the physics allows.
        ConvergenceError
            If the linear solver fails.
        """
        self._check(parameters)
        return Trajectory(self._march(parameters, self.model.amplitudes(parameters)[:, None])[0], self.times)

    def motions(self, parameters: Parameters, amplitudes: Array) -> Array:
        """Solve for several combinations of the loads, with one solver set-up for all of them.

        Parameters
        ----------
        parameters : mapping of str to float
            The loads' own amplitudes in it have no influence.
        amplitudes : (n_loads, k) array
            Amplitude of each load in each combination.

        Returns
        -------
        (k, n_dofs, t) array
            States at the recorded times.

        Raises
        ------
        ShapeError, ConvergenceError
            As `solve`.
        """
        self._check(parameters)
        if np.ndim(amplitudes) != 2 or len(amplitudes) != len(self.model.loads):
            raise ShapeError(
                f"amplitudes: got shape {np.shape(amplitudes)}, expected ({len(self.model.loads)}, k) for the loads "
                f"{', '.join(load.name for load in self.model.loads)}"
            )
        return self._march(parameters, np.asarray(amplitudes, dtype=np.float64))

    def march(self, parameters: Parameters, start: State) -> Trajectory:
        """Solve from a state of your own at t = 0, one column; `dacore.dynamics.static` completes smooth ones."""
        self._check(parameters)
        check_shape("start", start.value, (self.space.n_dofs, 1))
        return Trajectory(self._run(parameters, self.model.amplitudes(parameters)[:, None], start)[0], self.times)

    def starts(self, parameters: Parameters, amplitudes: Array) -> Array:
        """States (n_dofs, k) at t = 0 under k combinations (n_loads, k) of the loads; ConvergenceError as `solve`."""
        if self.start == "steady":
            weights = load_profiles(self.model.loads, np.zeros(1)) * amplitudes
            return steady_state(self.model, parameters, weights, self.method, self.tolerance)
        return np.asarray(initial_states(self.model) @ amplitudes)

    def _march(self, parameters: Parameters, amplitudes: Array) -> Array:
        # Where a load is there at t = 0 already, everything jumps and the rates at t = 0 are not known.
        jump = self.start == "zero" and load_profiles(self.model.loads, np.zeros(1)).any()
        state = State.at_rest(self.starts(parameters, amplitudes), lag=np.inf if jump else 0.0)
        return self._run(parameters, amplitudes, state)

    def _run(self, parameters: Parameters, amplitudes: Array, state: State) -> Array:
        """March k motions with load amplitudes (n_loads, k): states (k, n_dofs, t)."""
        system, grid = self._system, self.grid
        times = np.concatenate([[0.0], grid.ends])
        profiles = load_profiles(self.model.loads, times)[:, :, None] * amplitudes[:, None, :]
        recorded = np.empty((amplitudes.shape[1], self.space.n_dofs, grid.steps))
        rule: StepRule | None = None
        held: list[LinearSolver] = []
        done = 0
        for k, (length, keep) in enumerate(zip(grid.lengths.tolist(), grid.recorded, strict=True)):
            if (new := self.scheme.rule(state, length)) != rule:
                held.clear()  # never two solvers in memory
                rule, step = new, system.at(parameters, new)
                held.append(prepared(self.method, step.matrix, system.definite, self.tolerance, self.analysis))
                step = step.without_matrix()
            state = step.take(held[0], state, profiles[:, k + 1], profiles[:, k], length)
            if keep:
                recorded[:, :, done] = state.value.T
                done += 1
        return recorded
