"""A reduced model: trajectories for any parameters on a few hundred coordinates, each with an estimate of its error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dacore.core.arrays import Array
from dacore.core.display import Displayed
from dacore.core.model import AffineModel
from dacore.core.parameters import Parameters
from dacore.reduction.galerkin import Galerkin, Tested
from dacore.reduction.indicator import Indicator
from dacore.reduction.kinds import Reducible, affine_of, reduced_solver
from dacore.reduction.solver import ReducedSolver
from dacore.reduction.split import amplitudes_of, coefficients_of


@dataclass(frozen=True, eq=False, repr=False)
class ReducedModel(Displayed):
    """An affine model projected on its modes, and what moves it: its scheme and time grid, or its frequency.

    A reduced state holds the coefficients of the modes, fields one after the other, and the factors of the
    loads, which prescribe the constrained dofs.

    Parameters
    ----------
    model : AffineModel
        For the coefficients of its terms and the amplitudes of its loads; no matrix of it is used.
    march : ReducedSolver
    indicator : Indicator
    lift_products : mapping of str to (r_f, n_loads) array
        Inner products of the modes of each field with the prescribed values of each load.
    lift_grams : mapping of str to (n_loads, n_loads) array
        Inner products of the prescribed values of the loads.
    onto : (r_b, r + n_loads) array, optional
        From reduced states to coefficients in the bases of a background, once there is one.
    """

    model: AffineModel
    march: ReducedSolver
    indicator: Indicator
    lift_products: Mapping[str, Array]
    lift_grams: Mapping[str, Array]
    onto: Array | None = None

    @classmethod
    def of(cls, full: Reducible, galerkin: Galerkin, sketch: Tested, factor: Array) -> "ReducedModel":
        """Return the model that `galerkin` has projected, moving as `full` does."""
        split = galerkin.split
        products, grams = {}, {}
        for name in split.fields:
            values, free = split.prescribed[name], split.free[name]
            weighted = np.asarray(full.space.field_product(name, split.kind) @ values)
            products[name] = galerkin.bases[name].T @ weighted[free]
            grams[name] = values.T @ weighted
        flow = tuple(split.flow[name] for name in split.fields)
        march = reduced_solver(full, galerkin.tested(), flow, galerkin.initial())
        return cls(affine_of(full), march, Indicator(sketch, factor), products, grams)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(self.march.tested.columns)

    @property
    def dimension(self) -> int:
        """Number r of modes."""
        return len(self.march.tested.forces)

    @property
    def times(self) -> Array:
        """Recorded times (t,) [s]."""
        return self.march.times

    def solve(self, points: Sequence[Parameters]) -> Array:
        """Solve K parameter vectors.

        Parameters
        ----------
        points : sequence of K mappings of str to float

        Returns
        -------
        (r + n_loads, t, K) array
            Reduced states at the recorded times.
        """
        return self.march.run(coefficients_of(self.model, points), amplitudes_of(self.model, points))

    def estimate(self, points: Sequence[Parameters]) -> tuple[Array, Array]:
        """Solve K parameter vectors and estimate their errors.

        Returns
        -------
        states : (r + n_loads, t, K) array
        errors : (n_fields, K) array
            Estimated relative space–time error of each field.
        """
        states, indicated = self.indicate(coefficients_of(self.model, points), amplitudes_of(self.model, points))
        return states, self.indicator.factor[:, None] * indicated

    def indicate(self, coefficients: Array, amplitudes: Array) -> tuple[Array, Array]:
        """As `estimate`, without the factor, for coefficients (n_terms, K) and amplitudes (n_loads, K)."""
        watch = self.indicator.watch(coefficients)
        states = self.march.run(coefficients, amplitudes, watch)
        norms = self.norms(states)
        return states, np.divide(watch.values, norms, out=np.zeros_like(norms), where=norms > 0)

    def norms(self, states: Array) -> Array:
        """Space–time norm (n_fields, K) of each field of reduced states (r + n_loads, t, K)."""
        weights = states[self.dimension :]
        out = []
        for name, rows in self.march.tested.columns.items():
            part = states[rows]
            squares = (part**2).sum(axis=(0, 1))
            squares += 2 * np.einsum("rtk,rl,ltk->k", part, self.lift_products[name], weights, optimize=True)
            squares += np.einsum("ltk,lm,mtk->k", weights, self.lift_grams[name], weights, optimize=True)
            out.append(np.sqrt(np.maximum(squares, 0.0)))
        return np.array(out)

    def on(self, onto: Array) -> "ReducedModel":
        """Return the same model, which knows the bases of a background by `onto` (r_b, r + n_loads)."""
        return replace(self, onto=onto)
