"""Sparse polynomial interpolation of a vector-valued function on the cube, refined where it needs it.

Nodes are tensor products of one Leja sequence, the polynomials span a downward closed set of multi-indices ν,
and each new node adds one hierarchical polynomial H_ν, which is 1 there and 0 at all nodes before. Its weight, the
surplus, is what the interpolant missed at the new node; the indices of the largest surplus are refined. Source:
Chkifa, Cohen and Schwab, Found. Comput. Math. 14 (2014) 601.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from dacore.core.arrays import Array, IntArray

# Indices whose surplus is above this share of the largest are refined in one round.
_TOGETHER = 0.3
# A surplus is taken to be at least this share of those it follows: one may be small by chance, two hardly.
_TRUST = 0.05
# Nodes in each direction at most; hierarchical polynomials of higher degrees lose digits.
MOST_NODES = 40


@cache
def leja(count: int = MOST_NODES) -> Array:
    """Leja sequence on [−1, 1] that starts with 0, 1, −1: each point is farthest, in the product, from all before."""
    grid = np.cos(np.linspace(0.0, np.pi, 4001))
    nodes = np.zeros(count)
    size = np.log(np.abs(grid) + 1e-300)
    for k in range(1, count):
        nodes[k] = grid[int(size.argmax())]
        size += np.log(np.abs(grid - nodes[k]) + 1e-300)
    nodes.flags.writeable = False
    return nodes


def polynomials(x: Array, degree: int) -> tuple[Array, Array]:
    """Hierarchical polynomials of one direction and their derivatives, each (k, degree + 1), at points (k,)."""
    nodes = leja()
    values, slopes = np.ones((len(x), degree + 1)), np.zeros((len(x), degree + 1))
    for k in range(1, degree + 1):
        away = x - nodes[k - 1]
        # The product up to here, rescaled from 1 at node k − 1 to 1 at node k.
        size = nodes[k] - nodes[k - 1]
        before = polynomial_at(k - 1, nodes[k])
        values[:, k] = values[:, k - 1] * away / (before * size)
        slopes[:, k] = (slopes[:, k - 1] * away + values[:, k - 1]) / (before * size)
    return values, slopes


@cache
def polynomial_at(degree: int, x: float) -> float:
    """The hierarchical polynomial of one degree at one point."""
    nodes = leja()[:degree]
    return float(np.prod((x - nodes) / (leja()[degree] - nodes))) if degree else 1.0


@dataclass(frozen=True, eq=False)
class Interpolant:
    """Σ_ν c_ν H_ν.

    Parameters
    ----------
    indices : (n, p) int array
        Multi-indices ν.
    weights : (n, q) array
        Surpluses c_ν.
    """

    indices: IntArray
    weights: Array

    def basis(self, x: Array) -> Array:
        """H_ν (k, n) at points (k, p)."""
        out = np.ones((len(x), len(self.indices)))
        for d, column in enumerate(self.indices.T):
            if column.any():
                out *= polynomials(x[:, d], int(column.max()))[0][:, column]
        return out

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """H_ν (k, n) and its derivatives (p, k, n) at points (k, p)."""
        every = [polynomials(x[:, d], int(column.max())) for d, column in enumerate(self.indices.T)]
        parts = [(v[:, column], s[:, column]) for (v, s), column in zip(every, self.indices.T, strict=True)]
        value = np.ones((len(x), len(self.indices)))
        for v, _ in parts:
            value = value * v
        slopes = np.empty((len(parts), *value.shape))
        for d, (_, slope) in enumerate(parts):
            slopes[d] = slope
            for e, (v, _) in enumerate(parts):
                if e != d:
                    slopes[d] *= v
        return value, slopes

    def plus(self, indices: IntArray, weights: Array) -> "Interpolant":
        """Return the sum with polynomials of other indices (m, p), or the same, and weights (m, q)."""
        place = {tuple(index): k for k, index in enumerate(self.indices.tolist())}
        news = [index for index in indices.tolist() if tuple(index) not in place]
        place |= {tuple(index): k for k, index in enumerate(news, start=len(place))}
        out = np.concatenate([self.weights, np.zeros((len(news), self.weights.shape[1]))])
        np.add.at(out, [place[tuple(index)] for index in indices.tolist()], weights)
        return Interpolant(np.array([*self.indices.tolist(), *news], dtype=np.int64), out)

    def __call__(self, x: Array) -> Array:
        """Values (k, q) at points (k, p)."""
        return np.asarray(self.basis(x) @ self.weights)


def interpolate(
    function: Callable[[Array], Array],
    size: Callable[[Array], Array],
    dimensions: int,
    tolerance: float,
    most: int,
    wider: Callable[[Array, int], Array] | None = None,
) -> tuple[Interpolant, float]:
    """Interpolate a function on the cube.

    Parameters
    ----------
    function : callable
        Takes points (k, p), returns values (k, q).
    size : callable
        Takes surpluses (k, q), returns their sizes (k,), relative to what matters.
    dimensions : int
        Number p of directions.
    tolerance : float
        Stop where no surplus of an index that may be refined is larger.
    most : int
        Nodes at most.
    wider : callable, optional
        Takes weights (n, q) and a larger number q'; returns them as (n, q'), for a function whose values get more
        entries from call to call.

    Returns
    -------
    Interpolant
    left : float
        Largest size of a surplus that was not refined.
    """
    indices = [(0,) * dimensions]
    weights = function(np.zeros((1, dimensions)))
    sizes = {indices[0]: np.inf}
    refined: set[tuple[int, ...]] = set()
    while True:
        waiting = {index: value for index, value in sizes.items() if index not in refined}
        left = max(waiting.values(), default=0.0)
        room = most - len(indices)
        if left <= tolerance or room <= 0:
            return Interpolant(np.array(indices, dtype=np.int64), weights), float(left)
        chosen = [index for index, value in waiting.items() if value >= max(_TOGETHER * left, tolerance)]
        refined.update(chosen)
        fresh = _neighbours(chosen, refined, set(indices))[:room]
        if not fresh:
            continue
        nodes = leja()[np.array(fresh)]
        values = function(nodes)
        if wider is not None and values.shape[1] > weights.shape[1]:
            weights = wider(weights, values.shape[1])
        surplus = values - Interpolant(np.array(indices, dtype=np.int64), weights)(nodes)
        weights = np.concatenate([weights, surplus])
        indices += fresh
        for index, own in zip(fresh, size(surplus).tolist(), strict=True):
            below = max(sizes[each] for each in _below(index))
            sizes[index] = max(own, _TRUST * below) if np.isfinite(below) else own


def _neighbours(
    chosen: list[tuple[int, ...]], refined: set[tuple[int, ...]], known: set[tuple[int, ...]]
) -> list[tuple[int, ...]]:
    """Indices one higher in one direction, all of whose own lower neighbours are refined."""
    out: list[tuple[int, ...]] = []
    for index in chosen:
        for d in range(len(index)):
            new = (*index[:d], index[d] + 1, *index[d + 1 :])
            if new[d] < MOST_NODES and new not in known and new not in out:
                out += [new] if all(each in refined for each in _below(new)) else []
    return out


def _below(index: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Indices one lower in one direction."""
    return [(*index[:d], index[d] - 1, *index[d + 1 :]) for d in range(len(index)) if index[d]]
