"""Numbers of interest: linear functionals over space and time."""

from abc import ABC, abstractmethod
from typing import ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array
from dacore.core.observation import Functionals
from dacore.core.space import StateSpace

Over = Literal["mean", "each"]


class QuantityOfInterest(ABC):
    """Frozen settings of a quantity; a plugin class of the hook ``dacore_quantities``.

    Attributes
    ----------
    over_time : {"mean", "each"}
        The mean over the recorded steps (one number a series), or one number a step.
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    over_time: Over

    @abstractmethod
    def functionals(self, space: StateSpace) -> Functionals:
        """Functionals in space.

        Parameters
        ----------
        space : StateSpace

        Returns
        -------
        Functionals
        """

    def of(self, states: Array, space: StateSpace) -> Array:
        """Values of a trajectory itself, as `Estimate.quantity` gives those of an estimate.

        Parameters
        ----------
        states : (n_dofs, t) array
        space : StateSpace
            The states are of.

        Returns
        -------
        (s,) array [unit of the quantity]
            s counts its functionals times its outputs in time.
        """
        return np.asarray(self.functionals(space)(states) @ self.time_weights(states.shape[1]).T).reshape(-1)

    def time_weights(self, n_steps: int) -> Array:
        """Weights (outputs, t): one row of 1/t for "mean", the identity for "each".

        Parameters
        ----------
        n_steps : int

        Returns
        -------
        (outputs, t) array
        """
        return np.full((1, n_steps), 1.0 / n_steps) if self.over_time == "mean" else np.eye(n_steps)
