"""The affine model projected on one basis a field: a small affine model, which grows with its bases.

Each field has modes of its own, so the blocks keep their structure: the projected step is symmetric
quasi-definite as the full one is, whatever the modes, and every scheme that is stable for the full model is
stable for the reduced one (`dacore.dynamics.scheme` needs no more than m, d, k ≥ 0).

A reduced state is z = (a, w): the coefficients a (r,) of the modes, fields one after the other, and the factors
w (n_loads,) of the loads, which prescribe the constrained dofs: y = V a + P w.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.reduction.split import SplitModel


@dataclass(frozen=True, eq=False, repr=False)
class TestedTerm(Displayed):
    """A term of the operator tested from the left and applied to modes and loads.

    Parameters
    ----------
    order : int
    blocks : mapping of (str, str) to (rows, r_g) array
        Of each group of rows and each field of columns.
    lifted : (rows in all, n_loads) array
    """

    order: int
    blocks: Mapping[tuple[str, str], Array]
    lifted: Array


@dataclass(frozen=True, eq=False, repr=False)
class Tested(Displayed):
    """All terms and forces, tested from the left: what a step of a reduced model needs.

    Parameters
    ----------
    terms : tuple of TestedTerm
    forces : (rows, n_loads) array
    rows, columns : mapping of str to slice
        Where each group of rows, and the coefficients of each field, lie.
    """

    terms: tuple[TestedTerm, ...]
    forces: Array
    rows: Mapping[str, slice]
    columns: Mapping[str, slice]

    def apply(self, order: int, coefficients: Array, states: Array) -> Array:
        """Σ of the terms of one order, applied to states.

        Parameters
        ----------
        order : int
        coefficients : (n_terms, K) array
        states : (r + n_loads, K) array

        Returns
        -------
        (rows, K) array
        """
        out = self.lift(order, coefficients, states[len(states) - self.forces.shape[1] :])
        for term, factors in zip(self.terms, coefficients, strict=True):
            if term.order == order:
                for (row, column), block in term.blocks.items():
                    out[self.rows[row]] += block @ (factors * states[self.columns[column]])
        return out

    def lift(self, order: int, coefficients: Array, weights: Array) -> Array:
        """The same for the prescribed values alone, of loads with factors `weights` (n_loads, K)."""
        out = np.zeros((len(self.forces), weights.shape[1]))
        for term, factors in zip(self.terms, coefficients, strict=True):
            if term.order == order:
                out += term.lifted @ (factors * weights)
        return out


def slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Consecutive slices of the given lengths."""
    ends = np.cumsum([0, *sizes.values()])
    return {name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends[:-1], ends[1:], strict=True)}


class Galerkin:
    """Bases of the fields, and the model projected on them.

    Parameters
    ----------
    split : SplitModel

    Attributes
    ----------
    bases : dict of str to (n_f, r_f) array
        Orthonormal modes on the free dofs of each field.
    """

    def __init__(self, split: SplitModel) -> None:
        self.split = split
        self.bases = {name: np.zeros((len(split.free[name]), 0)) for name in split.fields}
        self._blocks: list[dict[tuple[str, str], Array]] = [
            {pair: np.zeros((0, 0)) for pair in term.blocks} for term in split.terms
        ]

    @property
    def sizes(self) -> dict[str, int]:
        """Number of modes of each field."""
        return {name: basis.shape[1] for name, basis in self.bases.items()}

    @property
    def dimension(self) -> int:
        """Number r of modes of all fields."""
        return sum(self.sizes.values())

    def remainder(self, field: str, snapshots: Array) -> Array:
        """What the basis of `field` leaves of snapshots (n_f, k); projected twice, for round-off."""
        basis, product = self.bases[field], self.split.products[field]
        left = snapshots
        for _ in range(2 if basis.shape[1] else 0):
            left = left - basis @ (basis.T @ (product @ left))
        return left

    def extend(self, news: Mapping[str, Array]) -> None:
        """Append modes (n_f, k_f), which must be nearly orthonormal, to the bases of some fields."""
        clean = {name: self._orthonormal(name, modes) for name, modes in news.items()}
        old = self.bases
        self.bases = {
            name: np.concatenate([basis, clean[name]], axis=1) if name in clean else basis
            for name, basis in old.items()
        }
        for blocks, term in zip(self._blocks, self.split.terms, strict=True):
            for (row, column), matrix in term.blocks.items():
                block = blocks[row, column]
                if column in clean:
                    right = (
                        old[row].T @ (matrix @ clean[column])
                        if old[row].shape[1]
                        else np.zeros((0, clean[column].shape[1]))
                    )
                    block = np.concatenate([block.reshape(old[row].shape[1], old[column].shape[1]), right], axis=1)
                if row in clean:
                    below = (matrix.T @ clean[row]).T @ self.bases[column]
                    block = np.concatenate([block.reshape(old[row].shape[1], self.bases[column].shape[1]), below])
                blocks[row, column] = block

    def turned(self, turns: Mapping[str, Array]) -> "Galerkin":
        """Return the model on the modes V U in place of V, for orthonormal columns U (r_f, r'_f) of each field."""
        out = Galerkin(self.split)
        out.bases = {name: basis @ turns[name] for name, basis in self.bases.items()}
        out._blocks = [
            {(row, column): turns[row].T @ block @ turns[column] for (row, column), block in blocks.items()}
            for blocks in self._blocks
        ]
        return out

    def _orthonormal(self, field: str, modes: Array) -> Array:
        modes = self.remainder(field, modes)
        gram = modes.T @ (self.split.products[field] @ modes)
        return np.asarray(solve_triangular(cholesky(gram, lower=False), modes.T, trans="T", lower=False).T)

    def tested(self) -> Tested:
        """The model projected on the bases."""
        where = slices(self.sizes)
        terms = []
        for blocks, term in zip(self._blocks, self.split.terms, strict=True):
            lifted = np.concatenate([self.bases[name].T @ term.lifted[name] for name in self.split.fields])
            terms.append(TestedTerm(term.order, dict(blocks), lifted))
        forces = np.concatenate([self.bases[name].T @ self.split.forces[name] for name in self.split.fields])
        return Tested(tuple(terms), forces, where, where)

    def initial(self) -> Array:
        """Coefficients (r, n_loads) at t = 0 of the initial state that each load gives."""
        parts = [self.bases[f].T @ (self.split.products[f] @ self.split.initial[f]) for f in self.split.fields]
        return np.concatenate(parts)


class Sketch:
    """The model tested with a few fixed vectors, and applied to the modes of a growing `Galerkin`.

    Parameters
    ----------
    split : SplitModel
    tests : mapping of str to (n_f, s) array
        The same s vectors by fields.
    """

    GROUP = "tests"

    def __init__(self, split: SplitModel, tests: Mapping[str, Array]) -> None:
        self.split = split
        count = next(iter(tests.values())).shape[1]
        # (term applied from the right to the tests), so that new modes cost one dense product each
        self._images = [
            {column: _total([term.blocks[r, c].T @ tests[r] for r, c in term.blocks if c == column])
             for column in {c for _, c in term.blocks}}
            for term in split.terms
        ]  # fmt: skip
        self._lifted = [_total([tests[name].T @ term.lifted[name] for name in split.fields]) for term in split.terms]
        self._forces = _total([tests[name].T @ split.forces[name] for name in split.fields])
        self._rows = {self.GROUP: slice(0, count)}

    def tested(self, galerkin: Galerkin) -> Tested:
        """The tested model on the modes that `galerkin` has now."""
        terms = tuple(
            TestedTerm(
                term.order,
                {(self.GROUP, column): image.T @ galerkin.bases[column] for column, image in images.items()},
                lifted,
            )
            for term, images, lifted in zip(self.split.terms, self._images, self._lifted, strict=True)
        )
        return Tested(terms, self._forces, self._rows, slices(galerkin.sizes))


def _total(parts: Sequence[Array]) -> Array:
    return np.asarray(sum(parts[1:], start=parts[0]))
