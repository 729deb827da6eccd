"""What solves a reduced model for many parameter vectors at once, whatever the full one does: march or oscillate."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.reduction.galerkin import Tested


@dataclass(frozen=True, eq=False, repr=False)
class Balance(Displayed):
    """What a step balances, or a motion at one of its phases: y, its derivatives and the loads, K samples side by side.

    Parameters
    ----------
    value, rate, acceleration : (r + n_loads, K) arrays
    loads : (n_loads, K) array
    """

    value: Array
    rate: Array
    acceleration: Array
    loads: Array

    def residual(self, tested: Tested, coefficients: Array) -> Array:
        """Tested residual (rows, K) of the equation of motion."""
        return np.asarray(
            tested.apply(2, coefficients, self.acceleration)
            + tested.apply(1, coefficients, self.rate)
            + tested.apply(0, coefficients, self.value)
            - tested.forces @ self.loads
        )


Number = TypeVar("Number", np.float64, np.complex128)
Watcher = Callable[[slice, Balance], None]


class ReducedSolver(ABC, Displayed):
    """A projected model and how it moves.

    Attributes
    ----------
    tested : Tested
        The projected model.
    flow : tuple of bool
        For each field, whether its rows are those of a flow.
    """

    tested: Tested
    flow: tuple[bool, ...]

    @property
    @abstractmethod
    def times(self) -> Array:
        """Recorded times (t,) [s]."""

    @property
    @abstractmethod
    def start(self) -> Array:
        """Coefficients (r, n_loads) at t = 0 of the state that each load gives there; zero where there is none."""

    @abstractmethod
    def run(self, coefficients: Array, amplitudes: Array, watch: Watcher | None = None) -> Array:
        """Solve K samples.

        Parameters
        ----------
        coefficients : (n_terms, K) array
        amplitudes : (n_loads, K) array
        watch : callable, optional
            Called with samples (a slice) and what is balanced there, at every step or phase.

        Returns
        -------
        (r + n_loads, t, K) array
            Reduced states at the recorded times.

        Raises
        ------
        ConvergenceError
            If a system is singular.
        """

    @abstractmethod
    def on(self, tested: Tested, directions: Mapping[str, Array]) -> Self:
        """Return the same on fewer coordinates.

        Parameters
        ----------
        tested : Tested
            The model projected on them.
        directions : mapping of str to (r_f, s_f) array
            Orthonormal, of each field's coordinates.
        """


def combined(tested: Tested, weights: NDArray[Number]) -> NDArray[Number]:
    """Return the matrix (r, r) of a projected model, real or complex as the weights (n_terms,) of its terms are."""
    r = len(tested.forces)
    matrix = np.zeros((r, r), dtype=weights.dtype)
    for term, weight in zip(tested.terms, weights, strict=True):
        for (row, column), block in term.blocks.items():
            if weight:
                matrix[tested.rows[row], tested.columns[column]] += weight * block
    return matrix
