"""The motions that superpose to every trajectory of one stiffness: what reduced training solves in full.

The state is linear in the amplitudes of its loads. Loads whose amplitude is the same in all samples move together;
each of the others moves alone, as large as it typically is.
"""

from dataclasses import replace

import numpy as np

from dacore.core.arrays import Array
from dacore.core.model import ForwardModel, Trajectory
from dacore.core.parameters import Parameters, ParameterSpace
from dacore.core.space import StateSpace
from dacore.dynamics.harmonic import HarmonicModel
from dacore.dynamics.march import MarchedModel
from dacore.errors import ShapeError


class Motions(ForwardModel):
    """A model whose trajectories are the motions of all loads, one after the other.

    Every step before the recorded ones is recorded too, and a start that is not zero: a reduced model must
    pass through all of them.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    amplitudes : (n_loads, K) array
        Of the samples to come.

    Attributes
    ----------
    parts : (n_loads, k) array
        Amplitudes of the loads in each motion.
    """

    def __init__(self, model: MarchedModel | HarmonicModel, amplitudes: Array) -> None:
        self._given = model, amplitudes
        self.full = _with_spin_up(model)
        self.started = isinstance(model, MarchedModel) and (
            model.start == "steady" or any(load.initial is not None for load in model.model.loads)
        )
        self._recorded = len(model.times)
        constant = np.ptp(amplitudes, axis=1) == 0
        typical = np.sqrt((amplitudes**2).mean(axis=1))
        columns = [np.where(constant, amplitudes[:, 0], 0.0)]
        columns += [np.where(np.arange(len(typical)) == j, typical, 0.0) for j in np.flatnonzero(~constant)]
        self.parts = np.stack([column for column in columns if column.any()] or columns[:1], axis=1)
        self._constant = constant

    def __reduce__(self) -> tuple[object, ...]:
        return Motions, self._given

    @property
    def space(self) -> StateSpace:
        """The space of the states."""
        return self.full.space

    @property
    def parameters(self) -> ParameterSpace:
        """The parameters of the model."""
        return self.full.parameters

    @property
    def times(self) -> Array:
        """Times (k · t,) [s] of every motion in turn."""
        times = self.full.times
        return np.tile(np.concatenate([[0.0], times]) if self.started else times, self.parts.shape[1])

    def solve(self, parameters: Parameters) -> Trajectory:
        """Solve for all motions with one set-up."""
        states = self.full.motions(parameters, self.parts)
        if self.started and isinstance(self.full, MarchedModel):
            starts = self.full.starts(parameters, self.parts)
            states = np.concatenate([starts.T[:, :, None], states], axis=2)
        return Trajectory(np.concatenate(list(states), axis=1), self.times)

    def superpose(self, motions: Trajectory, amplitudes: Array) -> Array:
        """Return the states (n_dofs, t) at the recorded times under loads of amplitudes (n_loads,)."""
        shares = np.linalg.lstsq(self.parts, np.asarray(amplitudes), rcond=None)[0]
        if not np.allclose(self.parts @ shares, amplitudes, rtol=1e-12, atol=1e-12 * np.abs(amplitudes).max()):
            raise ShapeError("amplitudes: these loads were not moved in training")
        count = self.parts.shape[1]
        length = motions.states.shape[1] // count
        total = np.zeros((self.space.n_dofs, self._recorded))
        for j, share in enumerate(shares):
            total += share * motions.states[:, (j + 1) * length - self._recorded : (j + 1) * length]
        return total


def _with_spin_up(model: MarchedModel | HarmonicModel) -> MarchedModel | HarmonicModel:
    """Return the model that records the steps of a spin-up too, where there is one."""
    if isinstance(model, HarmonicModel):
        return model
    grid = replace(model.grid, steps=model.grid.steps + model.grid.spin_up, spin_up=0)
    if grid == model.grid:
        return model
    return MarchedModel(model.model, grid, model.scheme, model.start, model.method, model.tolerance, model.analysis)
