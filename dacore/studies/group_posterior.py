"""Probability of belonging to a group, from a posterior that is known by its quantiles."""

from collections.abc import Sequence

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.studies.calibration import transform_quantiles
from dacore.studies.classification import Range, check_groups


def group_probability_quantiles(
    probabilities: Sequence[float] | Array,
    quantiles: Array,
    normal: Range,
    raised: Range,
    prevalence: float = 0.5,
) -> Array:
    """Probability (k,) of being raised, given posteriors found under a flat prior over both ranges.

    What `dacore.studies.classification.group_probability` is for Gaussian ones. Between and beyond the quantiles a
    posterior is as `transform_quantiles` has it. Where it has no mass in either range, the nearer one is taken.

    Parameters
    ----------
    probabilities : (q,) array
        Rising, between 0 and 1.
    quantiles : (q, k) array
        Of the number, for each patient.
    normal, raised : (float, float)
        Ranges in which the number is uniform in each group.
    prevalence : float
        Share of the raised among all who come.
    """
    check_groups(normal, raised, prevalence)
    values = np.asarray(quantiles, dtype=np.float64)
    if values.ndim != 2:
        raise ShapeError(f"quantiles: got shape {values.shape}, expected (probabilities, patients)")
    count = values.shape[1]
    masses = []
    for (low, high), share in ((normal, 1.0 - prevalence), (raised, prevalence)):
        ends = [transform_quantiles(np.full(count, end), probabilities, values) for end in (low, high)]
        masses.append(share / (high - low) * (ends[1] - ends[0]))
    total = masses[0] + masses[1]
    middle = values[len(values) // 2]
    away = [np.maximum(np.maximum(low - middle, middle - high), 0.0) for low, high in (normal, raised)]
    nearer = (away[1] < away[0]).astype(np.float64)
    return np.asarray(np.divide(masses[1], total, out=nearer, where=total > 0))
