"""Temperatures by formula, to verify models with.

Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2nd ed. (1959).
"""

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError


def biot_roots(biot: float, count: int) -> Array:
    """Positive roots (count,) of ζ tan ζ = Bi, one in each interval (kπ, kπ + π/2), by bisection to round-off."""
    if not 0 < biot < np.inf:
        raise ShapeError(f"Biot number: got {biot}, expected a positive number")
    low = np.pi * np.arange(count, dtype=np.float64)
    high, sign = low + np.pi / 2, np.where(np.arange(count) % 2, -1.0, 1.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = sign * (middle * np.sin(middle) - biot * np.cos(middle)) < 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def cooling_slab(x: Array, times: Array, thickness: float, diffusivity: float, biot: float, terms: int = 200) -> Array:
    """Temperature of a slab that was 1 everywhere and cools at x = L into surroundings at 0; insulated at x = 0.

    ``Σ 4 sin ζ/(2ζ + sin 2ζ) cos(ζ x/L) exp(−ζ² a t/L²)`` over the roots of ζ tan ζ = Bi (§3.11).

    Parameters
    ----------
    x : (n,) array [cm]
    times : (t,) array [s]
    thickness : float [cm]
        L.
    diffusivity : float [cm²/s]
        a = conductivity/capacity.
    biot : float
        Bi = h L/conductivity.
    terms : int
        Of the series.

    Returns
    -------
    (n, t) array
    """
    roots = biot_roots(biot, terms)
    sizes = 4 * np.sin(roots) / (2 * roots + np.sin(2 * roots))
    shapes = np.cos(np.outer(np.asarray(x) / thickness, roots))
    decays = np.exp(-np.outer(roots**2, diffusivity * np.asarray(times) / thickness**2))
    return np.asarray((shapes * sizes) @ decays)


def perfused_slab(
    x: Array, thickness: float, conductivity: float, perfusion: float, flux: float, blood: float = 0.0
) -> Array:
    """Steady temperature [K] of a perfused slab, T = `blood` at x = 0 and heated by a flux at x = L.

    ``blood + flux/(k m) sinh(m x)/cosh(m L)`` with m² = perfusion/k.

    Parameters
    ----------
    x : (n,) array [cm]
    thickness, conductivity : float [cm], [erg/(cm s K)]
    perfusion : float [erg/(cm³ s K)]
        Perfusion times the capacity of the blood.
    flux : float [erg/(cm² s)]
    blood : float [K]
    """
    m = np.sqrt(perfusion / conductivity)
    return np.asarray(blood + flux / (conductivity * m) * np.sinh(m * np.asarray(x)) / np.cosh(m * thickness))
