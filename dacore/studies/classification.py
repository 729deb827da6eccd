"""Two groups told apart by one number: who is called raised, how often rightly, and how often anybody could be.

The operating curve and the area under it need no threshold. Thresholds are judged by counts with Wilson's
interval, the one chosen on the data by leaving each patient out in turn as well. What the best of all rules
could do follows from a posterior (`group_probability`, `expected_correct`) or from a standard deviation that
no estimate can fall below (`attainable`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm, rankdata

from dacore.core.arrays import Array, BoolArray
from dacore.core.display import Displayed
from dacore.errors import ShapeError

Range = tuple[float, float]

# Points at which the densities of `attainable` are summed, over the ranges and six deviations to each side.
_POINTS = 20_001
_MOST_POINTS = 1_000_001
_REACH = 6.0


@dataclass(frozen=True)
class Proportion:
    """A count of a total, with Wilson's interval for the probability behind it.

    Parameters
    ----------
    count, total : int
    level : float
        Of the interval.
    """

    count: int
    total: int
    level: float = 0.95

    def __post_init__(self) -> None:
        if not 0 <= self.count <= self.total or self.total < 1:
            raise ShapeError(f"proportion: got {self.count} of {self.total}, expected a part of at least one")

    @property
    def value(self) -> float:
        """Count over total."""
        return self.count / self.total

    @property
    def interval(self) -> Range:
        """Wilson's score interval: within [0, 1], and of positive width at 0 and 1, too."""
        z, n, p = float(norm.ppf(0.5 + self.level / 2)), self.total, self.value
        centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * float(np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)))
        # At the ends the interval ends there, up to rounding.
        return (0.0 if self.count == 0 else centre - half, 1.0 if self.count == n else centre + half)

    def __str__(self) -> str:
        return f"{self.count} of {self.total}"


@dataclass(frozen=True, eq=False, repr=False)
class OperatingCurve(Displayed):
    """Rates against each other as the threshold falls (receiver operating characteristic).

    Parameters
    ----------
    thresholds : (n,) array
        Falling from infinity; raised is who is at or above.
    false_positive, true_positive : (n,) arrays
        Shares of the normal and of the raised that are called raised.
    area : float
        Probability that a raised patient's number is above a normal one's, ties counting half.
    interval : (float, float)
        Newcombe's score interval of the area, which stays honest where the groups do not overlap.
    deviation : float
        Standard deviation of the area by DeLong; 0 where the groups do not overlap.
    level : float
        Of the interval.
    """

    thresholds: Array
    false_positive: Array
    true_positive: Array
    area: float
    interval: Range
    deviation: float
    level: float


@dataclass(frozen=True)
class Rule:
    """Raised is who is above a threshold.

    Parameters
    ----------
    threshold : float
        In the unit of the number.
    sensitivity, specificity : Proportion
        Raised called raised; normal called normal.
    correct : Proportion
        Of both groups.
    """

    threshold: float
    sensitivity: Proportion
    specificity: Proportion
    correct: Proportion

    @property
    def youden(self) -> float:
        """Sensitivity + specificity − 1."""
        return self.sensitivity.value + self.specificity.value - 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Classification(Displayed):
    """What a number says about two groups.

    Parameters
    ----------
    curve : OperatingCurve
    fixed : Rule
        At the threshold that was set before.
    best : Rule
        At the threshold of the largest Youden index, chosen on these very patients.
    left_out : Proportion
        Patients that are told right by the best threshold of all the others.
    """

    curve: OperatingCurve
    fixed: Rule
    best: Rule
    left_out: Proportion


def classify(scores: Array, raised: BoolArray, threshold: float, level: float = 0.95) -> Classification:
    """Judge a number that should be larger in one group.

    Parameters
    ----------
    scores : (k,) array
        For instance estimates of the ventricular pressure [dyn/cm²].
    raised : (k,) bool array
        Who truly belongs to the group of large numbers.
    threshold : float
        Set without looking at the scores, for instance by `middle`.
    level : float
        Of all intervals.

    Raises
    ------
    ShapeError
        If a group is empty or a score is not finite.
    """
    values, truth = _checked(scores, raised)
    best = best_threshold(values, truth)
    right = 0
    if min(truth.sum(), (~truth).sum()) > 1:
        for k in range(len(values)):
            others = np.arange(len(values)) != k
            right += int((values[k] >= best_threshold(values[others], truth[others])) == truth[k])
        left_out = Proportion(right, len(values), level)
    else:
        # Without its only member a group has no threshold: nobody is told right.
        left_out = Proportion(0, len(values), level)
    return Classification(
        operating_curve(values, truth, level), rule(values, truth, threshold, level), rule(values, truth, best, level),
        left_out,
    )  # fmt: skip


def middle(normal: Range, raised: Range) -> float:
    """Threshold in the middle between two ranges of the number."""
    if not (normal[0] <= normal[1] <= raised[0] <= raised[1]):
        raise ShapeError(f"groups: got {normal} and {raised}, expected two ranges, the first below the second")
    return 0.5 * (normal[1] + raised[0])


def rule(scores: Array, raised: BoolArray, threshold: float, level: float = 0.95) -> Rule:
    """Judge one threshold; parameters as for `classify`."""
    values, truth = _checked(scores, raised)
    called = values >= threshold
    counts = (int((called & truth).sum()), int((~called & ~truth).sum()))
    return Rule(
        float(threshold),
        Proportion(counts[0], int(truth.sum()), level),
        Proportion(counts[1], int((~truth).sum()), level),
        Proportion(sum(counts), len(truth), level),
    )


def best_threshold(scores: Array, raised: BoolArray) -> float:
    """Threshold of the largest Youden index: the middle of a gap between scores, of equals the widest gap's."""
    values, truth = _checked(scores, raised)
    order = np.argsort(values, kind="stable")
    values, truth = values[order], truth[order]
    below = np.cumsum(~truth) / (~truth).sum() - np.cumsum(truth) / truth.sum()
    gaps = np.diff(values)
    ends = np.flatnonzero(gaps > 0)
    # A rule that calls all alike has the index 0; it is what is left where no gap does better.
    if not ends.size or below[ends].max() <= 0:
        return float(values[0]) if truth.mean() >= 0.5 else float(np.nextafter(values[-1], np.inf))
    best = ends[below[ends] >= below[ends].max() - 1e-12]
    widest = best[np.argmax(gaps[best])]
    return float(0.5 * (values[widest] + values[widest + 1]))


def operating_curve(scores: Array, raised: BoolArray, level: float = 0.95) -> OperatingCurve:
    """Operating curve and the area under it; parameters as for `classify`."""
    values, truth = _checked(scores, raised)
    thresholds = np.concatenate([[np.inf], np.unique(values)[::-1]])
    high, low = np.sort(values[truth]), np.sort(values[~truth])
    false, true = (1.0 - np.searchsorted(each, thresholds, side="left") / len(each) for each in (low, high))
    area, deviation = _delong(values, truth)
    interval = _newcombe(area, len(low), len(high), level)
    return OperatingCurve(thresholds, false, true, area, interval, deviation, level)


def group_probability(
    mean: Array, deviation: Array, normal: Range, raised: Range, prevalence: float = 0.5
) -> Array:  # fmt: skip
    """Probability (k,) of being raised, given Gaussian posteriors found under a flat prior over both ranges.

    Parameters
    ----------
    mean, deviation : (k,) arrays
        Of the number, for each patient.
    normal, raised : (float, float)
        Ranges in which the number is uniform in each group.
    prevalence : float
        Share of the raised among all who come.
    """
    centre, spread = np.asarray(mean, dtype=np.float64), np.asarray(deviation, dtype=np.float64)
    if centre.shape != spread.shape or not (spread > 0).all():
        raise ShapeError("posterior: expected a positive standard deviation for each mean")
    check_groups(normal, raised, prevalence)
    logs = []
    for (low, high), share in ((normal, 1.0 - prevalence), (raised, prevalence)):
        logs.append(np.log(share / (high - low)) + _log_mass((low - centre) / spread, (high - centre) / spread))
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(logs[0] - logs[1], -700.0, 700.0))))


def expected_correct(probability: Array) -> float:
    """Share told right by the best of all rules where posteriors are right: the mean of max(P, 1 − P).

    Parameters
    ----------
    probability : (k,) array
        Of being raised (`group_probability`).
    """
    given = np.asarray(probability, dtype=np.float64)
    if not given.size or not ((given >= 0) & (given <= 1)).all():
        raise ShapeError("probability: expected numbers from 0 to 1, at least one")
    return float(np.maximum(given, 1.0 - given).mean())


@dataclass(frozen=True)
class Attainable:
    """What the best rule can do with an estimate of a given standard deviation.

    Parameters
    ----------
    correct : float
        Share told right by Bayes' rule.
    area : float
        Under the operating curve of the estimate.
    """

    correct: float
    area: float


def attainable(deviation: float, normal: Range, raised: Range, prevalence: float = 0.5) -> Attainable:
    """Limit of any rule, if the number is found with a Gaussian error of this standard deviation and no less.

    Parameters
    ----------
    deviation : float
        In the unit of the ranges; for instance from the Fisher information.
    normal, raised : (float, float)
        Ranges in which the number is uniform in each group.
    prevalence : float
        Share of the raised among all who come.
    """
    if not (np.isfinite(deviation) and deviation > 0):
        raise ShapeError(f"deviation: got {deviation}, expected a positive number")
    check_groups(normal, raised, prevalence)
    ends = min(normal[0], raised[0]) - _REACH * deviation, max(normal[1], raised[1]) + _REACH * deviation
    # Fine enough for the deviation; of one that is tiny beside the ranges, ends that are not resolved weigh nothing.
    fine = int(np.clip(20 * (ends[1] - ends[0]) / deviation, _POINTS, _MOST_POINTS))
    points = np.linspace(*ends, fine)
    density = [
        (norm.cdf((points - low) / deviation) - norm.cdf((points - high) / deviation)) / (high - low)
        for low, high in (normal, raised)
    ]
    best = np.maximum((1 - prevalence) * density[0], prevalence * density[1])
    step = points[1] - points[0]
    below = np.cumsum(density[0]) * step - 0.5 * step * density[0]
    return Attainable(min(1.0, float(best.sum() * step)), min(1.0, float((below * density[1]).sum() * step)))


def _delong(values: Array, truth: BoolArray) -> tuple[float, float]:
    """Area and its standard deviation from the ranks (DeLong, DeLong and Clarke-Pearson, Biometrics 1988)."""
    ranks = rankdata(values)
    high, low = values[truth], values[~truth]
    m, n = len(high), len(low)
    above = (ranks[truth] - rankdata(high)) / n  # share of the normal below each raised one
    under = 1.0 - (ranks[~truth] - rankdata(low)) / m
    variance = sum(float(part.var(ddof=1)) / len(part) for part in (above, under) if len(part) > 1)
    return float(above.mean()), float(np.sqrt(variance))


def _newcombe(area: float, m: int, n: int, level: float) -> Range:
    """Areas whose own standard deviation puts `area` within reach (Newcombe, Stat. Med. 2006, method 5)."""
    z = float(norm.ppf(0.5 + level / 2))
    more = 0.5 * (m + n) - 1.0

    def beyond(theta: float) -> float:
        variance = theta * (1 - theta) / (m * n) * (1 + more * ((1 - theta) / (2 - theta) + theta / (1 + theta)))
        return (area - theta) ** 2 - z**2 * variance

    # Each end is sought beside the area, not from it: at 0 and 1 the area itself is a root, of no meaning.
    near = 1.0 - 1e-9
    low = 0.0 if area <= 0 else float(brentq(beyond, 0.0, area * near))
    high = 1.0 if area >= 1 else float(brentq(beyond, 1.0 - (1.0 - area) * near, 1.0))
    return low, high


def _log_mass(low: Array, high: Array) -> Array:
    """Logarithm of the normal probability of [low, high], in the tails, too."""
    # In the upper tail both values are near 1: mirrored, they are near 0 and keep their digits.
    swap = low > 0
    a, b = np.where(swap, -high, low), np.where(swap, -low, high)
    top = norm.logcdf(b)
    return np.asarray(top + np.log1p(-np.exp(np.minimum(norm.logcdf(a) - top, -1e-300))))


def check_groups(normal: Range, raised: Range, prevalence: float) -> None:
    """Raise ShapeError unless the ranges have a width and the prevalence is one."""
    if not (normal[0] < normal[1] and raised[0] < raised[1]):
        raise ShapeError(f"groups: got {normal} and {raised}, expected two ranges of positive width")
    if not 0 < prevalence < 1:
        raise ShapeError(f"prevalence: got {prevalence}, expected between 0 and 1")


def _checked(scores: Array, raised: BoolArray) -> tuple[Array, BoolArray]:
    values, truth = np.asarray(scores, dtype=np.float64), np.asarray(raised)
    if values.ndim != 1 or truth.shape != values.shape or truth.dtype != np.bool_:
        raise ShapeError(f"scores: got shape {values.shape} for groups {truth.dtype} of shape {truth.shape}, "
                         "expected one number and one boolean for each patient")  # fmt: skip
    if not np.isfinite(values).all():
        raise ShapeError(f"scores: {int((~np.isfinite(values)).sum())} of {len(values)} are not finite; leave them out")
    if truth.all() or not truth.any():
        raise ShapeError("groups: got one group only, expected at least one patient in each of two")
    return values, truth
