"""Measurements that leave the least variance of numbers of interest.

The unknown is standardised, ω ~ N(0, I), and data are linear in it: with the factors F_g (whitened data of candidate
g, rows by unknowns) the posterior covariance is (I + Σ_g F_gᵀF_g)⁻¹. Two such models: the training set's anomalies,
as minimum variance uses them, and the parameters near several of their values, as a nonlinear estimate can use them
at best (Fisher information). Noise has one standard deviation, whatever is chosen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from dacore.algebra.svd import thin_svd
from dacore.core.arrays import Array
from dacore.core.background import Background, ParametricMap
from dacore.core.display import Displayed
from dacore.core.estimator import Estimate
from dacore.core.observation import Functionals
from dacore.core.parameters import Parameter
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError
from dacore.studies.placement import Candidates, Criterion, check_candidates

# Information of a direction, in units of the prior's, that changes no posterior.
_NOTHING = 1e-10
# Finite difference, in standard deviations of a parameter.
_STEP = 1e-2


@dataclass(frozen=True, eq=False, repr=False)
class LocalModel(Displayed):
    """Data and targets that are linear in a standardised unknown of dimension d.

    Parameters
    ----------
    factors : g arrays (rows, d)
        Whitened data of each candidate.
    targets : (s, d) array
        Numbers of interest.
    """

    factors: tuple[Array, ...]
    targets: Array


@dataclass(frozen=True, eq=False, repr=False)
class Known(Displayed):
    """What the chosen say: information and covariance (d, d) of the unknown, model by model."""

    information: tuple[Array, ...]
    covariance: tuple[Array, ...]


class PosteriorDeviation(Criterion[Known]):
    """Root mean square, over targets and models, of posterior over prior standard deviation: 1 before any data.

    Parameters
    ----------
    models : sequence of LocalModel
        With the same candidates and the same targets.
    """

    larger_is_better = False

    def __init__(self, models: Sequence[LocalModel]) -> None:
        if not models or not models[0].factors or len({(len(m.factors), len(m.targets)) for m in models}) > 1:
            raise ShapeError("placement: expected at least one model, all of the same candidates and targets")
        for model in models:
            if any(factor.ndim != 2 or factor.shape[1] != model.targets.shape[1] for factor in model.factors):
                raise ShapeError(f"factors: expected matrices with {model.targets.shape[1]} columns, as the targets")
            if not (np.linalg.norm(model.targets, axis=1) > 0).all():
                raise ShapeError("targets: one of them does not vary, so there is nothing to find out")
        self._models = [LocalModel(tuple(_condensed(f) for f in m.factors), m.targets) for m in models]
        self._prior = [(model.targets**2).sum(axis=1) for model in models]

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self._models[0].factors)

    @property
    def prior(self) -> Array:
        """Standard deviation (s,) of each target before any data, root mean square over the models."""
        return np.asarray(np.sqrt(np.mean(self._prior, axis=0)))

    def nothing(self) -> Known:
        """Nothing but the prior."""
        sizes = [model.targets.shape[1] for model in self._models]
        return Known(tuple(np.zeros((d, d)) for d in sizes), tuple(np.eye(d) for d in sizes))

    def add(self, state: Known, candidate: int) -> Known:
        """Information adds up."""
        information, covariance = [], []
        for model, known in zip(self._models, state.information, strict=True):
            factor = model.factors[candidate]
            total = known + factor.T @ factor
            information.append(total)
            # Anew each time: updates of the covariance would lose digits where data say much.
            one = np.eye(len(total))
            covariance.append(cho_solve(cho_factor(one + total, lower=True), one))
        return Known(tuple(information), tuple(covariance))

    def value(self, state: Known) -> float:
        """Root mean square of what is left of the deviations."""
        return float(np.sqrt(np.mean([left / prior for left, prior in self._variances(state)])))

    def deviations(self, state: Known) -> Array:
        """Posterior standard deviation (s,) of each target, root mean square over the models."""
        return np.asarray(np.sqrt(np.mean([left for left, _ in self._variances(state)], axis=0)))

    def merit(self, state: Known, candidate: int) -> float:
        """How much the candidate takes off the mean square; of few rows, without an inverse of the whole."""
        total = 0.0
        for model, covariance, prior in zip(self._models, state.covariance, self._prior, strict=True):
            factor = model.factors[candidate]
            if not len(factor):
                continue  # it says nothing
            along = factor @ covariance
            inner = np.eye(len(factor)) + along @ factor.T
            explained = solve_triangular(np.linalg.cholesky(inner), along @ model.targets.T, lower=True)
            total += float(((explained**2).sum(axis=0) / prior).mean())
        return total / len(self._models)

    def _variances(self, state: Known) -> list[tuple[Array, Array]]:
        return [
            (np.einsum("sd,de,se->s", model.targets, covariance, model.targets), prior)
            for model, covariance, prior in zip(self._models, state.covariance, self._prior, strict=True)
        ]


def training_model(
    background: Background,
    functionals: Functionals,
    candidates: Candidates,
    quantities: Mapping[str, QuantityOfInterest],
    sigma: float,
) -> LocalModel:
    """Anomalies of the training set, over all recorded steps.

    Parameters
    ----------
    background : Background
    functionals : Functionals
        All candidates'.
    candidates : g index arrays
    quantities : mapping of str to QuantityOfInterest
        Targets, each with as many rows as it has numbers.
    sigma : float
        Standard deviation of the noise of every functional, in the unit of the data (`typical_sigma`).
    """
    count = background.n_samples
    if count < 2:
        raise ShapeError(f"training: got {count} trajectory, expected at least 2 for a covariance")
    anomalies = (background.coefficients - background.mean()[:, :, None]) / np.sqrt(count - 1)
    return _model(background, functionals, candidates, quantities, sigma, anomalies)


def parameter_models(
    background: Background,
    forward: ParametricMap,
    functionals: Functionals,
    candidates: Candidates,
    quantities: Mapping[str, QuantityOfInterest],
    sigma: float,
    points: Array,
) -> list[LocalModel]:
    """Derivatives with respect to the parameters that vary, by central differences, at several of their values.

    The prior of each is Gaussian with the deviation of its distribution; one that is distributed evenly in its
    logarithm is differentiated in it.

    Parameters
    ----------
    background, functionals, candidates, quantities, sigma
        As for `training_model`.
    forward : ParametricMap
    points : (P, n_parameters) array
        Moved into the ranges by the difference where they are nearer to an end.
    """
    free = [(i, p) for i, p in enumerate(background.parameters.parameters) if not p.fixed]
    if not free:
        raise ShapeError("parameters: none varies, so there is nothing to find out")
    given = np.asarray(points, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != len(background.parameters.parameters) or not len(given):
        raise ShapeError(
            f"points: got shape {given.shape}, expected (at least 1, {len(background.parameters.parameters)})"
        )
    models = []
    for point in given:
        unit = np.clip([_unit(p, point[i]) for i, p in free], _STEP / np.sqrt(12), 1 - _STEP / np.sqrt(12))
        rows = []
        for place in range(len(free)):
            for sign in (1.0, -1.0):
                moved = unit.copy()
                moved[place] += sign * _STEP / np.sqrt(12)
                row = point.copy()
                for (i, p), at in zip(free, moved, strict=True):
                    row[i] = float(p.quantile(np.array(at)))
                rows.append(row)
        states = forward.coefficients(np.stack(rows))
        slopes = (states[:, :, ::2] - states[:, :, 1::2]) / (2 * _STEP)
        models.append(_model(background, functionals, candidates, quantities, sigma, slopes))
    return models


def typical_sigma(background: Background, functionals: Functionals, level: float) -> float:
    """Level Ξ times the median, over the training set, of the largest value that a functional takes."""
    observed = background.observe(functionals.matrix)
    largest = [float(np.abs(observed @ background.coefficients[:, :, k]).max()) for k in range(background.n_samples)]
    return level * float(np.median(largest))


def _model(
    background: Background,
    functionals: Functionals,
    candidates: Candidates,
    quantities: Mapping[str, QuantityOfInterest],
    sigma: float,
    directions: Array,
) -> LocalModel:
    """Model whose unknown weighs directions (r, t, d) in the space of trajectories."""
    check_candidates(candidates, functionals.count)
    if not (np.isfinite(sigma) and sigma > 0):
        raise ShapeError(f"sigma: got {sigma}, expected a positive number; without noise every candidate says all")
    if not quantities:
        raise ShapeError("quantities: got none, expected at least one to find out")
    observed = background.observe(functionals.matrix) / sigma
    d = directions.shape[2]
    factors = [_condensed(np.tensordot(observed[each], directions, axes=1).reshape(-1, d)) for each in candidates]
    trajectories = Estimate(background, np.arange(len(background.times)), directions)
    targets = np.concatenate([trajectories.quantity(quantity) for quantity in quantities.values()])
    return LocalModel(tuple(factors), targets)


def _condensed(factor: Array) -> Array:
    """The same information in the fewest rows."""
    if len(factor) > 2 * factor.shape[1]:
        factor = np.asarray(np.linalg.qr(factor, mode="r"))
    _, values, vt = thin_svd(factor)
    kept = values**2 > _NOTHING
    return np.asarray(values[kept, None] * vt[kept])


def _unit(parameter: Parameter, value: float) -> float:
    """Where a value is in its range, from 0 to 1."""
    low, high = parameter.low, parameter.high
    if parameter.distribution == "log_uniform":
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)
