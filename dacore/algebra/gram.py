"""Gram matrix and representers of functionals: K = ℓ M⁻¹ ℓᵀ = R Rᵀ.

Inner products act component by component, so only the scalar matrix of each field is factorised,
and functionals that repeat on another component (the three directions of a voxel image) are
solved for once.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import overload

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from dacore.algebra.blocks import Blocks, LowerBlocks
from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.estimator import Riesz
from dacore.core.observation import Functionals
from dacore.core.solver import LinearSolver
from dacore.core.space import Product, StateSpace

# Bytes of right-hand sides solved for at once: more columns would leave the processor's cache.
_PORTION = 2**24


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
        self._solvers: dict[str, tuple[Sparse, LinearSolver]] = {}
        self._field_grams: dict[str, Blocks] = {}

    @cached_property
    def seen(self) -> tuple[str, ...]:
        """Fields that the functionals see."""
        layout = self.space.layout
        return tuple(f.name for f in layout.fields if self.functionals.matrix[:, layout.block(f.name)].nnz)

    @cached_property
    def blocks(self) -> Blocks:
        """K = ℓ M⁻¹ ℓᵀ (m, m), block by block: functionals that share no component do not meet in it."""
        return self._assembled(self.seen)

    @property
    def gram(self) -> Array:
        """K = ℓ M⁻¹ ℓᵀ as one array (m, m); `blocks` holds the same in less memory."""
        return self.blocks.dense()

    def field_gram(self, field: str) -> Blocks:
        """Part of K (m, m) that comes from one field: times its weight, the products of the representers' field."""
        if self.seen == (field,):
            return self.blocks
        if field not in self._field_grams:
            self._field_grams[field] = self._assembled((field,) if field in self.seen else ())
        return self._field_grams[field]

    def _assembled(self, names: Sequence[str]) -> Blocks:
        """Sum over fields of ℓ M⁻¹ ℓᵀ, each different part of it solved for once."""
        units: list[_Unit] = []
        for name in names:
            for component in range(self.space.layout.field(name).components):
                rows, part = self._component_rows(self.functionals.matrix, name, component)
                if rows.size:
                    units.append(_Unit(name, rows, _fingerprint(part), part))
        solved: dict[tuple[str, bytes], Array] = {}
        for unit in units:
            if unit.key not in solved:
                solved[unit.key] = self._scalar_gram(unit.field, unit.part) / self.weights[unit.field]
        groups: dict[Hashable, tuple[list[IntArray], Array]] = {}
        for together in _joined(units, self.functionals.count):
            rows = np.unique(np.concatenate([unit.rows for unit in together]))
            places = [np.searchsorted(rows, unit.rows) for unit in together]
            key = tuple((unit.key, len(rows), place.tobytes()) for unit, place in zip(together, places, strict=True))
            if key not in groups:
                block = np.zeros((len(rows),) * 2)
                for unit, place in zip(together, places, strict=True):
                    block[np.ix_(place, place)] += solved[unit.key]
                groups[key] = ([], block)
            groups[key][0].append(rows)
        blind = np.ones(self.functionals.count, dtype=bool)
        for unit in units:
            blind[unit.rows] = False
        parts = [(np.array(rows), block) for rows, block in groups.values()]
        if blind.any():
            parts.append((np.flatnonzero(blind)[:, None], np.zeros((1, 1))))
        return Blocks(self.functionals.count, parts)

    def _scalar_gram(self, name: str, part: Sparse) -> Array:
        """ℓ M⁻¹ ℓᵀ of scalar functionals (k, n_nodes), a few columns at a time."""
        out = np.empty((part.shape[0],) * 2)
        for rows in _portions(*part.shape):
            out[:, rows] = part @ self._solve(name, part[rows].T.toarray())
        return np.asarray(0.5 * (out + out.T))

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
                    for some in _portions(*block.shape):
                        solved = self._solve(name, block[some].T.toarray()) / self.weights[name]
                        out[np.ix_(rows[some], mine)] += np.asarray(measured @ solved).T
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
            # Fields of one element share the matrix, and then its factor.
            for known, solver in self._solvers.values():
                if _equal(known, matrix):
                    self._solvers[name] = known, solver
                    break
            else:
                solver = Auto().prepare(matrix, np.ones(matrix.shape[0], dtype=bool), 1e-12)
                self._solvers[name] = matrix, solver
        return self._solvers[name][1].solve(rhs)


@dataclass(frozen=True, eq=False)
class _Unit:
    """Functionals on one component of a field: their numbers, and their scalar matrix with a fingerprint of it."""

    field: str
    rows: IntArray
    print: bytes
    part: Sparse

    @property
    def key(self) -> tuple[str, bytes]:
        return self.field, self.print


def _fingerprint(part: Sparse) -> bytes:
    digest = sha256(np.array(part.shape).tobytes())
    for each in (part.indptr, part.indices, part.data):
        digest.update(np.ascontiguousarray(each).tobytes())
    return digest.digest()


def _equal(a: Sparse, b: Sparse) -> bool:
    return a is b or (
        a.shape == b.shape
        and a.nnz == b.nnz
        and np.array_equal(a.indptr, b.indptr)
        and np.array_equal(a.indices, b.indices)
        and np.array_equal(a.data, b.data)
    )


def _joined(units: Sequence[_Unit], count: int) -> list[list[_Unit]]:
    """Units in groups: two that a functional sees at once are in one."""
    owner = np.full(count, -1)
    group = list(range(len(units)))
    for number, unit in enumerate(units):
        met = np.unique(owner[unit.rows])
        for other in met[met >= 0]:
            old, new = group[other], group[number]
            group = [new if each == old else each for each in group]
        owner[unit.rows] = number
    return [[unit for unit, own in zip(units, group, strict=True) if own == each] for each in dict.fromkeys(group)]


def _portions(count: int, length: int) -> list[slice]:
    """Parts of `count` columns of some length, each small against everything else in memory."""
    step = max(_PORTION // (8 * length), 1)
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


@overload
def orthonormaliser(gram: Array, labels: tuple[str, ...], mask: BoolArray | None = None) -> Array: ...


@overload
def orthonormaliser(gram: Blocks, labels: tuple[str, ...], mask: BoolArray | None = None) -> LowerBlocks: ...


def orthonormaliser(
    gram: Array | Blocks, labels: tuple[str, ...], mask: BoolArray | None = None
) -> Array | LowerBlocks:
    """Lower Cholesky factor R of the Gram matrix, refusing dependent functionals.

    Parameters
    ----------
    gram : (m, m) array or Blocks
    labels : m str
    mask : (m,) bool array, optional
        Functionals to keep.

    Returns
    -------
    (m, m) array, or LowerBlocks from Blocks

    Raises
    ------
    UnstableError
        If functionals are linearly dependent to round-off; names two of them.
    """
    blocks = gram if isinstance(gram, Blocks) else Blocks.of(gram)
    keep = np.arange(blocks.size) if mask is None else np.flatnonzero(mask)
    factor = blocks.kept(mask).factor(tuple(labels[i] for i in keep))
    return factor if isinstance(gram, Blocks) else factor.dense()


def lower_solve(factor: Array | LowerBlocks, values: Array) -> Array:
    """R⁻¹ values for values (m, ...)."""
    if isinstance(factor, LowerBlocks):
        return factor.solve(values)
    flat = values.reshape(values.shape[0], -1)
    return np.asarray(solve_triangular(factor, flat, lower=True)).reshape(values.shape)


def lower_transpose_solve(factor: Array | LowerBlocks, values: Array) -> Array:
    """R⁻ᵀ values for values (m, ...)."""
    if isinstance(factor, LowerBlocks):
        return factor.solve(values, transposed=True)
    flat = values.reshape(values.shape[0], -1)
    return np.asarray(solve_triangular(factor, flat, lower=True, trans="T")).reshape(values.shape)
