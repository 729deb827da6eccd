"""Random polynomials and their integrals over the unit box, computed without any mesh."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from dacore.core.arrays import Array


class Polynomial:
    """A random polynomial of a given total degree, with its gradient.

    Parameters
    ----------
    rng : numpy.random.Generator
    dim, degree : int
    """

    def __init__(self, rng: np.random.Generator, dim: int, degree: int) -> None:
        self.powers = np.array([e for e in product(range(degree + 1), repeat=dim) if sum(e) <= degree])
        self.factors = rng.normal(size=len(self.powers))

    def __call__(self, x: Array) -> Array:
        """Values (...) at points (..., d)."""
        return np.asarray(np.prod(x[..., None, :] ** self.powers, axis=-1) @ self.factors)

    def gradient(self, x: Array) -> Array:
        """Gradients (..., d) at points (..., d)."""
        parts = []
        for axis in range(x.shape[-1]):
            lowered = self.powers.copy()
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            parts.append(np.prod(x[..., None, :] ** lowered, axis=-1) @ (self.factors * self.powers[:, axis]))
        return np.stack(parts, axis=-1)


def box_rule(dim: int) -> tuple[Array, Array]:
    """Gauss points (q, dim) and weights (q,) on the unit box, exact to degree 7 in each coordinate."""
    x, w = np.polynomial.legendre.leggauss(4)
    points = np.array(list(product((x + 1) / 2, repeat=dim))).reshape(-1, dim)
    return points, np.prod(np.array(list(product(w / 2, repeat=dim))).reshape(-1, dim), axis=1)


def box_faces(dim: int, role: str) -> Iterator[tuple[Array, Array, Array]]:
    """Gauss points, weights and outward normal of each face of the unit box with a role of `shuffled_box`."""
    x, w = box_rule(dim - 1)
    for axis, end in product(range(dim), (0, 1)):
        name = ("left", "right")[end] if axis == 0 else "side"
        if name == role:
            yield np.insert(x, axis, end, axis=1), w, np.where(np.arange(dim) == axis, 2.0 * end - 1.0, 0.0)
