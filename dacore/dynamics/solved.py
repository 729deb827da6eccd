"""What models that solve an affine one have in common: its space and parameters, its loads one by one, one analysis."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dacore.core.arrays import Array, IntArray, check_shape
from dacore.core.display import Displayed
from dacore.core.model import AffineModel, ForwardModel, Trajectory
from dacore.core.parameters import Parameters, ParameterSpace
from dacore.core.solver import SolverMethod
from dacore.core.space import StateSpace
from dacore.errors import ShapeError


@dataclass(frozen=True, eq=False, repr=False)
class Responses(Displayed):
    """The motion each load causes alone, per unit of its amplitude.

    Parameters
    ----------
    loads : tuple of str
        Names of the loads.
    states : (n_loads, n_dofs, t) array
    times : (t,) array [s]
    """

    loads: tuple[str, ...]
    states: Array
    times: Array

    def superpose(self, amplitudes: Array) -> Trajectory:
        """Return the trajectory under loads of the given amplitudes (n_loads,); costs no solve."""
        check_shape("amplitudes", np.asarray(amplitudes), (len(self.loads),))
        return Trajectory(np.tensordot(amplitudes, self.states, axes=1), self.times)


class SolvedModel(ForwardModel):
    """An affine model and what solves its systems.

    Parameters
    ----------
    model : AffineModel
    method : SolverMethod
    tolerance : float
        Relative residual of every solve.
    analysis : object, optional
        What ``method.analyse`` found, if it is known; found when first needed otherwise.
    """

    def __init__(self, model: AffineModel, method: SolverMethod, tolerance: float, analysis: Any = None) -> None:
        self.model, self.method, self.tolerance = model, method, tolerance
        self._given = analysis

    @cached_property
    def analysis(self) -> Any:
        """What the solver makes of the sparsity pattern alone: found once for all samples."""
        if self._given is not None:
            return self._given
        layout = self.space.layout
        nodes = [np.tile(np.arange(layout.nodes[field.name]), field.components) for field in layout.fields]
        return self._analyse(np.concatenate(nodes))

    @abstractmethod
    def _analyse(self, nodes: IntArray) -> Any:
        """Analyse the pattern; `nodes` (n_dofs,) are those that the dofs belong to."""

    @property
    @abstractmethod
    def _lag(self) -> float:
        """Inverse factor of the first-order terms in what is solved [s]."""

    @property
    def space(self) -> StateSpace:
        """The space of the states."""
        return self.model.space

    @property
    def parameters(self) -> ParameterSpace:
        """The parameters of the model."""
        return self.model.parameters

    def cautions(self, parameters: ParameterSpace) -> tuple[str, ...]:
        """What to beware of, a line each, with `parameters` in these ranges."""
        return tuple(line for caution in self.model.cautions if (line := caution(parameters, self._lag)))

    @abstractmethod
    def motions(self, parameters: Parameters, amplitudes: Array) -> Array:
        """Solve for several combinations of the loads, with one solver set-up for all of them.

        Parameters
        ----------
        parameters : mapping of str to float
            The loads' own amplitudes in it have no influence.
        amplitudes : (n_loads, k) array
            Amplitude of each load in each combination, in front of its profile.

        Returns
        -------
        (k, n_dofs, t) array
            States at the recorded times.

        Raises
        ------
        ShapeError, ConvergenceError
            As `solve`.
        """

    def responses(self, parameters: Parameters, loads: Sequence[str] | None = None) -> Responses:
        """Solve for each load alone, with unit amplitude and one solver set-up for all of them.

        The loads' amplitudes in `parameters` have no influence; superpose the responses with any.

        Parameters
        ----------
        parameters : mapping of str to float
        loads : sequence of str, optional
            Names of the loads; by default all.

        Returns
        -------
        Responses

        Raises
        ------
        ShapeError
            As `solve`, or if the model has no such load.
        ConvergenceError
            As `solve`.
        """
        self._check(parameters)
        every = [load.name for load in self.model.loads]
        chosen = tuple(every if loads is None else loads)
        if unknown := [name for name in chosen if name not in every]:
            raise ShapeError(f"loads: got {', '.join(unknown)}, expected any of {', '.join(every)}")
        states = self.motions(parameters, np.eye(len(every))[:, [every.index(name) for name in chosen]])
        return Responses(chosen, states, self.times)

    def _check(self, parameters: Parameters) -> None:
        missing = [name for name in self.parameters.names if name not in parameters]
        if missing:
            raise ShapeError(f"parameters: {', '.join(missing)} missing; expected {', '.join(self.parameters.names)}")
