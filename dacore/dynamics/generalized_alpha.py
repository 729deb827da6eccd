"""The generalised-α scheme for M ÿ + C ẏ + A y = F as one system of first order.

With v = ẏ the equations are ``ẏ = v, M v̇ + C ẏ + A y = F``, and every variable x of (y, v) takes the step of
Jansen, Whiting and Hulbert (2000), as Kadapa, Dettmer and Perić (2017) do for structures::

    x_f = (1 − w) x₀ + w x₁          where values are taken, w = 1/(1 + ρ)
    ẋ_f = ẋ₀ + ω (ẋ₁ − ẋ₀)           where rates are taken

and ``v_f = ẏ_f``, ``M v̇_f + C ẏ_f + A y_f = F_f``. ρ is the factor per step of what is infinitely stiff: ρ = 1 is the
midpoint rule, which keeps energy; ρ = 0 is the backward differentiation formula BDF2. u and p are of second
order for every ρ. Here σ₂ = σ₁², and σ₁ has a positive real part outside the unit circle, so that the coupled system
is stable for every step and parameter (`dacore.dynamics.scheme`). Chung and Hulbert's scheme for M beside this one
for C is of second order too, but takes swelling and storage by different rules (docs/adr/0010).

In the energy ‖·‖ of (u, v, p), equal steps without loads lose exactly, with s = (1 − ρ)/(2 (1 + ρ)) and q the seepage::

    ½(‖x₁‖² + ‖x₁ + 2sτẋ₁‖²) = ½(‖x₀‖² + ‖x₀ + 2sτẋ₀‖²) − 2τ q(p_f) − 4s³ ‖τ(ẋ₁ − ẋ₀)‖²

The rate ẋ₀ that a step leaves behind does not belong to t₀ but to t₀ − s₀, with ``s₀ = τ₀ (1 − ρ)/(2 (1 + ρ))`` after
a step τ₀. Interpolating linearly between the moments of ẋ₀ and ẋ₁, with s₁ = τ (1 − ρ)/(2 (1 + ρ))::

    ω = (w τ + s₀)/(τ − s₁ + s₀)         x₁ = x₀ + τ (ẋ₀ + (τ/2 + s₀)/(τ − s₁ + s₀) (ẋ₁ − ẋ₀))

keeps the second order when the step changes; equal steps give the published weights. Eliminated::

    ẋ_f = c (x_f − x₀) − e ẋ₀,    c = (w τ + s₀)/(w τ (τ/2 + s₀)),    e = c w τ − 1

A start whose rates are not known, after a jump, begins with one step of backward Euler: w = 1, s₀ → ∞, which
leaves its rate in the middle of the step, s₁ = τ/2.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dacore.core.arrays import Array
from dacore.dynamics.scheme import Scheme, State, StepRule
from dacore.errors import ShapeError, UnstableError


@dataclass(frozen=True)
class GeneralizedAlpha(Scheme):
    """Second order in u and p, with damping of what the steps do not resolve.

    Parameters
    ----------
    rho_inf : float
        ρ, what a step leaves of the highest frequencies: from 0 (gone at once) to 1 (kept).

    Raises
    ------
    UnstableError
        Outside 0 ≤ ρ ≤ 1.
    """

    carried: ClassVar[int] = 4
    rho_inf: float = 0.5

    def __post_init__(self) -> None:
        if not np.isfinite(self.rho_inf):
            raise ShapeError(f"generalized_alpha: got rho_inf = {self.rho_inf}, expected a finite number")
        if not 0 <= self.rho_inf <= 1:
            raise UnstableError(
                f"generalized_alpha: 0 <= rho_inf <= 1 fails, rho_inf = {self.rho_inf:g}; it is the factor per step of "
                "the highest frequencies, which must not grow"
            )

    @property
    def label(self) -> str:
        """Name and number, for captions."""
        return f"generalised α, ρ∞ = {self.rho_inf:g}"

    def regular(self, step: float) -> StepRule:
        """Return the rule of a step among equal ones."""
        return self._rule(self._new_lag(step), step)

    def rule(self, old: State, step: float) -> StepRule:
        """Return the rule of a step after `old`: backward Euler where its rates are not known."""
        return self._rule(old.lag, step)

    def mass_history(self, old: State, step: float) -> Array:
        """Return h = c (g + v₀) + e v̇₀."""
        c, e = self._factors(old.lag, step)
        history = c * (self.rate_history(old, step) + old.rate)
        return history if e == 0 else history + e * old.acceleration

    def rate_history(self, old: State, step: float) -> Array:
        """Return g = c y₀ + e ẏ₀."""
        c, e = self._factors(old.lag, step)
        history = np.asarray(c * old.value)
        return history if e == 0 else history + e * self._slope(old)

    def advance(self, old: State, value: Array, step: float) -> State:
        """Return the state after a step that found y_f = `value`."""
        c, e = self._factors(old.lag, step)
        w, lag = self._weight(old.lag), self._lag_after(old.lag, step)
        slope = c * (value - old.value)
        if e:
            slope -= e * self._slope(old)
        acceleration = c * (slope - old.rate)
        if e:
            acceleration -= e * old.acceleration
        new_value = value if w == 1 else old.value + (value - old.value) / w
        rate = slope if w == 1 else old.rate + (slope - old.rate) / w
        if np.isfinite(old.lag):
            omega = (w * step + old.lag) / (step - lag + old.lag)
            acceleration = old.acceleration + (acceleration - old.acceleration) / omega
            slope = self._slope(old) + (slope - self._slope(old)) / omega
        return State(new_value, rate, acceleration, slope, lag)

    def parts(self, old: State) -> tuple[Array, ...]:
        """Return y, v, v̇ and ẏ."""
        return old.value, old.rate, old.acceleration, self._slope(old)

    def joined(self, parts: tuple[Array, ...], step: float) -> State:
        """Return the state made of y, v, v̇ and ẏ, after steps of `step` seconds."""
        value, rate, acceleration, slope = parts
        return State(value, rate, acceleration, slope, self._new_lag(step))

    def _slope(self, old: State) -> Array:
        return old.rate if old.slope is None else old.slope

    def _new_lag(self, step: float) -> float:
        return step * (1 - self.rho_inf) / (2 * (1 + self.rho_inf))

    def _lag_after(self, lag: float, step: float) -> float:
        return self._new_lag(step) if np.isfinite(lag) else step / 2

    def _weight(self, lag: float) -> float:
        return 1 / (1 + self.rho_inf) if np.isfinite(lag) else 1.0

    def _factors(self, lag: float, step: float) -> tuple[float, float]:
        """Return c and e of ẋ_f = c (x_f − x₀) − e ẋ₀."""
        if not np.isfinite(lag):
            return 1 / step, 0.0
        w = self._weight(lag)
        middle = step / 2 + lag
        return (w * step + lag) / (w * step * middle), (w - 0.5) * step / middle

    def _rule(self, lag: float, step: float) -> StepRule:
        c, _ = self._factors(lag, step)
        return StepRule(c**2, c, self._weight(lag))
