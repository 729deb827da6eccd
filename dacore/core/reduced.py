"""A reduced space: an orthonormal basis in a stated inner product; and what is told of one in use."""

from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array, Sparse
from dacore.core.display import Card, Displayed
from dacore.errors import AccuracyError, ShapeError


@dataclass(frozen=True, eq=False, repr=False)
class ReducedSpace(Displayed):
    """Span of orthonormal modes.

    Parameters
    ----------
    basis : (n_dofs, n) array
        Modes, orthonormal in `product`; checked on making.
    singular_values : (k,) array, k >= n
        Of the data the modes came from, decreasing; values past n belong to what was left out.
    product : (n_dofs, n_dofs) csr_array

    Raises
    ------
    AccuracyError
        If the basis is not orthonormal to 1e-10.
    """

    basis: Array
    singular_values: Array
    product: Sparse

    def __post_init__(self) -> None:
        n = self.basis.shape[1]
        if self.basis.shape[0] != self.product.shape[0]:
            raise ShapeError(f"basis: got {self.basis.shape[0]} rows, expected {self.product.shape[0]}")
        error = float(np.abs(self.basis.T @ (self.product @ self.basis) - np.eye(n)).max(initial=0.0))
        if not error < 1e-10:
            raise AccuracyError(
                f"basis of {n} modes is orthonormal to {error:.1e} only, expected 1e-10; "
                "drop the modes of the smallest singular values or orthonormalise again"
            )

    @property
    def dimension(self) -> int:
        """Number n of modes."""
        return int(self.basis.shape[1])

    @property
    def tails(self) -> Array:
        """ε̂_n = (Σ_{i>n} σ_i² / Σ_i σ_i²)^½ for n = 0 … k, a (k + 1,) array (docs/method.md: The training set)."""
        return relative_tails(self.singular_values)

    def project(self, states: Array) -> Array:
        """Coefficients (n, ...) of the orthogonal projection of states (n_dofs, ...).

        Parameters
        ----------
        states : (n_dofs, ...) array

        Returns
        -------
        (n, ...) array
        """
        flat = states.reshape(states.shape[0], -1)
        return np.asarray(self.basis.T @ (self.product @ flat)).reshape(self.dimension, *states.shape[1:])

    def lift(self, coefficients: Array) -> Array:
        """States (n_dofs, ...) of coefficients (n, ...).

        Parameters
        ----------
        coefficients : (n, ...) array

        Returns
        -------
        (n_dofs, ...) array
        """
        flat = coefficients.reshape(coefficients.shape[0], -1)
        return np.asarray(self.basis @ flat).reshape(self.basis.shape[0], *coefficients.shape[1:])

    def truncate(self, n: int) -> "ReducedSpace":
        """Return the space of the first n modes.

        Parameters
        ----------
        n : int

        Returns
        -------
        ReducedSpace
        """
        if not 1 <= n <= self.dimension:
            raise ShapeError(f"dimension: got {n}, expected 1 to {self.dimension}")
        return ReducedSpace(self.basis[:, :n], self.singular_values, self.product)


def relative_tails(singular_values: Array) -> Array:
    """ε̂_n for n = 0 … k from k singular values, summed from the smallest for accuracy.

    Parameters
    ----------
    singular_values : (k,) array

    Returns
    -------
    (k + 1,) array
    """
    squares = np.asarray(singular_values) ** 2
    tail = np.append(np.cumsum(squares[::-1])[::-1], 0.0)
    return np.sqrt(tail / tail[0]) if tail[0] > 0 else tail


@dataclass(frozen=True, eq=False, repr=False)
class BackgroundSpace(Displayed):
    """A space V_n that an estimator uses, for reports: how well it approximates and how stably it is seen.

    Parameters
    ----------
    modes : (r, N) array
        Coefficients of the nested modes in the background's bases.
    singular_values : (k,) array
    tails : (N + 1,) array
        ε̂_n for n = 0 … N.
    inf_sup : (N,) array
        β_n for n = 1 … N.
    n : int
        The dimension in use.
    """

    modes: Array
    singular_values: Array
    tails: Array
    inf_sup: Array
    n: int

    def _card(self) -> Card:
        seen = self.n and self.n <= len(self.inf_sup)
        return Card(
            "BackgroundSpace",
            (
                ("dimension", f"{self.n} of at most {len(self.inf_sup)}"),
                ("tail", f"{self.tails[self.n]:.2e}" if self.n < len(self.tails) else ""),
                ("stability", f"{self.inf_sup[self.n - 1]:.2e}" if seen else ""),
            ),
        )
