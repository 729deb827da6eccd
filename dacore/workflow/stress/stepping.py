"""Two families of time steps as they are printed, in extended precision, for the reference marches."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.newmark import Newmark
from dacore.workflow.stress.reference import Long

Plain: TypeAlias = Newmark | GeneralizedAlpha


@dataclass(frozen=True, eq=False)
class Known:
    """A state: y, ẏ, ÿ, and the second ẏ that generalised α carries (n_dofs,)."""

    value: Long
    rate: Long
    acceleration: Long
    slope: Long


@dataclass(frozen=True)
class Factors:
    """A step's equation is M (mass · y₁ + …) + C (rate · y₁ + …) + A (weight · y₁ + …) = F at its moment."""

    mass: np.longdouble
    rate: np.longdouble
    weight: np.longdouble


class Stepping(ABC):
    """The steps of one march, numbered from 0."""

    @abstractmethod
    def factors(self, k: int) -> Factors:
        """Factors of y₁ in step `k`."""

    @abstractmethod
    def history(self, known: Known, k: int) -> Known:
        """What of ÿ_*, ẏ_* and y_* does not depend on y₁; `slope` is not used."""

    @abstractmethod
    def advance(self, known: Known, new: Long, k: int) -> Known:
        """The state after a step that ended in y₁ = `new`."""


def stepping(scheme: Plain, step: np.longdouble, jump: bool) -> Stepping:
    """The steps of a scheme from rest; `jump` where loads are there at once."""
    return _Newmark(scheme, step) if isinstance(scheme, Newmark) else _Alpha(scheme.rho_inf, step, jump)


class _Newmark(Stepping):
    """Newmark (1959): ÿ₁ = (y₁ − y₀ − τẏ₀)/(βτ²) − (1 − 2β)/(2β) ÿ₀, ẏ₁ = ẏ₀ + τ((1 − γ)ÿ₀ + γÿ₁)."""

    def __init__(self, scheme: Newmark, step: np.longdouble) -> None:
        self._tau = step
        self._beta, self._gamma = np.longdouble(scheme.beta), np.longdouble(scheme.gamma)
        self._euler = scheme.first_order == "backward_euler"

    def factors(self, k: int) -> Factors:
        tau, beta = self._tau, self._beta
        rate = 1 / tau if self._euler else self._gamma / (beta * tau)
        return Factors(1 / (beta * tau**2), rate, np.longdouble(1))

    def history(self, known: Known, k: int) -> Known:
        tau, beta, gamma = self._tau, self._beta, self._gamma
        y, v, a = known.value, known.rate, known.acceleration
        old = -(y + tau * v) / (beta * tau**2) - (1 - 2 * beta) / (2 * beta) * a
        rate = -y / tau if self._euler else v + tau * ((1 - gamma) * a + gamma * old)
        return Known(0 * y, rate, old, rate)

    def advance(self, known: Known, new: Long, k: int) -> Known:
        tau, gamma = self._tau, self._gamma
        a = self.factors(k).mass * new + self.history(known, k).acceleration
        v = known.rate + tau * ((1 - gamma) * known.acceleration + gamma * a)
        return Known(new, v, a, v)


class _Alpha(Stepping):
    """Jansen, Whiting and Hulbert (2000) for x = y and x = v, with v_f = ẏ_f.

    x₁ = x₀ + τ(ẋ₀ + g(ẋ₁ − ẋ₀)), x_f = x₀ + α_f(x₁ − x₀), ẋ_f = ẋ₀ + α_m(ẋ₁ − ẋ₀), with α_m = (3 − ρ)/(2(1 + ρ)),
    α_f = 1/(1 + ρ), g = 1/2 + α_m − α_f. The first step after a jump is backward Euler's; a rate that was left
    at another moment than equal steps leave it is taken at that moment.
    """

    def __init__(self, rho: float, step: np.longdouble, jump: bool) -> None:
        self._tau = step
        rho_ = np.longdouble(rho)
        # How long before its state a rate holds, in steps.
        regular = (1 - rho_) / (2 * (1 + rho_))
        one, half = np.longdouble(1), np.longdouble(1) / 2

        def weights(before: np.longdouble) -> tuple[np.longdouble, np.longdouble, np.longdouble]:
            apart = 1 - regular + before
            return 1 / (1 + rho_), (1 / (1 + rho_) + before) / apart, (half + before) / apart

        if jump:
            self._first = [(one, one, one), weights(half)]
        else:
            self._first = [weights(0 * one)]
        self._later = ((1 / (1 + rho_)), (3 - rho_) / (2 * (1 + rho_)), half + regular)

    def _of(self, k: int) -> tuple[np.longdouble, np.longdouble, np.longdouble]:
        return self._first[k] if k < len(self._first) else self._later

    def factors(self, k: int) -> Factors:
        f, m, g = self._of(k)
        rate = m / (g * self._tau)
        return Factors(rate**2 / f, rate, f)

    def _rates(self, x: Long, slope: Long, k: int) -> Long:
        """ẋ_f without x₁'s part."""
        _, m, g = self._of(k)
        return np.asarray(-m / (g * self._tau) * x + (1 - m / g) * slope)

    def history(self, known: Known, k: int) -> Known:
        f, m, g = self._of(k)
        c = m / (g * self._tau)
        rate = self._rates(known.value, known.slope, k)
        # v₁ = v₀ + (ẏ_f − v₀)/α_f in v̇_f = c v₁ + ….
        second = c / f * rate + c * (1 - 1 / f) * known.rate + self._rates(known.rate, known.acceleration, k)
        return Known((1 - f) * known.value, rate, second, rate)

    def advance(self, known: Known, new: Long, k: int) -> Known:
        f, _, g = self._of(k)
        slope_f = self.factors(k).rate * new + self._rates(known.value, known.slope, k)
        v = known.rate + (slope_f - known.rate) / f

        def left(x0: Long, x1: Long, old: Long) -> Long:
            return np.asarray(old + ((x1 - x0) / self._tau - old) / g)

        return Known(
            new, v, left(known.rate, v, known.acceleration), left(known.value, new, known.slope)
        )  # fmt: skip
