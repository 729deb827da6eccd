"""Whether claimed uncertainties are right: coverage, probability integral transforms, scores and sharpness.

An interval of 90% should hold 90% of the truths, neither fewer nor many more; of two estimates that do, the one
with the narrower intervals says more. Every judgement here is over k patients that are independent of each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, kstest, norm

from dacore.core.arrays import Array, IntArray
from dacore.core.display import Displayed
from dacore.errors import ShapeError
from dacore.studies.classification import Proportion

LEVELS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)

# Probabilities at which the loss of quantiles is summed: within 1e-3 of the score of a Gaussian.
_FINE = 2000


@dataclass(frozen=True, eq=False, repr=False)
class Coverage(Displayed):
    """How often central intervals hold the truth.

    Parameters
    ----------
    levels : (L,) array
        Nominal.
    counts : (L,) int array
        Truths inside.
    total : int
    width : (L,) array
        Mean width, in the unit of the number.
    confidence : float
        Of the band and the intervals below.
    """

    levels: Array
    counts: IntArray
    total: int
    width: Array
    confidence: float = 0.95

    @property
    def empirical(self) -> Array:
        """Share of the truths inside (L,)."""
        return np.asarray(self.counts / self.total)

    @property
    def band(self) -> tuple[Array, Array]:
        """Shares (L,), (L,) between which each empirical one lies, if its nominal level is right (binomial)."""
        return self._band(1.0 - self.confidence)

    def _band(self, risk: float) -> tuple[Array, Array]:
        low, high = (binom.ppf(each, self.total, self.levels) / self.total for each in (risk / 2, 1 - risk / 2))
        return low, high

    @property
    def intervals(self) -> Array:
        """Wilson's interval (L, 2) of the probability behind each empirical share."""
        return np.array([Proportion(int(count), self.total, self.confidence).interval for count in self.counts])

    @property
    def consistent(self) -> bool:
        """Whether nothing here contradicts what is claimed: right claims fail with probability 1 − confidence at most.

        The band is wider than `band`, which holds at each level on its own (Bonferroni).
        """
        low, high = self._band((1.0 - self.confidence) / len(self.levels))
        return bool(((self.empirical >= low - 1e-12) & (self.empirical <= high + 1e-12)).all())

    @property
    def error(self) -> float:
        """Mean of |empirical − nominal| over the levels."""
        return float(np.abs(self.empirical - self.levels).mean())


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Displayed):
    """How honest the uncertainty of one number is.

    Parameters
    ----------
    coverage : Coverage
    transform : (k,) array
        Probability integral transform: the claimed probability of a number below the truth; uniform where all
        is right, in the middle where too much uncertainty is claimed, at the ends where too little.
    uniformity : float
        p-value of Kolmogorov's and Smirnov's test of that.
    standardised : (k,) array
        Errors over claimed deviations.
    crps : float
        Mean continuous ranked probability score, in the unit of the number; less is better.
    sharpness : float
        Mean claimed standard deviation.
    """

    coverage: Coverage
    transform: Array
    uniformity: float
    standardised: Array
    crps: float
    sharpness: float

    @property
    def bias(self) -> float:
        """Mean of the standardised errors; 0 where all is right."""
        return float(self.standardised.mean())

    @property
    def spread(self) -> float:
        """Root mean square of the standardised errors; above 1 where too little uncertainty is claimed."""
        return float(np.sqrt((self.standardised**2).mean()))


def calibrate(
    truth: Array, mean: Array, deviation: Array, levels: Sequence[float] = LEVELS, confidence: float = 0.95
) -> Calibration:  # fmt: skip
    """Judge Gaussian claims.

    Parameters
    ----------
    truth, mean, deviation : (k,) arrays
    levels : sequence of float
        Of the central intervals.
    confidence : float
        Of the binomial band.

    Raises
    ------
    ShapeError
        If shapes differ, something is not finite, or a deviation is not positive.
    """
    true, centre, spread = _checked({"truth": truth, "mean": mean, "deviation": deviation})
    _positive(spread)
    half = norm.ppf(0.5 + _levels(levels) / 2)[:, None] * spread
    errors = (true - centre) / spread
    transform = norm.cdf(errors)
    return Calibration(
        coverage(true, centre - half, centre + half, levels, confidence), transform, uniformity(transform), -errors,
        float(crps_gaussian(true, centre, spread).mean()), float(spread.mean()),
    )  # fmt: skip


def calibrate_quantiles(
    truth: Array,
    probabilities: Sequence[float] | Array,
    quantiles: Array,
    estimate: Array,
    deviation: Array,
    confidence: float = 0.95,
) -> Calibration:
    """Judge claims that are given by quantiles, Gaussian or not.

    Parameters
    ----------
    truth, estimate, deviation : (k,) arrays
    probabilities : (q,) array
        Rising, between 0 and 1, symmetric about 1/2: pairs make the central intervals.
    quantiles : (q, k) array
    confidence : float
        Of the binomial band.
    """
    true, centre, spread = _checked({"truth": truth, "estimate": estimate, "deviation": deviation})
    _positive(spread)
    chances, values = _quantiles(probabilities, quantiles, len(true))
    if not np.allclose(chances + chances[::-1], 1.0, atol=1e-9):
        raise ShapeError("probabilities: expected them symmetric about 1/2, in pairs for central intervals")
    half = len(chances) // 2
    low, high = values[:half][::-1], values[::-1][:half][::-1]
    levels = (1.0 - 2.0 * chances[:half])[::-1]
    transform = transform_quantiles(true, chances, values)
    return Calibration(
        coverage(true, low, high, levels, confidence), transform, uniformity(transform), (centre - true) / spread,
        float(crps_quantiles(true, chances, values).mean()), float(spread.mean()),
    )  # fmt: skip


def central_probabilities(levels: Sequence[float] = LEVELS) -> Array:
    """Probabilities (2 L + 1,), rising, of the quantiles that make central intervals of these levels, and of 1/2."""
    tails = 0.5 - np.sort(_levels(levels))[::-1] / 2
    return np.concatenate([tails, [0.5], 1.0 - tails[::-1]])


def coverage(
    truth: Array, low: Array, high: Array, levels: Sequence[float] | Array, confidence: float = 0.95
) -> Coverage:  # fmt: skip
    """Count truths in intervals.

    Parameters
    ----------
    truth : (k,) array
    low, high : (L, k) arrays
    levels : (L,) array
        Nominal levels of the intervals.
    confidence : float
    """
    (true,) = _checked({"truth": truth})
    nominal = _levels(levels)
    wanted = (len(nominal), len(true))
    below, above = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if below.shape != wanted or above.shape != wanted or not (below <= above).all():
        raise ShapeError(
            f"intervals: got shapes {below.shape} and {above.shape}, expected {wanted} = (levels, patients) with low "
            "ends at or below high ends and no NaN"
        )
    if not 0 < confidence < 1:
        raise ShapeError(f"confidence: got {confidence}, expected between 0 and 1")
    inside = (below <= true) & (true <= above)
    return Coverage(nominal, inside.sum(axis=1), len(true), (above - below).mean(axis=1), confidence)


def uniformity(transform: Array) -> float:
    """p-value of the test that numbers (k,) of [0, 1] are uniform."""
    return float(kstest(transform, "uniform").pvalue)


def transform_quantiles(truth: Array, probabilities: Sequence[float] | Array, quantiles: Array) -> Array:
    """Probability integral transform (k,) from quantiles (q, k).

    Between them linear in the normal score, so that Gaussian quantiles give the Gaussian transform; beyond them,
    the slope of the last two goes on.
    """
    (true,) = _checked({"truth": truth})
    chances, values = _quantiles(probabilities, quantiles, len(true))
    scores = norm.ppf(chances)
    right = np.clip((values <= true).sum(axis=0), 1, len(chances) - 1)
    patient = np.arange(len(true))
    a, b = values[right - 1, patient], values[right, patient]
    # Where quantiles coincide a truth is above all of them, below, or in their middle.
    beside = np.select([true > a, true < a], [np.inf, -np.inf], 0.5)
    share = np.divide(true - a, b - a, out=beside, where=b > a)
    return np.asarray(norm.cdf(scores[right - 1] + share * (scores[right] - scores[right - 1])))


def transform_ensemble(truth: Array, ensemble: Array, rng: np.random.Generator) -> Array:
    """Probability integral transform (k,) from members (n, k): the rank of the truth, spread over its place."""
    true, members = _ensemble(truth, ensemble)
    below, equal = (members < true).sum(axis=0), (members == true).sum(axis=0)
    return np.asarray((below + rng.random(len(true)) * (equal + 1.0)) / (len(members) + 1.0))


def crps_gaussian(truth: Array, mean: Array, deviation: Array) -> Array:
    """Continuous ranked probability score (k,) of Gaussian claims (Gneiting and Raftery, JASA 2007, eq. 21)."""
    true, centre, spread = _checked({"truth": truth, "mean": mean, "deviation": deviation})
    _positive(spread)
    z = (true - centre) / spread
    return np.asarray(spread * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi)))


def crps_ensemble(truth: Array, ensemble: Array, fair: bool = True) -> Array:
    """Continuous ranked probability score (k,) of members (n, k): E|X − y| − E|X − X'|/2.

    Parameters
    ----------
    truth : (k,) array
    ensemble : (n, k) array
    fair : bool
        Whether members are draws, X and X' two different ones: unbiased for the claim behind them. Otherwise
        the members are the claim.
    """
    true, members = _ensemble(truth, ensemble)
    n = len(members)
    if fair and n < 2:
        raise ShapeError("ensemble: got 1 member, expected at least 2 for the fair score")
    # Σ_{i,j} |x_i − x_j| = 2 Σ_i (2 i − n − 1) x_(i) of the sorted members: no n × n array.
    weights = 2.0 * np.arange(1, n + 1) - n - 1.0
    apart = 2.0 * (weights @ np.sort(members, axis=0)) / (n * (n - 1) if fair else n * n)
    return np.asarray(np.abs(members - true).mean(axis=0) - 0.5 * apart)


def crps_quantiles(truth: Array, probabilities: Sequence[float] | Array, quantiles: Array) -> Array:
    """Continuous ranked probability score (k,) of claims by quantiles (q, k): twice the integral of their loss.

    Quantiles between and beyond those given are linear in the normal score, as in `transform_quantiles`.
    """
    (true,) = _checked({"truth": truth})
    chances, values = _quantiles(probabilities, quantiles, len(true))
    scores = norm.ppf(chances)
    fine = (np.arange(_FINE) + 0.5) / _FINE
    at = norm.ppf(fine)
    right = np.clip(np.searchsorted(scores, at), 1, len(scores) - 1)
    share = (at - scores[right - 1]) / (scores[right] - scores[right - 1])
    total = np.zeros(len(true))
    for chance, k, part in zip(fine, right, share, strict=True):
        quantile = values[k - 1] + part * (values[k] - values[k - 1])
        total += (true - quantile) * (chance - (true < quantile))
    return 2.0 * total / _FINE


def _levels(levels: Sequence[float] | Array) -> Array:
    given = np.asarray(levels, dtype=np.float64)
    if given.ndim != 1 or not given.size or not ((given > 0) & (given < 1)).all():
        raise ShapeError(f"levels: got {levels}, expected numbers between 0 and 1, at least one")
    return given


def _positive(deviation: Array) -> None:
    if not (deviation > 0).all():
        raise ShapeError(f"deviation: {int((~(deviation > 0)).sum())} of {len(deviation)} are not positive")


def _quantiles(probabilities: Sequence[float] | Array, quantiles: Array, count: int) -> tuple[Array, Array]:
    chances, values = _levels(probabilities), np.asarray(quantiles, dtype=np.float64)
    if len(chances) < 2 or not (np.diff(chances) > 0).all():
        raise ShapeError(f"probabilities: got {probabilities}, expected at least two, rising")
    if values.shape != (len(chances), count) or not np.isfinite(values).all() or (np.diff(values, axis=0) < 0).any():
        raise ShapeError(
            f"quantiles: got shape {values.shape}, expected ({len(chances)}, {count}) = (probabilities, patients), "
            "finite and never falling with the probability"
        )
    return chances, values


def _ensemble(truth: Array, ensemble: Array) -> tuple[Array, Array]:
    (true,) = _checked({"truth": truth})
    members = np.asarray(ensemble, dtype=np.float64)
    if members.ndim != 2 or members.shape[1] != len(true) or not len(members) or not np.isfinite(members).all():
        raise ShapeError(f"ensemble: got shape {members.shape}, expected (members, {len(true)}), finite")
    return true, members


def _checked(given: dict[str, Array]) -> list[Array]:
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in given.items()}
    wanted = arrays["truth"].shape
    if len(wanted) != 1 or not wanted[0]:
        raise ShapeError(f"truth: got shape {wanted}, expected (patients,), at least one")
    for name, values in arrays.items():
        if values.shape != wanted or not np.isfinite(values).all():
            raise ShapeError(f"{name}: got shape {values.shape}, expected {wanted} as the truth, finite")
    return list(arrays.values())
