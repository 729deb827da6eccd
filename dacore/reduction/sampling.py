"""Which parameter vectors are alike: coordinates of the operator, and points spread over them."""

from collections.abc import Sequence

import numpy as np

from dacore.core.arrays import Array


def features(coefficients: Array) -> Array:
    """Coordinates (d, K) in which equal operators are equal and ratios of stiffness are distances.

    Parameters
    ----------
    coefficients : (n_terms, K) array
        Of the operator's terms.

    Returns
    -------
    (d, K) array
        Logarithms of the positive coefficients that vary, the values of the others, scaled to [0, 1].
    """
    rows = []
    for row in coefficients:
        positive = bool((row > 0).all())
        values = np.log(row) if positive else row
        width = float(np.ptp(values))
        # Logarithms differ by what the coefficients do relatively; other coefficients have a unit of their own.
        if width > 1e-12 * max(float(np.abs(values).max()), 1.0 if positive else 0.0):
            rows.append((values - values.min()) / width)
    return np.array(rows).reshape(len(rows), coefficients.shape[1])


def spread(points: Array, count: int, taken: Sequence[int] = ()) -> list[int]:
    """Choose `count` of the columns of points (d, K) far apart and from those taken; the first nearest the middle."""
    chosen = list(taken)
    out: list[int] = []
    total = points.shape[1]
    while len(out) < min(count, total - len(taken)):
        if chosen:
            distance = np.min([((points - points[:, [j]]) ** 2).sum(axis=0) for j in chosen], axis=0)
            distance[chosen] = -1.0
            best = int(distance.argmax())
        else:
            best = int(((points - 0.5) ** 2).sum(axis=0).argmin())
        chosen.append(best)
        out.append(best)
    return out
