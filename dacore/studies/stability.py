"""Where time schemes are stable: spectral radii over their numbers and over modes of every kind.

The smallest coupled systems, ``m ü + k u − b p = 0`` with ``S ṗ + b u̇ + κ p = 0``, hold every factor by which a
step can multiply a motion of the whole system (`dacore.dynamics.scheme`). Only the products kτ²/m, bτ/√m …
matter, so modes with numbers over many decades stand for all steps, permeabilities, storages and meshes.
"""

from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np

from dacore.core.arrays import Array, BoolArray
from dacore.core.display import Displayed
from dacore.dynamics.amplification import mode_radii
from dacore.dynamics.newmark import FirstOrder, Newmark
from dacore.dynamics.scheme import Scheme

STABLE = 1 + 1e-6
"""Largest radius that counts as stable: eigenvalues on the unit circle are found to some 1e-8."""


class UncheckedNewmark(Newmark):
    """Newmark's step without the check of its numbers, to show what the check refuses."""

    def __post_init__(self) -> None:
        """Accept anything."""


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Displayed):
    """Smallest coupled systems.

    Parameters
    ----------
    mass, stiffness, coupling, storage, mobility : (n,) arrays
        m, k, b, S and κ, in units in which the step is 1.
    """

    mass: Array
    stiffness: Array
    coupling: Array
    storage: Array
    mobility: Array

    @classmethod
    def extreme(cls, decades: float = 6.0, levels: int = 7) -> Self:
        """Return a grid over ±`decades` of each number, with S = 0, κ = 0 and no coupling among the values.

        Parameters
        ----------
        decades : float
        levels : int
            Values of each number between the ends.
        """
        sizes = np.logspace(-decades, decades, levels)
        some = (0.0, *sizes)
        rows = [
            (1.0, k, b, s, q) for k, b, s, q in product(sizes, some, some, some) if s > 0 or q > 0
        ]  # a pressure that nothing determines is no system
        return cls(*np.array(rows).T)

    def radii(self, scheme: Scheme, step: float = 1.0) -> Array:
        """Return the spectral radius (n,) of a step of each system."""
        return mode_radii(scheme, step, self.mass, self.stiffness, self.coupling, self.storage, self.mobility)


@dataclass(frozen=True, eq=False, repr=False)
class StabilityMap(Displayed):
    """Largest spectral radius over modes, for each β and γ of Newmark's family.

    Parameters
    ----------
    betas, gammas : (b,), (g,) arrays
    first_order : {"backward_euler", "newmark"}
    radii : (b, g) array
    """

    betas: Array
    gammas: Array
    first_order: FirstOrder
    radii: Array

    @property
    def stable(self) -> BoolArray:
        """Whether no mode grows (b, g)."""
        return np.asarray(self.radii <= STABLE)

    @property
    def admitted(self) -> BoolArray:
        """Whether 2β ≥ γ ≥ 1/2 (b, g), to round-off of the grid."""
        return np.asarray((2 * self.betas[:, None] >= self.gammas - 1e-12) & (self.gammas >= 0.5 - 1e-12))


def newmark_map(betas: Array, gammas: Array, first_order: FirstOrder, modes: Modes) -> StabilityMap:
    """Measure Newmark's family.

    Parameters
    ----------
    betas, gammas : (b,), (g,) arrays
    first_order : {"backward_euler", "newmark"}
    modes : Modes

    Returns
    -------
    StabilityMap
    """
    radii = np.array(
        [
            [modes.radii(UncheckedNewmark(float(beta), float(gamma), first_order)).max() for gamma in gammas]
            for beta in betas
        ]
    )
    return StabilityMap(betas, gammas, first_order, radii)


def oscillator_radii(scheme: Scheme, frequencies: Array, damping: float = 0.0) -> Array:
    """Spectral radii (n,) of a step of 1 for ``ẍ + damping ω ẋ + ω² x = 0``, ω of `frequencies` (n,)."""
    parts, rule = scheme.carried, scheme.regular(1.0)
    omega = np.repeat(frequencies, parts)
    old = scheme.joined(tuple(np.tile(np.eye(parts)[:, None, :], len(frequencies))), 1.0)
    right = scheme.mass_history(old, 1.0) + damping * omega * scheme.rate_history(old, 1.0)
    value = right / (rule.mass_factor + damping * omega * rule.rate_factor + omega**2)
    new = np.stack(scheme.parts(scheme.advance(old, value, 1.0)))
    steps = new.reshape(parts, len(frequencies), parts).transpose(1, 0, 2)
    return np.asarray(np.abs(np.linalg.eigvals(steps)).max(axis=1))
