"""How well anything could do: posterior means by a well-kept sampler, and local bounds by Fisher information.

The mean of the posterior has the least mean-square error of all estimates that know model, prior and noise. What an
estimator's error is worth is its ratio to that one's on the same data.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import emcee
import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.core.estimator import Estimate, ParameterEstimate, check_scale
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.estimators.posterior import PreparedPosterior
from dacore.estimators.posterior_information import fisher
from dacore.estimators.posterior_sampling import Cloud
from dacore.estimators.posterior_uncertainty import SampledUncertainty


@dataclass(frozen=True)
class Chain:
    """Settings of the affine-invariant ensemble sampler (Goodman and Weare 2010, by emcee).

    Parameters
    ----------
    walkers : int
        At least twice the number of parameters, and even.
    steps, discard, thin : int
        Steps of each walker, how many of the first are left out, and each how-manyth of the others is kept.
    density : {"emulated", "exact"}
        Evaluate the emulated forward map, or the map itself at every step of every walker.
    """

    walkers: int = 64
    steps: int = 2000
    discard: int = 500
    thin: int = 10
    density: Literal["emulated", "exact"] = "emulated"

    def __post_init__(self) -> None:
        if self.walkers < 4 or self.walkers % 2:
            raise ShapeError(f"walkers: got {self.walkers}, expected an even number of at least 4")
        if not 0 <= self.discard < self.steps or not 1 <= self.thin <= self.steps - self.discard:
            raise ShapeError(
                f"chain: got {self.steps} steps, {self.discard} left out and each {self.thin}th kept, expected some"
            )


def posterior_by_chain(
    prepared: PreparedPosterior, data: Array, noise_scale: Array | float, seed: int, chain: Chain | None = None
) -> Estimate:
    """Sample the posterior of each series with many walkers; an estimate like any other, and far slower.

    Parameters
    ----------
    prepared : PreparedPosterior
        Its own estimate gives the walkers their starts.
    data : (m, t, k) array
    noise_scale : float or (k,) array
    seed : int
    chain : Chain, optional

    Returns
    -------
    Estimate
        With the mean of the states over the chain, and its points as uncertainty.
    """
    settings = chain or Chain()
    k, coordinates, emulator = data.shape[2], prepared.coordinates, prepared.emulator
    p = len(coordinates.free)
    if settings.walkers < 2 * p:
        raise ShapeError(f"walkers: got {settings.walkers}, expected at least {2 * p} for {p} parameters")
    scale = check_scale(noise_scale, k)
    first = prepared.estimate(data, scale)
    begin = coordinates.of_points(_vectors(prepared, first))
    rng = np.random.default_rng(seed)
    points, states, values = [], np.empty((emulator.q, k)), np.empty((p, k))
    covariance = np.empty((k, p, p))
    found = first.parameters
    spread = found.deviation if found is not None else np.ones((p, k))
    for series in range(k):
        one, exact = data[:, :, [series]], settings.density == "exact"
        density = prepared.log_posterior(one, float(scale[series]), exact)
        width = np.minimum(spread[:, series] / coordinates.slopes(begin[series]), 0.5)
        start = _reflected(begin[series] + width * rng.standard_normal((settings.walkers, p)))
        sampler = emcee.EnsembleSampler(settings.walkers, p, density, vectorize=True)
        sampler.random_state = _state(rng)
        sampler.run_mcmc(start, settings.steps)
        kept = sampler.get_chain(discard=settings.discard, thin=settings.thin, flat=True)
        cloud = Cloud(kept, np.full(len(kept), 1.0 / len(kept)))
        states[:, series] = emulator.mean_values(kept, cloud.weights, emulator.blocks())
        values[:, series], covariance[series] = Cloud(coordinates.values(kept), cloud.weights).moments
        points.append(kept)
    every = np.array(points).reshape(k, -1, p)
    return Estimate(
        prepared.background,
        first.steps,
        emulator.lift(states),
        uncertainty=SampledUncertainty(prepared.errors, every, np.full(every.shape[:2], 1.0 / max(every.shape[1], 1))),
        parameters=ParameterEstimate(coordinates.names, values, covariance, coordinates.prior),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Displayed):
    """What can be known of unseen cases.

    Parameters
    ----------
    posterior : Estimate
        By the chain.
    errors : mapping of str to (s, k) array
        Of the posterior's mean, for each quantity.
    bounds : mapping of str to (s, k) array
        Local deviations of each quantity by Fisher information and prior, at the true parameters.
    parameters : (p, k) array
        Local deviations of the parameters.
    unseen : tuple of (u, p) arrays
        Directions of parameters, in units of their prior, that the data do not see, case by case.
    """

    posterior: Estimate
    errors: Mapping[str, Array]
    bounds: Mapping[str, Array]
    parameters: Array
    unseen: tuple[Array, ...]

    def rms(self, name: str) -> float:
        """Root mean square of the errors of a quantity's posterior mean."""
        return float(np.sqrt((self.errors[name] ** 2).mean()))


def limits(
    prepared: PreparedPosterior,
    data: Array,
    noise_scale: Array | float,
    points: Array,
    quantities: Mapping[str, QuantityOfInterest],
    truth: Mapping[str, Array],
    seed: int,
    chain: Chain | None = None,
    share: float = 0.1,
) -> Limits:
    """Find what can be known of unseen cases from their data.

    Parameters
    ----------
    prepared : PreparedPosterior
    data : (m, t, k) array
    noise_scale : float or (k,) array
        Positive.
    points : (k, n_parameters) array
        True parameters of the cases.
    quantities : mapping of str to QuantityOfInterest
    truth : mapping of str to (s, k) array
        True values of the quantities.
    seed : int
    chain : Chain, optional
    share : float
        Part of the prior's variance that must be learned of a direction for it to be seen.
    """
    posterior = posterior_by_chain(prepared, data, noise_scale, seed, chain)
    local = fisher(prepared.background, prepared.functionals, prepared.noise, points, noise_scale, prepared.steps)
    return Limits(
        posterior,
        {name: posterior.quantity(quantity) - truth[name] for name, quantity in quantities.items()},
        {name: local.quantity_deviations(quantity) for name, quantity in quantities.items()},
        local.deviations(),
        tuple(local.unseen(share)),
    )


def _vectors(prepared: PreparedPosterior, estimate: Estimate) -> Array:
    fixed = np.array([p.low for p in prepared.background.parameters.parameters], dtype=np.float64)
    out = np.tile(fixed, (estimate.n_series, 1))
    if estimate.parameters is not None:
        out[:, prepared.coordinates.free] = estimate.parameters.values.T
    return out


def _reflected(x: Array) -> Array:
    """Fold points at the faces of the cube back into it."""
    return np.asarray(1.0 - np.abs(np.mod(x + 1.0, 4.0) - 2.0))


def _state(rng: np.random.Generator) -> object:
    """State of the kind emcee draws from, seeded by a generator."""
    seed = int(rng.integers(2**32, dtype=np.uint64))
    return np.random.RandomState(np.random.MT19937(seed)).get_state()
