"""Newmark's family of time steps for M ÿ + C ẏ + A y = F, derived from its two updates.

With τ the step, the updates are (Newmark 1959)::

    ÿ₁ = (y₁ − y₀ − τ ẏ₀)/(βτ²) − (1 − 2β)/(2β) ÿ₀
    ẏ₁ = ẏ₀ + τ ((1 − γ) ÿ₀ + γ ÿ₁)

Both are affine in y₁, so that ``ÿ₁ = a y₁ − h`` and ``ẏ₁ = c y₁ − g`` with histories h and g that
depend on the old state alone, and a step solves ``(a M + c C + A) y₁ = F₁ + M h + C g``.

Stability. For ``m ẍ + d ẋ + k x = 0`` let D = dτ/m, Ω = kτ²/m, q₁ = 2γ − 1, q₂ = 4β − 2γ. The factors z per step are
the roots, through z = (1 + s)/(1 − s), of polynomials with the coefficients, from the highest power,

    4 + 2D q₁ + Ω q₂,   2D + Ω q₁,   Ω                                        for the rule "newmark"
    4 + T q₂,   4 + T q₁ + Ω q₂,   T + Ω q₁,   Ω,   with T = 2D + Ω,           for "backward_euler"

By Hurwitz's criterion all lie in Re s ≤ 0 if q₁ ≥ 0 and q₂ ≥ 0: for the second,
``(4 + T q₁ + Ω q₂)(T + Ω q₁) − (4 + T q₂) Ω = 8D + 4Ω q₁ + T² q₁ + TΩ q₁² + Ω² q₁ q₂ ≥ 0``. If q₂ < 0, some coefficient
is negative for large Ω or D; if q₁ < 0, the criterion fails for D = 0. So 2β ≥ γ ≥ 1/2 is necessary and
sufficient with either rule, and by the argument of `dacore.dynamics.scheme` for the coupled system too.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array
from dacore.dynamics.scheme import Scheme, State, StepRule
from dacore.errors import ShapeError, UnstableError

FirstOrder = Literal["backward_euler", "newmark"]


@dataclass(frozen=True)
class Newmark(Scheme):
    """A member of Newmark's family, and how first-order terms take their rate.

    Parameters
    ----------
    beta, gamma : float
        β = 1/4, γ = 1/2 is of second order and keeps energy; β = 1/2, γ = 1 is of first order and damps.
    first_order : {"backward_euler", "newmark"}
        Rate in the first-order terms C: (y₁ − y₀)/τ, or ẏ₁ of the update above, which is of second
        order for γ = 1/2 and lets a jump of y ring.

    Raises
    ------
    UnstableError
        Outside 2β ≥ γ ≥ 1/2, the region of unconditional stability.
    """

    carried: ClassVar[int] = 3
    beta: float = 0.5
    gamma: float = 1.0
    first_order: FirstOrder = "backward_euler"

    def __post_init__(self) -> None:
        if not np.isfinite([self.beta, self.gamma]).all():
            raise ShapeError(f"Newmark: got beta = {self.beta}, gamma = {self.gamma}, expected finite numbers")
        if self.first_order not in ("backward_euler", "newmark"):
            raise ShapeError(f"first_order: got {self.first_order!r}, expected 'backward_euler' or 'newmark'")
        if self.gamma < 0.5:
            raise UnstableError(
                f"Newmark: gamma >= 1/2 fails, gamma = {self.gamma:g} is {0.5 - self.gamma:g} too small; "
                "raise gamma to 1/2 or more"
            )
        if 2 * self.beta < self.gamma:
            raise UnstableError(
                f"Newmark: 2 beta >= gamma fails, 2 beta = {2 * self.beta:g} is {self.gamma - 2 * self.beta:g} below "
                f"gamma = {self.gamma:g}; raise beta to {self.gamma / 2:g} or more"
            )

    @property
    def label(self) -> str:
        """Names and numbers, for captions."""
        return f"β = {self.beta:g}, γ = {self.gamma:g}, {self.first_order.replace('_', ' ')}"

    def regular(self, step: float) -> StepRule:
        """Return the rule of a step of `step` seconds."""
        return StepRule(self.mass_factor(step), self.rate_factor(step))

    def rule(self, old: State, step: float) -> StepRule:
        """Return the same rule whatever came before."""
        return self.regular(step)

    def mass_factor(self, step: float) -> float:
        """Return a = 1/(βτ²), the factor of M in a step of `step` seconds."""
        return 1.0 / (self.beta * step**2)

    def rate_factor(self, step: float) -> float:
        """Return c, the factor of C in a step: 1/τ, or γ/(βτ) for the rule "newmark"."""
        return 1.0 / step if self.first_order == "backward_euler" else self.gamma / (self.beta * step)

    def mass_history(self, old: State, step: float) -> Array:
        """Return h (n_dofs, k) of ÿ₁ = a y₁ − h."""
        a = self.mass_factor(step)
        rest = (1 - 2 * self.beta) / (2 * self.beta)
        history = a * old.value + (a * step) * old.rate
        return history if rest == 0 else history + rest * old.acceleration

    def rate_history(self, old: State, step: float) -> Array:
        """Return g (n_dofs, k) of ẏ₁ = c y₁ − g in the first-order terms."""
        c = self.rate_factor(step)
        if self.first_order == "backward_euler":
            return np.asarray(c * old.value)
        ratio = self.gamma / self.beta
        return np.asarray(c * old.value + (ratio - 1) * old.rate + step * (ratio / 2 - 1) * old.acceleration)

    def advance(self, old: State, value: Array, step: float) -> State:
        """Return the state after a step that ended in `value` (n_dofs, k)."""
        acceleration = self.mass_factor(step) * value - self.mass_history(old, step)
        rate = old.rate + step * ((1 - self.gamma) * old.acceleration + self.gamma * acceleration)
        return State(value, rate, acceleration)

    def parts(self, old: State) -> tuple[Array, ...]:
        """Return y, ẏ and ÿ."""
        return old.value, old.rate, old.acceleration

    def joined(self, parts: tuple[Array, ...], step: float) -> State:
        """Return the state made of y, ẏ and ÿ."""
        value, rate, acceleration = parts
        return State(value, rate, acceleration)
