"""State and parameters together: the posterior of a model's parameters, and of the states that follow from them.

The prior is what the ranges of the parameters say. A background with a forward map (reduced training) is emulated
once (`dacore.estimators.posterior_emulator`); then a series takes milliseconds: its most probable parameters from
several starts, and either the Gaussian about them or a few thousand weighted points. The estimate of the state is the
posterior's mean, which has the least mean-square error of all estimates.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import (
    Estimate,
    Estimator,
    ParameterEstimate,
    PreparedEstimator,
    Uncertainty,
    check_data,
    check_mask,
    check_scale,
    observed_steps,
)
from dacore.core.misfit import Misfit
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.errors import ShapeError
from dacore.estimators.plausible import Plausibility
from dacore.estimators.posterior_data import Compressed, Observed
from dacore.estimators.posterior_emulator import Emulator, emulate, forward_of, packed, unpacked
from dacore.estimators.posterior_errors import model_errors
from dacore.estimators.posterior_modes import Gaussian, ended, search, starts
from dacore.estimators.posterior_moments import moments
from dacore.estimators.posterior_sampling import Cloud, sample, uniform_points
from dacore.estimators.posterior_uncertainty import ForwardErrors, LaplaceUncertainty, SampledUncertainty

logger = logging.getLogger(__name__)

# Series at a time: their derivatives take some tens of MB.
_CHUNK = 256
# What directions of the data left out may hold of the training set's squared distances, in units of noise.
_UNSEEN = 1e-3
# Fewer effective points are worth a warning.
_FEW = 50
# Places in the box that may be starts, and how many times as many starts a series gets that nothing fits.
_PLACES, _AGAIN = 1024, 8
# Parts of the training set that are left out in turn.
_FOLDS = 4


@dataclass(frozen=True)
class Posterior(Estimator):
    """Settings of the estimate of state and parameters.

    Parameters
    ----------
    posterior : {"sampled", "laplace"}
        Mean and quantiles of weighted points, right for posteriors of any shape; or the Gaussian about the most
        probable parameters, many times faster and as good where data determine all parameters well.
    points : int
        Weighted points of a series.
    starts : int
        Places from which the most probable parameters are sought, the best of the training samples and of a
        thousand others; more where none leads to parameters that fit.
    tolerance : float
        Where the emulation of the forward map stops: the largest term that may be left, relative to what the
        training set varies.
    solves : int
        Nodes of the emulation at most; each takes one trajectory of the forward map, and one more for each
        parameter that trajectories are affine in.
    """

    needs_forward: ClassVar[bool] = True

    posterior: Literal["sampled", "laplace"] = "sampled"
    points: int = 2048
    starts: int = 4
    tolerance: float = 3e-3
    solves: int = 1000

    def __post_init__(self) -> None:
        for name, least in (("points", 64), ("starts", 1), ("solves", 1)):
            if getattr(self, name) < least:
                raise ShapeError(f"{name}: got {getattr(self, name)}, expected at least {least}")
        if not 0 < self.tolerance < 1:
            raise ShapeError(f"tolerance: got {self.tolerance}, expected a number between 0 and 1")

    def groundwork(self) -> dict[str, Any]:
        """Settings of the emulation, which is of the background alone."""
        return {"tolerance": self.tolerance, "solves": self.solves}

    def pack(self, background: Background) -> tuple[dict[str, Any], dict[str, Any]]:
        """Emulate the forward map."""
        return packed(emulate(background, self.tolerance, self.solves))

    def unpack(self, arrays: Mapping[str, Array], facts: Mapping[str, Any], background: Background) -> None:
        """Take an emulation as done."""
        unpacked(arrays, facts, background, self.tolerance, self.solves)

    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> "PreparedPosterior":
        """Emulate the forward map and compress what is measured of it."""
        chosen = observed_steps(background, steps)
        emulator = emulate(background, self.tolerance, self.solves)
        return PreparedPosterior(self, background, functionals, noise, chosen, emulator)


@dataclass(frozen=True, eq=False)
class _Modes:
    """Most probable coordinates of k series, and those that compete with them."""

    x: Array
    covariance: Array
    parts: list[list[tuple[Array, Array, float]]]


class PreparedPosterior(PreparedEstimator):
    """The posterior with everything done that does not depend on data."""

    def __init__(
        self,
        settings: Posterior,
        background: Background,
        functionals: Functionals,
        noise: NoiseModel,
        steps: IntArray,
        emulator: Emulator,
        mask: BoolArray | None = None,
    ) -> None:
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps, self.emulator = steps, emulator
        keep = np.ones(functionals.count, dtype=bool) if mask is None else mask
        self.observed = Observed(emulator, background, functionals, noise, steps, keep)
        self.coordinates = emulator.coordinates
        self.prior = Gaussian(*self.coordinates.prior_of_coordinates)
        anywhere = 2.0 * uniform_points(_PLACES, len(self.coordinates.free)) - 1.0
        self.places = np.concatenate([np.clip(emulator.training, -1.0, 1.0), anywhere])
        self.errors = ForwardErrors(emulator, model_errors(emulator, background))
        self.inflation = self._inflation()
        self.observed.errors *= self.inflation
        seen = background.observe(functionals.matrix)[keep]
        self._plausibility = Plausibility(seen, background.coefficients[:, steps], self.observed.noise)

    def _inflation(self) -> float:
        """Factor on the covariance of the map's own errors, so that exact data of unseen samples give them back.

        Training samples are left out fold by fold; where the covariance that the others tell is too small in some
        direction, exact data of those would be trusted most just there.
        """
        observed = self.observed
        count = observed.misses.shape[1]
        chosen = np.arange(0, count, max(count // _CHUNK, 1))
        places = np.clip(self.emulator.training[chosen], -1.0, 1.0)
        data = self.emulator.values(places, observed.blocks) - observed.misses[:, chosen].T
        squares: list[Array] = []
        for fold in range(min(_FOLDS, len(chosen))):
            mine = np.arange(fold, len(chosen), _FOLDS)
            variances, turn = np.linalg.eigh(observed.without(chosen[mine]))
            # None is smaller than round-off, which the smallest of the errors is.
            root = np.sqrt(np.maximum(variances, observed.errors.min()))
            blocks, wanted = observed.blocks @ (turn / root), data[mine] @ (turn / root)

            def residuals(
                x: Array, rows: IntArray, blocks: Array = blocks, wanted: Array = wanted
            ) -> tuple[Array, Array]:
                value, slopes = self.emulator.slopes(x, blocks)
                return value - wanted[rows], slopes

            x, _, precision = search(residuals, self.prior, places[mine])
            away = x - places[mine]
            squares.append(np.einsum("kp,kpq,kq->k", away, precision, away, optimize=True) / away.shape[1])
        return max(float(np.concatenate(squares).mean()), 1.0) if squares else 1.0

    @property
    def inf_sup(self) -> Array:
        """NaN (t,): the prior, not a stability constant, bounds the error."""
        return np.full(len(self.steps), np.nan)

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate parameters, and states at all times of the background, observed or not."""
        flags = check_mask(mask, self.functionals.count)
        raw = check_data(data, self.functionals.count, len(self.steps), flags)
        k = raw.shape[2]
        scale = check_scale(noise_scale, k)
        if flags is not None:
            again = PreparedPosterior(
                self.settings, self.background, self.functionals, self.noise, self.steps, self.emulator, flags
            )
            return again.estimate(raw, scale)
        self._plausibility.check(raw[self.observed.keep], scale)
        compressed = self.observed.compress(raw)
        p, q = len(self.coordinates.free), self.emulator.q
        states = np.empty((q, k))
        found = _Found(np.empty((k, p)), np.empty((k, p, p)), np.empty(k), [], [])
        several = 0
        for first in range(0, k, _CHUNK):
            part = slice(first, min(first + _CHUNK, k))
            several += self._estimate(compressed, scale, part, states, found)
        if several:
            logger.warning(
                "posterior: %d of %d series have more than one set of parameters that fits; read quantiles, not "
                "deviations", several, k,
            )  # fmt: skip
        statistic = found.statistic + compressed.rest / (scale**2 + self.observed.outside)
        parameters = ParameterEstimate(self.coordinates.names, found.values.T, found.covariance, self.coordinates.prior)
        learned = np.clip(parameters.learned, 0.0, 1.0).sum(axis=0)
        return Estimate(
            self.background,
            np.arange(len(self.background.times)),
            self.emulator.lift(states),
            uncertainty=self._uncertainty(found),
            # What nothing is learned of takes no freedom from the data.
            misfit=Misfit(statistic, np.maximum(self.observed.count - learned, 1.0)),
            parameters=parameters,
        )

    def log_posterior(self, data: Array, noise_scale: float, exact: bool = False) -> Callable[[Array], Array]:
        """Logarithm (n,) of the posterior's density at coordinates (n, p), up to a constant.

        Parameters
        ----------
        data : (m, t, 1) array
            Of one series.
        noise_scale : float
        exact : bool
            Ask the forward map itself, not its emulation.
        """
        raw = check_data(data, self.functionals.count, len(self.steps))
        values = self.observed.compress(raw).values[0]
        variance = self.observed.variance(check_scale(noise_scale, 1))[0]
        if not exact:
            return self._log_density(values, variance, self.observed.blocks)
        forward = forward_of(self.background)

        def log_density(x: Array) -> Array:
            out = self.coordinates.log_prior(x)
            inside = np.isfinite(out)
            if inside.any():
                made = self.observed.of_trajectories(forward.coefficients(self.coordinates.points(x[inside])))
                out[inside] -= 0.5 * ((made - values) ** 2 / variance).sum(axis=1)
            return out

        return log_density

    def _log_density(self, values: Array, variance: Array, blocks: Array) -> Callable[[Array], Array]:
        root = np.sqrt(variance)
        scaled, mine = blocks / root, values / root

        def log_density(x: Array) -> Array:
            misses = self.emulator.values(x, scaled) - mine
            return np.asarray(self.coordinates.log_prior(x) - 0.5 * np.einsum("kd,kd->k", misses, misses))

        return log_density

    def _uncertainty(self, found: "_Found") -> Uncertainty:
        p, q = len(self.coordinates.free), self.emulator.q
        if self.settings.posterior == "laplace":
            return LaplaceUncertainty(self.errors, np.concatenate([np.zeros((0, q, p)), *found.anomalies]))
        points = [cloud.points for cloud in found.clouds]
        weights = [cloud.weights for cloud in found.clouds]
        n = self.settings.points
        return SampledUncertainty(
            self.errors, np.array(points).reshape(-1, n, p), np.array(weights).reshape(-1, n)
        )  # fmt: skip

    def _estimate(self, compressed: Compressed, scale: Array, part: slice, states: Array, found: "_Found") -> int:
        """Fill in what is found of some series; returns how many have several modes."""
        variance = self.observed.variance(scale[part])
        values = compressed.values[part]
        use, left = self._directions(values, variance)
        variance = np.where(use, variance, np.inf)
        some = use.any(axis=0)
        values, variance, blocks = values[:, some], variance[:, some], self.observed.blocks[:, :, some]
        modes = self._modes(values, variance, blocks)
        best = self.emulator.values(modes.x, blocks)
        found.statistic[part] = ((values - best) ** 2 / variance).sum(axis=1) + left
        if self.settings.posterior == "laplace":
            self._laplace(modes, part, states, found)
        else:
            self._sample(modes, values, variance, blocks, part, states, found)
        return sum(len(parts) > 1 for parts in modes.parts)

    def _directions(self, values: Array, variance: Array) -> tuple[BoolArray, Array]:
        """Compressed directions (k, d) that tell parameters apart, and the squares (k,) of what is left of the others.

        Series by series, so that no estimate depends on what else is estimated with it.
        """
        training = self.observed.training
        mean = training.mean(axis=0)
        told = ((training - mean) ** 2).max(axis=0) / variance
        order = told.argsort(axis=1)
        use = np.empty(told.shape, dtype=bool)
        small = np.cumsum(np.take_along_axis(told, order, axis=1), axis=1) <= _UNSEEN
        np.put_along_axis(use, order, ~small, axis=1)
        left = np.where(use, 0.0, (values - mean) ** 2 / variance).sum(axis=1)
        return use, left

    def _modes(self, values: Array, variance: Array, blocks: Array) -> _Modes:
        k, p, count = len(values), len(self.coordinates.free), self.settings.starts
        expected = self.emulator.values(self.places, blocks)
        ends = [ended(*each) for each in zip(*self._search(values, variance, blocks, expected, count), strict=True)]
        # Twice the best cost is a sum of squares; what nothing fits may have a better mode elsewhere, and where two
        # modes fit there may be more than so few starts can find.
        used = np.isfinite(variance).sum(axis=1)
        most = used + p + 5.0 * np.sqrt(2.0 * used)
        doubtful = [j for j, end in enumerate(ends) if 2 * end.cost > most[j] or len(end.parts) > 1]
        if doubtful:
            more = self._search(values[doubtful], variance[doubtful], blocks, expected, _AGAIN * count)
            for j, again in zip(doubtful, zip(*more, strict=True), strict=True):
                ends[j] = ended(*again)
        x, covariance = np.empty((k, p)), np.empty((k, p, p))
        for j, end in enumerate(ends):
            x[j], covariance[j] = end.x, end.covariance
        return _Modes(x, covariance, [end.parts for end in ends])

    def _search(
        self, values: Array, variance: Array, blocks: Array, expected: Array, count: int
    ) -> tuple[Array, Array, Array]:
        """Ends (k, count, p) of searches from `count` starts, their costs (k, count) and precisions."""
        k, p = len(values), len(self.coordinates.free)
        begin = starts(values, variance, expected, self.places, count).reshape(-1, p)
        root, owner = np.sqrt(variance), np.repeat(np.arange(k), count)

        def residuals(x: Array, rows: IntArray) -> tuple[Array, Array]:
            value, slopes = self.emulator.slopes(x, blocks)
            mine = root[owner[rows]]
            return (value - values[owner[rows]]) / mine, slopes / mine[:, :, None]

        x, cost, precision = search(residuals, self.prior, begin)
        return x.reshape(k, count, p), cost.reshape(k, count), precision.reshape(k, count, p, p)

    def _laplace(self, modes: _Modes, part: slice, states: Array, found: "_Found") -> None:
        value, slopes = self.emulator.slopes(modes.x, self.emulator.blocks())
        states[:, part] = value.T
        root = np.linalg.cholesky(modes.covariance)
        found.anomalies.append(slopes @ root)
        found.values[part], found.covariance[part] = moments(self.coordinates, modes.x, modes.covariance)

    def _sample(
        self, modes: _Modes, values: Array, variance: Array, blocks: Array, part: slice, states: Array, found: "_Found"
    ) -> None:
        emulator, coordinates = self.emulator, self.coordinates
        every = emulator.blocks()
        poor = 0
        for series, (value, spread, parts) in enumerate(zip(values, variance, modes.parts, strict=True), part.start):
            log_density = self._log_density(value, spread, blocks)
            cloud = sample(log_density, parts, self.settings.points)
            poor += cloud.effective < _FEW
            states[:, series] = emulator.mean_values(cloud.points, cloud.weights, every)
            physical = Cloud(coordinates.values(cloud.points), cloud.weights)
            found.values[series], found.covariance[series] = physical.moments
            found.clouds.append(cloud)
        if poor:
            logger.warning(
                "posterior: %d of %d series have fewer than %d effective points; raise points", poor, len(values), _FEW
            )


@dataclass(frozen=True, eq=False)
class _Found:
    """Parameters of k series, their covariances, misfits, and what the uncertainty of states is made of."""

    values: Array
    covariance: Array
    statistic: Array
    anomalies: list[Array]
    clouds: list[Cloud]
