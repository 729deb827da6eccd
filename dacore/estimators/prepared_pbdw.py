"""The prepared half of PBDW: spaces, stability, fits and readouts."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dacore.algebra.gram import RieszMap, lower_solve, orthonormaliser
from dacore.algebra.stability import inf_sup_constants
from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import (
    BackgroundSpace,
    Estimate,
    PreparedEstimator,
    Readout,
    check_data,
    check_mask,
    check_scale,
    weights_of,
)
from dacore.core.misfit import Misfit
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import CapabilityError, ShapeError, UnstableError
from dacore.estimators.box import ranges
from dacore.estimators.choice import Choice
from dacore.estimators.dimension import Without, held_out_squares, residual_squares
from dacore.estimators.frames import Fold, Frame, balanced_weights, held_out_frames
from dacore.estimators.held_out import Linear, Sampled
from dacore.estimators.metrics import Blended, Exact, Metric, NoiseWeighted, Pencil
from dacore.estimators.plausible import Plausibility
from dacore.estimators.projection import Projection
from dacore.estimators.surprise import of_steps, unlearned

if TYPE_CHECKING:
    from dacore.estimators.pbdw import PBDW, Rule

SMALLEST_INF_SUP = 1e-10


class PreparedPBDW(PreparedEstimator):
    """PBDW with everything done that does not depend on data.

    Attributes
    ----------
    frames : tuple of Frame
        One, or one for each observed step.
    cross : list of (m, N) array
        G of each frame.
    constants : list of (N,) array
        β_n of each frame.
    dimensions : (len(frames),) int array
        The n in use; where noise or data choose it, that for exact data, and `choose` gives it for others.
    weights : dict
        Field weights in use.
    """

    def __init__(
        self,
        settings: "PBDW",
        background: Background,
        functionals: Functionals,
        noise: NoiseModel,
        steps: IntArray,
        offset: Array,
        frames: Sequence[Frame],
        riesz: RieszMap,
        weights: dict[str, float],
        mask: BoolArray | None = None,
        folds: list[Fold] | None = None,
        observed: Array | None = None,
    ) -> None:
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps, self.offset, self.frames, self.riesz, self.weights = steps, offset, tuple(frames), riesz, weights
        self._folds = folds
        self.observed_modes = background.observe(functionals.matrix) if observed is None else observed
        self.keep = np.arange(functionals.count) if mask is None else np.flatnonzero(mask)
        self._seen = self.observed_modes[self.keep]
        self._kept_noise = noise if mask is None else noise.marginal(mask)
        self.metric, self.cross = self._weigh(mask)
        self.constants = [inf_sup_constants(cross) for cross in self.cross]
        training = background.coefficients[:, steps]
        self._plausibility = Plausibility(self._seen, training, self._kept_noise)
        self.projection = self._project(self.offset, [frame.modes for frame in self.frames], self.metric)
        self.dimensions = np.array(
            [self._choose(frame, beta) for frame, beta in zip(self.frames, self.constants, strict=True)]
        )
        if settings.n == "noise":
            self.dimensions = self.choice.dimensions("noise", np.zeros(0), np.zeros(1), settings.missed)[:, 0]

    def _weigh(self, mask: BoolArray | None) -> tuple[Metric, list[Array]]:
        """How data are weighed, and the modes in the coordinates of orthonormal representers."""
        modes = [self._seen @ frame.modes for frame in self.frames]
        if self.settings.fit == "regularised":
            pencil = Pencil.of(self.riesz.blocks.kept(mask), self._kept_noise)
            return Blended(pencil), [pencil.representers(each) for each in modes]
        factor = orthonormaliser(self.riesz.blocks, self.functionals.labels, mask)
        cross = [lower_solve(factor, each) for each in modes]
        exact = self.settings.fit == "exact"
        return Exact(factor, self._kept_noise) if exact else NoiseWeighted(self._kept_noise), cross

    def _project(
        self, offset: Array, modes: Sequence[Array], metric: Metric, who: BoolArray | slice = slice(None)
    ) -> Projection:
        """Spaces in the metric of the fit, with the box of the trajectories they are built from."""
        limits = None
        if self.settings.box is not None:
            scale = self.background.scale(self.weights)
            away = self.background.coefficients[:, self.steps][:, :, who] - offset[:, :, None]
            limits = []
            for k, each in enumerate(modes):
                part = away if len(modes) == 1 else away[:, k : k + 1]
                found = np.tensordot((scale[:, None] ** 2 * each).T, part, axes=1)
                limits.append(ranges(found, self.settings.box))
        return Projection(offset, modes, self._seen, metric, limits)

    @property
    def _corrects(self) -> bool:
        return self.settings.correction and self.metric.corrects

    def _usable(self, constants: Array) -> int:
        return int((constants >= SMALLEST_INF_SUP).sum())

    def _choose(self, frame: Frame, constants: Array) -> int:
        wanted = self.settings.n
        if len(constants) == 0:
            return 0
        if isinstance(wanted, str):
            curve = self.bound(frame, constants)
            if not np.isfinite(curve).any():
                raise UnstableError(
                    f"β_1 = {constants[0]:.1e}: the {len(self.keep)} functionals see no mode of the background space; "
                    "check the weights ζ and what is measured"
                )
            return int(np.argmin(curve)) + 1 if wanted == "bound" else self._usable(constants)
        if wanted > len(constants):
            raise ShapeError(
                f"n: got {wanted}, but the background has only {len(constants)} modes; lower n or train on more samples"
            )
        if constants[wanted - 1] < SMALLEST_INF_SUP:
            raise UnstableError(
                f"β_{wanted} = {constants[wanted - 1]:.1e}: the {len(self.keep)} functionals do not see all of "
                f"{wanted} modes; expected at least {SMALLEST_INF_SUP:.0e}, reached up to n = "
                f"{self._usable(constants)}: lower n"
            )
        return wanted

    @staticmethod
    def bound(frame: Frame, constants: Array) -> Array:
        """ε̂_n/β_n for n = 1 … N, infinite where β_n vanishes (docs/method.md: PBDW)."""
        tails = frame.tails[1 : len(constants) + 1]
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(constants >= SMALLEST_INF_SUP, tails / constants, np.inf))

    @property
    def inf_sup(self) -> Array:
        """β_n (t,) in use at each observed step; NaN where nothing varies and no mode is in use."""
        values = np.array(
            [beta[n - 1] if n else np.nan for beta, n in zip(self.constants, self.dimensions, strict=True)]
        )
        return np.broadcast_to(values, (len(self.steps),)).copy() if len(values) == 1 else values

    def spaces(self) -> tuple[BackgroundSpace, ...]:
        """The space of the cycle, or that of each observed step."""
        return tuple(
            BackgroundSpace(frame.modes, frame.singular_values, frame.tails[: len(beta) + 1], beta, int(n))
            for frame, beta, n in zip(self.frames, self.constants, self.dimensions, strict=True)
        )

    def masked(self, mask: BoolArray) -> "PreparedPBDW":
        """Return the same estimator on the functionals of `mask` (m,); Gram matrix and spaces are reused."""
        flags = check_mask(mask, self.functionals.count)
        return PreparedPBDW(
            self.settings, self.background, self.functionals, self.noise, self.steps, self.offset, self.frames,
            self.riesz, self.weights, flags, self._folds, self.observed_modes,
        )  # fmt: skip

    def by(self, rule: "int | Rule") -> "PreparedPBDW":
        """Return the same estimator with another dimension, or another rule for it."""
        return PreparedPBDW(
            replace(self.settings, n=rule), self.background, self.functionals, self.noise, self.steps, self.offset,
            self.frames, self.riesz, self.weights, folds=self._folds, observed=self.observed_modes,
        )  # fmt: skip

    @cached_property
    def plain(self) -> Projection:
        """The spaces weighted by the noise alone, which tell what they leave of data."""
        if self._is_plain:
            return self.projection
        modes = [frame.modes for frame in self.frames]
        return Projection(self.offset, modes, self._seen, NoiseWeighted(self._kept_noise))

    @property
    def _is_plain(self) -> bool:
        return isinstance(self.metric, NoiseWeighted) and self.settings.box is None

    @cached_property
    def without(self) -> list[Without]:
        """Spaces built without each group of training trajectories in turn."""
        if self._folds is None:
            self._folds = held_out_frames(
                self.background.coefficients[:, self.steps], self.settings.centring,
                self.background.scale(self.weights), self.settings.spaces,
                max(frame.modes.shape[1] for frame in self.frames),
            )  # fmt: skip
        found = []
        for fold in self._folds:
            modes = [frame.modes for frame in fold.frames]
            own = self._project(fold.offset, modes, self.metric, ~fold.mask)
            noise = own if self._is_plain else Projection(
                fold.offset, modes, self._seen, NoiseWeighted(self._kept_noise)
            )  # fmt: skip
            found.append(Without(fold.mask, own, noise))
        return found

    @property
    def _top(self) -> int:
        """Largest n that may be asked for."""
        return max(self._usable(beta) for beta in self.constants)

    @cached_property
    def _left(self) -> Array:
        """Squares (N + 1, t, K) of what the spaces leave of trajectories they have not seen, in units of the noise."""
        return held_out_squares(self.without, self._seen, self.background.coefficients[:, self.steps], self._top)

    @cached_property
    def choice(self) -> Choice:
        """Rules for what data or noise choose."""
        training = self.background.coefficients[:, self.steps]
        balanced = balanced_weights(self.background, training - training.mean(axis=2, keepdims=True))
        shares = [balanced[name] / self.weights[name] for name in self.riesz.seen]
        return Choice(
            self.projection, self.metric.pencil if isinstance(self.metric, Blended) else None,
            self.without, self._seen, training, self._left, np.array([self._usable(beta) for beta in self.constants]),
            self.background.scale(balanced), min(shares) if self._corrects else 0.0,
        )  # fmt: skip

    def choose(self, data: Array, noise_scale: Array | float = 1.0) -> IntArray:
        """Dimensions (spaces, k) that `estimate` takes for each series of data (m, t, k)."""
        raw = check_data(data, self.functionals.count, len(self.steps))
        scale = check_scale(noise_scale, raw.shape[2])
        return self._dimensions(self._squares(raw[self.keep]), scale)

    def _squares(self, values: Array) -> Array:
        return residual_squares(self.plain, self.plain.turned(values), self._top)

    def estimated(
        self, fold: Without, values: Array, scale: Array, used: IntArray | None
    ) -> tuple[Array, Array | None]:
        """Coefficients and weights of the correction that spaces without some trajectories give kept data (m, t, k).

        Parameters
        ----------
        fold : Without
        values : (m, t, k) array
        scale : (k,) array
        used : (spaces,) int array or None
            n of each space; None where the data choose it.
        """
        if used is None:
            squares = residual_squares(fold.plain, fold.plain.turned(values), self._top)
            chosen = self._dimensions(squares, scale)
        else:
            chosen = np.tile(used[:, None], (1, len(scale)))
        there = np.array([modes.shape[1] for modes in fold.projection.modes])
        chosen = np.minimum(chosen, there[:, None])
        turned = fold.projection.turned(values)
        ratios = self.ratios(chosen, scale, turned, fold.projection)
        return fold.projection.fit(turned, chosen, ratios, self._corrects)

    def _dimensions(self, squares: Array, scale: Array) -> IntArray:
        if self.settings.n in ("noise", "gcv", "discrepancy"):
            return self.choice.dimensions(str(self.settings.n), squares, scale, self.settings.missed)
        return np.tile(self.dimensions[:, None], (1, len(scale)))

    def ratios(self, dimensions: IntArray, scale: Array, turned: Array, projection: Projection | None = None) -> Array:
        """λ (spaces, k) of each series; 0 for a fit that has none."""
        if not isinstance(self.metric, Blended):
            return np.zeros(dimensions.shape)
        return self.choice.ratios(self.settings.missed, dimensions, scale, turned, projection or self.projection)

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states; an exact fit with a fixed n does not look at the noise scale but for the misfit."""
        return next(self._each(data, noise_scale, mask, None))[1]

    def estimate_each(
        self, data: Array, noise_scale: Array | float, dimensions: Sequence[int], mask: BoolArray | None = None
    ) -> Iterator[tuple[int, Estimate]]:
        """Yield n and the estimate with it, for each of several n: what errors are as a function of n.

        Parameters
        ----------
        data, noise_scale, mask
            As `estimate` takes them.
        dimensions : sequence of int
            At least 1; those that the functionals do not see are refused, and a space with fewer modes uses all.

        Raises
        ------
        ShapeError
            If a dimension is larger than any space offers.
        """
        wrong = [n for n in dimensions if not 1 <= n <= self._top]
        if wrong:
            raise ShapeError(f"dimensions: got {wrong[0]}, expected 1 to {self._top}, which is seen stably")
        return self._each(data, noise_scale, mask, dimensions)

    def _each(
        self, data: Array, noise_scale: Array | float, mask: BoolArray | None, dimensions: Sequence[int] | None
    ) -> Iterator[tuple[int, Estimate]]:
        flags = check_mask(mask, self.functionals.count)
        raw = check_data(data, self.functionals.count, len(self.steps), flags)
        scale = check_scale(noise_scale, raw.shape[2])
        if flags is not None:
            yield from self.masked(flags)._each(raw, scale, None, dimensions)
            return
        values = raw[self.keep]
        self._plausibility.check(values, scale)
        squares, turned = self._squares(values), self.projection.turned(values)
        for n in dimensions or (0,):
            usable = np.array([self._usable(beta) for beta in self.constants])
            used = np.tile(np.minimum(n, usable)[:, None], (1, len(scale))) if n else self._dimensions(squares, scale)
            ratios = self.ratios(used, scale, turned)
            yield n, self._estimate(turned, used, ratios, scale, self._misfit(squares, used, scale))

    def _estimate(self, turned: Array, used: IntArray, ratios: Array, scale: Array, misfit: Misfit | None) -> Estimate:
        coefficients, z = self.projection.fit(turned, used, ratios, self._corrects)
        correction = None
        if z is not None:
            correction = np.zeros((self.functionals.count, *z.shape[1:]))
            correction[self.keep] = z
        uncertainty = Linear(self, used, ratios, scale) if self.settings.affine else Sampled(self, scale, used)
        return Estimate(self.background, self.steps, coefficients, correction, self.riesz, uncertainty, misfit)

    @cached_property
    def _unlearned(self) -> float:
        return unlearned(self.background, self._seen, self._kept_noise)

    def _misfit(self, squares: Array, used: IntArray, scale: Array) -> Misfit | None:
        """What V_n leaves of the data, against noise and what it leaves of trajectories held out."""
        if self.background.n_samples < 3:
            return None
        steps = np.arange(len(self.steps))
        rows = used if len(used) > 1 else np.repeat(used, len(steps), axis=0)
        own = squares[rows, steps[:, None], np.arange(len(scale))]
        held = np.moveaxis(self._left[rows, steps[:, None]], 2, 1)
        return of_steps(own, held, np.maximum(len(self.keep) - rows, 0.0), scale, self._unlearned)

    def readout(self, quantity: QuantityOfInterest, noise_scale: float = 1.0, mask: BoolArray | None = None) -> Readout:
        """Take data straight to a quantity; CapabilityError for settings that are not affine in the data."""
        if not self.settings.affine:
            raise CapabilityError(
                "PBDW with a box, or with n or missed chosen from the data, is not affine in them; "
                "use estimate(data).quantity(quantity)"
            )
        flags = check_mask(mask, self.functionals.count)
        scale = check_scale(noise_scale, 1)
        if flags is not None:
            return replace(self.masked(flags).readout(quantity, noise_scale), mask=flags)
        used = self._dimensions(np.zeros(0), scale)
        ratios = self.ratios(used, scale, np.zeros((len(self.keep), len(self.steps), 1)))
        count = len(self.steps)
        on_modes, on_correction = weights_of(quantity, self.background, count, self.riesz if self._corrects else None)
        gain = self.gain(used[:, 0], ratios[:, 0], on_modes, on_correction)
        offset = np.einsum("str,rt->s", on_modes, self.offset)
        offset -= np.einsum("smt,mt->s", gain, self.observed_modes @ self.offset)
        variance = Linear(self, used, ratios, scale).variance(on_modes, on_correction)[:, 0]
        return Readout(gain, offset, np.sqrt(variance))

    def gain(
        self, used: IntArray, ratios: Array, on_modes: Array, on_correction: Array | None,
        projection: Projection | None = None, steps: Sequence[int] | None = None,
    ) -> Array:  # fmt: skip
        """Weights (s, m, t) with which raw data enter linear functionals of the estimate.

        Parameters
        ----------
        used, ratios : (spaces,) arrays
            n and λ of each space.
        on_modes, on_correction
            As `Uncertainty.variance` takes them.
        projection : Projection, optional
            Of spaces that have not seen some trajectories.
        steps : (t,) sequence of int, optional
            Which of the observed steps the functionals are of; None for all.
        """
        p, steps = projection or self.projection, range(len(self.steps)) if steps is None else steps
        out = np.zeros((len(on_modes), self.functionals.count, len(steps)))
        for k, t in enumerate(steps):
            space = p.at(t)
            n = min(int(used[space]), p.modes[space].shape[1])
            extra = None if on_correction is None else on_correction[:, k][:, self.keep]
            out[:, self.keep, k] = p.gain(t, n, float(ratios[space]), on_modes[:, k], extra, self._corrects)
        return out
