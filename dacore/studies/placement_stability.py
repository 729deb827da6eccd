"""Measurements by which a background space is seen most stably: the largest β(V_n, W)."""

from dataclasses import dataclass

import numpy as np

from dacore.algebra.gram import RieszMap
from dacore.core.arrays import Array, IntArray
from dacore.core.background import Background
from dacore.core.display import Displayed
from dacore.core.observation import Functionals
from dacore.errors import ShapeError
from dacore.estimators.frames import Centring, Weights, build_frames, field_weights, offset_of
from dacore.studies.placement import Candidates, Criterion, check_candidates

# A representer that lies so nearly in the span of those chosen (squared distance over squared length) adds nothing.
_DEPENDENT = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Seen(Displayed):
    """What the chosen representers make of the rest.

    Parameters
    ----------
    left : (l,) int array
        Functionals that are not chosen.
    gram : (l, l) array
        Of the parts of their representers orthogonal to the chosen ones.
    observed : (l, n) array
        The modes along these parts.
    cross : (q, n) array, q <= n
        With the singular values of G, of the chosen.
    rank : int
        Independent representers chosen.
    """

    left: IntArray
    gram: Array
    observed: Array
    cross: Array
    rank: int


class Stability(Criterion[Seen]):
    """β_n of a background space, seen through the representers of the chosen functionals.

    β_n is zero until there are as many functionals as modes. While no candidate brings that about, a candidate's
    merit is the stability of the leading modes, of as many as the largest candidate left brings the functionals to.

    Parameters
    ----------
    gram : (m, m) array
        K = ℓ M⁻¹ ℓᵀ of all functionals.
    observed : (m, n) array
        Functionals of the orthonormal modes.
    candidates : g index arrays
    """

    larger_is_better = True

    def __init__(self, gram: Array, observed: Array, candidates: Candidates) -> None:
        m, self.dimension = observed.shape
        if gram.shape != (m, m) or self.dimension < 1:
            raise ShapeError(f"gram: got shape {gram.shape} for observed modes {observed.shape}, expected ({m}, {m})")
        check_candidates(candidates, m)
        self._gram, self._observed, self._candidates = gram, observed, candidates
        self._size = np.diag(gram).copy()

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self._candidates)

    def nothing(self) -> Seen:
        """No functional chosen."""
        left = np.sort(np.concatenate(self._candidates))
        return Seen(left, self._gram[np.ix_(left, left)], self._observed[left], np.zeros((0, self.dimension)), 0)

    def add(self, state: Seen, candidate: int) -> Seen:
        """One step of a block Cholesky factorisation."""
        inside, factor = self._orthonormal(state, candidate)
        others = np.setdiff1d(np.arange(len(state.left)), inside, assume_unique=True)
        along = state.gram[np.ix_(others, inside)] @ factor
        rows = factor.T @ state.observed[inside]
        return Seen(
            state.left[others],
            state.gram[np.ix_(others, others)] - along @ along.T,
            state.observed[others] - along @ rows,
            _condensed(np.vstack([state.cross, rows])),
            state.rank + factor.shape[1],
        )

    def value(self, state: Seen) -> float:
        """β_n of the whole space."""
        return _smallest(state.cross, self.dimension)

    def merit(self, state: Seen, candidate: int) -> float:
        """β of the leading modes with this candidate."""
        present = np.zeros(len(self._size), dtype=bool)
        present[state.left] = True
        most = max(len(each) for each in self._candidates if present[each[0]])
        inside, factor = self._orthonormal(state, candidate)
        cross = np.vstack([state.cross, factor.T @ state.observed[inside]])
        return _smallest(cross, min(self.dimension, state.rank + most))

    def _orthonormal(self, state: Seen, candidate: int) -> tuple[IntArray, Array]:
        """Places (c,) of a candidate among those left, and weights (c, q) that make its representers orthonormal."""
        group = np.sort(self._candidates[candidate])
        inside = np.searchsorted(state.left, group)
        if not np.array_equal(state.left[np.minimum(inside, len(state.left) - 1)], group):
            raise ShapeError(f"candidate {candidate}: is chosen already")
        # Scaled to unit length, so that what is dependent does not hang on units.
        size = np.sqrt(self._size[group])
        values, vectors = np.linalg.eigh(state.gram[np.ix_(inside, inside)] / size[:, None] / size[None])
        kept = values > _DEPENDENT
        return inside, vectors[:, kept] / size[:, None] / np.sqrt(values[kept])


def stability_of(
    background: Background,
    functionals: Functionals,
    candidates: Candidates,
    n: int,
    weights: Weights = "balanced",
    centring: Centring = "cycle",
) -> Stability:
    """β_n of the joint space of n modes over the cycle, as PBDW makes it.

    Parameters
    ----------
    background : Background
    functionals : Functionals
    candidates : g index arrays
    n : int
    weights : mapping of str to float, or "balanced"
        Of the fields in the joint product.
    centring : {"none", "cycle", "phase"}
    """
    training = background.coefficients
    offset = offset_of(training, centring)
    chosen = field_weights(background, weights, training - offset[:, :, None])
    (frame,) = build_frames(training, offset, background.scale(chosen), "cycle", n)
    if frame.modes.shape[1] < n:
        raise ShapeError(f"dimension: got {n}, expected 1 to {frame.modes.shape[1]}, the rank of the training set")
    riesz = RieszMap(background.space, functionals, chosen, background.kind)
    return Stability(riesz.gram, background.observe(functionals.matrix) @ frame.modes[:, :n], candidates)


def _condensed(cross: Array) -> Array:
    """No more rows than columns, with the same singular values of all leading columns."""
    return cross if len(cross) <= cross.shape[1] else np.asarray(np.linalg.qr(cross, mode="r"))


def _smallest(cross: Array, n: int) -> float:
    """σ_min of the first n columns; 0 if there are fewer rows."""
    if len(cross) < n:
        return 0.0
    return min(1.0, float(np.linalg.svd(cross[:, :n], compute_uv=False)[-1]))
