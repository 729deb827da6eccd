"""How far the variants of a comparison agree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, Sparse

# What an item belongs to, by how its name starts; the rest are estimates.
GROUPS = {"matrix": "matrices", "load": "loads", "functionals": "functionals", "trajectory": "trajectory"}
ESTIMATES = "estimates"


@dataclass(frozen=True)
class Agreement:
    """One variant against the reference.

    Parameters
    ----------
    differences : mapping of str to float
        For every item, max|a − b| / max|b| with b the reference's; 0 where both vanish.
    apart : tuple of str
        Items that cannot be compared, because their sizes differ or one variant lacks them.
    """

    differences: Mapping[str, float]
    apart: tuple[str, ...]

    def groups(self) -> dict[str, float]:
        """The largest difference of each group: matrices, loads, functionals, trajectory, estimates."""
        out: dict[str, float] = {}
        for name, value in self.differences.items():
            group = group_of(name)
            out[group] = max(out.get(group, 0.0), value)
        return out


def group_of(item: str) -> str:
    """Group of an item."""
    return GROUPS.get(item.partition(" ")[0], ESTIMATES)


def agreement(arrays: Mapping[str, Array | Sparse], reference: Mapping[str, Array | Sparse]) -> Agreement:
    """Compare everything that two variants have in common.

    Parameters
    ----------
    arrays, reference : mapping of str to array or csr_array
    """
    differences, apart = {}, []
    for name in dict.fromkeys((*reference, *arrays)):
        if name not in arrays or name not in reference or arrays[name].shape != reference[name].shape:
            apart.append(name)
        else:
            differences[name] = relative_difference(arrays[name], reference[name])
    return Agreement(differences, tuple(apart))


def relative_difference(a: Array | Sparse, b: Array | Sparse) -> float:
    """max|a − b| / max|b|; NaN counts as infinite."""
    # Sparsity patterns differ between libraries, as some drop exact zeros: subtract matrices, not their data.
    largest, gap = _largest(b), _largest(a - b)
    if np.isnan(gap) or np.isnan(largest):
        return float("inf")
    return gap / largest if largest else (0.0 if gap == 0.0 else float("inf"))


def worst(agreements: Sequence[Agreement], item: str) -> float:
    """Largest difference of one item among several variants; NaN where none can be compared."""
    values = [each.differences[item] for each in agreements if item in each.differences]
    return max(values, default=float("nan"))


def _largest(x: Array | Sparse) -> float:
    data = x if isinstance(x, np.ndarray) else x.data
    return float(np.abs(data).max(initial=0.0))
