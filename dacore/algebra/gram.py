"""Gram matrix and representers of functionals: K = ℓ M⁻¹ ℓᵀ = R Rᵀ.

Inner products act component by component, so only the scalar matrix of each field is factorised,
and functionals that repeat on another component (the three directions of a voxel image) are
solved for once.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_array

from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.estimator import Riesz
from dacore.core.observation import Functionals
from dacore.core.solver import LinearSolver
from dacore.core.space import Product, StateSpace
from dacore.errors import UnstableError


class RieszMap(Riesz):
    """Representers of functionals in a weighted product; solved for when asked.

    Parameters
    ----------
    space : StateSpace
    functionals : Functionals
    weights : mapping of str to float
        Weight of each field: {"u": 1, "p": ζ}.
    kind : {"l2", "h1"}
    """

    def __init__(
        self, space: StateSpace, functionals: Functionals, weights: Mapping[str, float], kind: Product = "l2"
    ) -> None:
        self.space = space
        self.functionals = functionals
        self.weights = dict(weights)
        self.kind = kind
        self._solvers: dict[str, LinearSolver] = {}
        self._field_grams: dict[str, Array] = {}

    @cached_property
    def seen(self) -> tuple[str, ...]:
        """Fields that the functionals see."""
        layout = self.space.layout
        return tuple(f.name for f in layout.fields if self.functionals.matrix[:, layout.block(f.name)].nnz)

    @cached_property
    def gram(self) -> Array:
        """K = ℓ M⁻¹ ℓᵀ (m, m)."""
        out = np.zeros((self.functionals.count,) * 2)
        for name in self.seen:
            self._add_gram(name, out)
        return np.asarray(0.5 * (out + out.T))

    def field_gram(self, field: str) -> Array:
        """Part of K (m, m) that comes from one field: times its weight, the products of the representers' field."""
        if self.seen == (field,):
            return self.gram
        if field not in self._field_grams:
            out = np.zeros((self.functionals.count,) * 2)
            if field in self.seen:
                self._add_gram(field, out)
            self._field_grams[field] = np.asarray(0.5 * (out + out.T))
        return self._field_grams[field]

    def _add_gram(self, name: str, out: Array) -> None:
        solved: dict[bytes, Array] = {}
        for component in range(self.space.layout.field(name).components):
            rows, block = self._component_rows(self.functionals.matrix, name, component)
            if rows.size == 0:
                continue
            key = block.indptr.tobytes() + block.indices.tobytes() + block.data.tobytes()
            if key not in solved:
                solved[key] = np.asarray(block @ self._solve(name, block.T.toarray())) / self.weights[name]
            out[np.ix_(rows, rows)] += solved[key]

    def lift(self, weights: Array) -> Array:
        """States M⁻¹ℓᵀz (n_dofs, ...) of weights z (m, ...)."""
        flat = weights.reshape(weights.shape[0], -1)
        load = np.asarray(self.functionals.matrix.T @ flat)
        out = np.zeros((self.space.n_dofs, flat.shape[1]))
        for name in self.seen:
            for component in range(self.space.layout.field(name).components):
                dofs = self.space.layout.component(name, component)
                if load[dofs].any():
                    out[dofs] = self._solve(name, load[dofs]) / self.weights[name]
        return out.reshape(self.space.n_dofs, *weights.shape[1:])

    def pair(self, functionals: Functionals) -> Array:
        """Return q M⁻¹ ℓᵀ (s, m), zero at once where q and ℓ share no component."""
        out = np.zeros((functionals.count, self.functionals.count))
        for name in self.seen:
            for component in range(self.space.layout.field(name).components):
                rows, block = self._component_rows(functionals.matrix, name, component)
                mine, measured = self._component_rows(self.functionals.matrix, name, component)
                if rows.size and mine.size:
                    solved = self._solve(name, block.T.toarray()) / self.weights[name]
                    out[np.ix_(rows, mine)] += np.asarray(measured @ solved).T
        return out

    def _component_rows(self, matrix: Sparse, name: str, component: int) -> tuple[IntArray, Sparse]:
        block = csr_array(matrix[:, self.space.layout.component(name, component)])
        rows = np.flatnonzero(np.diff(block.indptr))
        part = csr_array(block[rows])
        part.sort_indices()
        return rows, part

    def _solve(self, name: str, rhs: Array) -> Array:
        if name not in self._solvers:
            matrix = self.space.scalar_product(name, self.kind)
            self._solvers[name] = Auto().prepare(matrix, np.ones(matrix.shape[0], dtype=bool), 1e-12)
        return self._solvers[name].solve(rhs)


def orthonormaliser(gram: Array, labels: tuple[str, ...], mask: BoolArray | None = None) -> Array:
    """Lower Cholesky factor R (m, m) of the Gram matrix, refusing dependent functionals.

    Raises
    ------
    UnstableError
        If functionals are linearly dependent to round-off; names two of them.
    """
    keep = np.arange(len(gram)) if mask is None else np.flatnonzero(mask)
    part = gram[np.ix_(keep, keep)]
    size = np.sqrt(np.diag(part))
    scaled = part / np.outer(size, size)
    try:
        factor = np.asarray(cholesky(scaled, lower=True))
        smallest = float(np.diag(factor).min())
    except np.linalg.LinAlgError:
        smallest = 0.0
    if smallest < 1e-7:
        off = np.abs(scaled - np.eye(len(scaled)))
        i, j = np.unravel_index(int(off.argmax()), off.shape)
        raise UnstableError(
            f"functionals are linearly dependent; the closest pair is {labels[keep[i]]} and {labels[keep[j]]} "
            f"(cosine {off[i, j]:.9f}); drop duplicates"
        )
    return np.asarray(size[:, None] * factor)


def lower_solve(factor: Array, values: Array) -> Array:
    """R⁻¹ values for values (m, ...)."""
    flat = values.reshape(values.shape[0], -1)
    return np.asarray(solve_triangular(factor, flat, lower=True)).reshape(values.shape)


def lower_transpose_solve(factor: Array, values: Array) -> Array:
    """R⁻ᵀ values for values (m, ...)."""
    flat = values.reshape(values.shape[0], -1)
    return np.asarray(solve_triangular(factor, flat, lower=True, trans="T")).reshape(values.shape)
