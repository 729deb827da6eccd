"""What every time scheme has in common: a step is one solve with a M + c C + A.

A scheme balances M ÿ + C ẏ + A y = F once in each step, at a moment between the old time t₀ and the new
time t₁, where ``y_* = (1 − w) y₀ + w y₁``, and ties the derivatives there to y_* and to the past::

    ÿ_* = a y_* − h,        ẏ_* = c y_* − g

so that ``(a M + c C + A) y_* = F_* + M h + C g`` is solved for y_*, with ``F_* = (1 − w) F₀ + w F₁``. Whatever the
scheme, the step is symmetric quasi-definite once the flow rows are divided by −c, on one sparsity pattern.

Stability. Let σ₁(z) = ẏ_*/y_* and σ₂(z) = ÿ_*/y_* be the factors of a motion that every step multiplies by z.
With y = (u, p) and C, A of poroelasticity (α(∇p, v) = −α(p, ∇·v) on the free dofs), testing the two equations with
u and p gives ``σ₂ m + k + d/conj(σ₁) = 0`` for numbers m, d ≥ 0 and k ≥ 0 of that motion, which has a solution
if and only if the damped oscillator ``m ẍ + d' ẋ + k x = 0`` has one with the same z. So a scheme is stable for
every mesh, step and parameter of the coupled system exactly if it is stable for every damped oscillator.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError


@dataclass(frozen=True, eq=False)
class State:
    """What a step needs to know of the past.

    Parameters
    ----------
    value, rate, acceleration : (n_dofs, k) arrays
        y, ẏ and ÿ of k motions.
    slope : (n_dofs, k) array, optional
        A second ẏ that some schemes carry; that of the start is `rate`.
    lag : float [s]
        How long before the time of `value` the acceleration and the slope hold. Zero for a consistent
        start; infinite for a start whose derivatives are not known, after a jump.
    """

    value: Array
    rate: Array
    acceleration: Array
    slope: Array | None = None
    lag: float = 0.0

    def __post_init__(self) -> None:
        shape = self.value.shape
        if len(shape) != 2 or self.rate.shape != shape or self.acceleration.shape != shape:
            raise ShapeError(
                f"state: got value {shape}, rate {self.rate.shape}, acceleration {self.acceleration.shape}, "
                "expected three arrays of one shape (n_dofs, k)"
            )
        if self.slope is not None and self.slope.shape != shape:
            raise ShapeError(f"state: got slope {self.slope.shape}, expected the shape {shape} of the value")
        if not self.lag >= 0:
            raise ShapeError(f"state: got lag {self.lag}, expected seconds, zero or more")

    @classmethod
    def at_rest(cls, value: Array, lag: float = 0.0) -> "State":
        """Return the state `value` (n_dofs, k) without motion; `lag` infinite if it is about to jump."""
        return cls(value, np.zeros_like(value), np.zeros_like(value), None, lag)


@dataclass(frozen=True)
class StepRule:
    """The numbers a, c and w of one step; steps with equal rules share their matrix.

    Parameters
    ----------
    mass_factor : float
        a, the factor of M [1/s²].
    rate_factor : float
        c, the factor of C [1/s].
    weight : float
        w of y_* = (1 − w) y₀ + w y₁.
    """

    mass_factor: float
    rate_factor: float
    weight: float = 1.0


class Scheme(ABC):
    """A time scheme: frozen settings that are stable once made."""

    carried: ClassVar[int]
    """Number of arrays of a state that the scheme uses."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Name and numbers, for captions."""

    @abstractmethod
    def regular(self, step: float) -> StepRule:
        """Return the rule of a step of `step` seconds after others of that length."""

    @abstractmethod
    def rule(self, old: State, step: float) -> StepRule:
        """Return the rule of the step of `step` seconds that follows the state `old`."""

    @abstractmethod
    def mass_history(self, old: State, step: float) -> Array:
        """Return h (n_dofs, k) of ÿ_* = a y_* − h."""

    @abstractmethod
    def rate_history(self, old: State, step: float) -> Array:
        """Return g (n_dofs, k) of ẏ_* = c y_* − g in the first-order terms."""

    @abstractmethod
    def advance(self, old: State, value: Array, step: float) -> State:
        """Return the state after a step in which y_* came out as `value` (n_dofs, k)."""

    @abstractmethod
    def parts(self, old: State) -> tuple[Array, ...]:
        """Return the arrays (n_dofs, k) of a state that the scheme uses."""

    @abstractmethod
    def joined(self, parts: tuple[Array, ...], step: float) -> State:
        """Return the state made of such arrays, after steps of `step` seconds."""
