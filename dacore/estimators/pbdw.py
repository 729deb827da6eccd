"""Parametrised-background data-weak estimation, exact data fit (docs/method.md: PBDW).

With orthonormal representers W of the functionals and orthonormal modes Φ of V_n, G = WᵀMΦ::

    c = argmin ‖G c − l‖²,   v* = offset + Φ c,   η* = W (l − G c),   u* = v* + η*

One space for the whole cycle or one for each phase of it, with or without a mean subtracted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from dacore.algebra.gram import RieszMap, lower_solve, lower_transpose_solve, orthonormaliser
from dacore.algebra.stability import inf_sup_constants
from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import (
    BackgroundSpace,
    Estimate,
    Estimator,
    PreparedEstimator,
    Readout,
    Uncertainty,
    check_data,
    check_mask,
    check_scale,
    observed_steps,
    weights_of,
)
from dacore.core.fields import Layout
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.core.quantity import QuantityOfInterest
from dacore.errors import ShapeError, UnstableError
from dacore.estimators.frames import (
    Centring,
    Fold,
    Frame,
    Spaces,
    Weights,
    build_frames,
    check_fields,
    field_weights,
    held_out_frames,
    held_out_tails,
    offset_of,
)
from dacore.estimators.plausible import Plausibility

SMALLEST_INF_SUP = 1e-10


@dataclass(frozen=True)
class PBDW(Estimator):
    """Settings of PBDW.

    Parameters
    ----------
    n : int or "bound"
        Dimension of the background space, or the one that minimises ε̂_n/β_n (nested spaces).
    weights : mapping of str to float, or "balanced"
        ζ: weight of each field in the joint inner product; a field left out has weight 1.
    centring : {"none", "cycle", "phase"}
        What is subtracted from the snapshots: nothing (as published), one mean, or one for each phase.
    spaces : {"cycle", "phase"}
        One space for all phases of the cycle, or one small space for each.
    correction : bool
        Whether to add η*, which makes the estimate reproduce the data.
    tails : {"training", "held_out"}
        Where ε̂_n comes from: the singular values (as published), or trajectories left out in turn.
        The second is needed where n approaches the number of training trajectories.
    max_dimension : int
        Largest n considered.
    """

    n: int | Literal["bound"] = "bound"
    weights: Weights = field(default_factory=dict)
    centring: Centring = "phase"
    spaces: Spaces = "phase"
    correction: bool = True
    tails: Literal["training", "held_out"] = "held_out"
    max_dimension: int = 60

    def __post_init__(self) -> None:
        if self.n != "bound" and self.n < 1:
            raise ShapeError(f"n: got {self.n}, expected 'bound' or at least 1")
        if self.max_dimension < 1:
            raise ShapeError(f"max_dimension: got {self.max_dimension}, expected at least 1")
        if self.spaces == "phase" and self.centring == "cycle":
            raise ShapeError("centring: got 'cycle' with one space a phase; expected 'phase' or 'none'")

    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> "PreparedPBDW":
        """Build the spaces, their cross-Gramians with the representers, β_n and the bound."""
        observed = observed_steps(background, steps)
        coefficients = background.coefficients[:, observed]
        offset = offset_of(coefficients, self.centring)
        weights = field_weights(background, self.weights, coefficients - offset[:, :, None])
        scale = background.scale(weights)
        limit = self.max_dimension if self.n == "bound" else max(self.n, self.max_dimension)
        frames = build_frames(coefficients, offset, scale, self.spaces, limit)
        folds = None
        if self.tails == "held_out":
            folds = held_out_frames(coefficients, self.centring, scale, self.spaces, limit)
            tails = held_out_tails(coefficients, scale, folds, limit)
            frames = tuple(replace(frame, tails=tail) for frame, tail in zip(frames, tails, strict=True))
        riesz = RieszMap(background.space, functionals, weights, background.kind)
        return PreparedPBDW(self, background, functionals, noise, observed, offset, frames, riesz, weights, folds=folds)

    def check(self, layout: Layout, samples: int) -> None:
        """Refuse what no training can mend: a weight left open, more modes than samples can give."""
        names = [field.name for field in layout.fields]
        if isinstance(self.weights, Mapping):
            check_fields(self.weights, names)
            for name in names[1:]:
                if name not in self.weights:
                    raise ShapeError(
                        f"weights: nothing given for {name}; ζ decides what PBDW finds, so state it: "
                        f"weights = {{ {name} = 1e-18 }}, or 'balanced'"
                    )
        if self.spaces == "phase" and self.n != "bound" and self.n > samples:
            raise ShapeError(
                f"n: got {self.n}, but a phase has at most {samples} modes from {samples} samples; lower n"
            )


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
        The n in use.
    weights : dict
        Field weights in use.
    """

    def __init__(
        self,
        settings: PBDW,
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
    ) -> None:
        self._folds = folds
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps, self.offset, self.frames, self.riesz, self.weights = steps, offset, tuple(frames), riesz, weights
        self.observed_modes = background.observe(functionals.matrix)
        self.keep = np.arange(functionals.count) if mask is None else np.flatnonzero(mask)
        self.factor = orthonormaliser(riesz.blocks, functionals.labels, mask)
        seen = self.observed_modes[self.keep]
        self.cross = [lower_solve(self.factor, seen @ frame.modes) for frame in self.frames]
        self.constants = [inf_sup_constants(cross) for cross in self.cross]
        self.dimensions = np.array(
            [self._choose(frame, beta) for frame, beta in zip(self.frames, self.constants, strict=True)]
        )
        kept = noise if mask is None else noise.marginal(mask)
        self._plausibility = Plausibility(seen, background.coefficients[:, steps], kept)
        self.solvers = [np.linalg.qr(g[:, :n]) for g, n in zip(self.cross, self.dimensions, strict=True)]

    def _choose(self, frame: Frame, constants: Array) -> int:
        wanted = self.settings.n
        if len(constants) == 0:
            return 0
        if wanted == "bound":
            curve = self.bound(frame, constants)
            if not np.isfinite(curve).any():
                raise UnstableError(
                    f"β_1 = {constants[0]:.1e}: the {len(self.keep)} functionals see no mode of the background space; "
                    "check the weights ζ and what is measured"
                )
            return int(np.argmin(curve)) + 1
        if wanted > len(constants):
            raise ShapeError(
                f"n: got {wanted}, but the background has only {len(constants)} modes; lower n or train on more samples"
            )
        if constants[wanted - 1] < SMALLEST_INF_SUP:
            usable = int((constants >= SMALLEST_INF_SUP).sum())
            raise UnstableError(
                f"β_{wanted} = {constants[wanted - 1]:.1e}: the {len(self.keep)} functionals do not see all of "
                f"{wanted} modes; expected at least {SMALLEST_INF_SUP:.0e}, reached up to n = {usable}: lower n"
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
        """Return the same estimator on the functionals of `mask` (m,); the Gram matrix is reused."""
        flags = check_mask(mask, self.functionals.count)
        return PreparedPBDW(
            self.settings, self.background, self.functionals, self.noise, self.steps, self.offset, self.frames,
            self.riesz, self.weights, flags,
        )  # fmt: skip

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states; the data are fitted exactly whatever the noise."""
        flags = check_mask(mask, self.functionals.count)
        raw = check_data(data, self.functionals.count, len(self.steps), flags)
        scale = check_scale(noise_scale, raw.shape[2])
        if flags is not None:
            return self.masked(flags).estimate(raw, scale)
        values = raw[self.keep]
        self._plausibility.check(values, scale)
        shifted = values - (self.observed_modes[self.keep] @ self.offset)[:, :, None]
        white = lower_solve(self.factor, shifted)
        coefficients = np.repeat(self.offset[:, :, None], raw.shape[2], axis=2)
        left = np.empty_like(white)
        for k, selection in self._groups():
            n = self.dimensions[k]
            q, r = self.solvers[k]
            part = white[:, selection]
            block = part.reshape(len(part), part.shape[1] * part.shape[2])
            c = np.linalg.solve(r, q.T @ block)
            found = self.frames[k].modes[:, :n] @ c
            coefficients[:, selection] += found.reshape(len(found), *part.shape[1:])
            left[:, selection] = (block - self.cross[k][:, :n] @ c).reshape(part.shape)
        correction = None
        if self.settings.correction:
            correction = np.zeros_like(raw)
            correction[self.keep] = lower_transpose_solve(self.factor, left)
        return Estimate(
            self.background, self.steps, coefficients, correction, self.riesz, _PBDWError(self, scale),
        )  # fmt: skip

    def readout(self, quantity: QuantityOfInterest, noise_scale: float = 1.0, mask: BoolArray | None = None) -> Readout:
        """Take data straight to a quantity; the gain is the same at every noise scale."""
        flags = check_mask(mask, self.functionals.count)
        scale = check_scale(noise_scale, 1)
        if flags is not None:
            return replace(self.masked(flags).readout(quantity, noise_scale), mask=flags)
        count = len(self.steps)
        riesz = self.riesz if self.settings.correction else None
        on_modes, on_correction = weights_of(quantity, self.background, count, riesz)
        gain = np.empty((len(on_modes), self.functionals.count, count))
        offset = np.einsum("str,rt->s", on_modes, self.offset)
        expected = self.observed_modes @ self.offset
        for t in range(count):
            extra = None if on_correction is None else on_correction[:, t]
            gain[:, :, t] = self.data_gain(t, on_modes[:, t], extra)
        offset -= np.einsum("smt,mt->s", gain, expected)
        variance = _PBDWError(self, scale).variance(on_modes, on_correction)[:, 0]
        return Readout(gain, offset, np.sqrt(variance))

    def _groups(self) -> list[tuple[int, slice]]:
        if len(self.frames) == 1:
            return [(0, slice(None))]
        return [(k, slice(k, k + 1)) for k in range(len(self.frames))]

    def data_gain(self, step: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Weights (s, m) with which raw data at one step enter linear functionals of the estimate."""
        k = step if len(self.frames) > 1 else 0
        return self._gain(self.frames[k].modes[:, : self.dimensions[k]], self.solvers[k], on_modes, on_correction)

    def _gain(self, modes: Array, solver: tuple[Array, Array], on_modes: Array, on_correction: Array | None) -> Array:
        q, r = solver
        pseudo = np.linalg.solve(r, q.T)
        gain = (on_modes @ modes) @ pseudo
        if on_correction is not None and self.settings.correction:
            rest = lower_solve(self.factor, on_correction[:, self.keep].T).T
            gain = gain + rest - (rest @ q) @ q.T
        out = np.zeros((len(on_modes), self.functionals.count))
        out[:, self.keep] = lower_transpose_solve(self.factor, gain.T).T
        return out

    @cached_property
    def held_out(self) -> list[tuple[BoolArray, Array, list[Array]]]:
        """For each group of training trajectories: who is held out, and the others' offset and modes."""
        if self._folds is None:
            self._folds = held_out_frames(
                self.background.coefficients[:, self.steps], self.settings.centring,
                self.background.scale(self.weights), self.settings.spaces, int(self.dimensions.max()),
            )  # fmt: skip
        return [
            (
                fold.mask, fold.offset,
                [frame.modes[:, :n] for frame, n in zip(fold.frames, self.dimensions, strict=True)],
            )
            for fold in self._folds
        ]  # fmt: skip

    def held_out_gain(self, modes: Array, on_modes: Array, on_correction: Array | None) -> Array:
        """`data_gain` of a space built without some trajectories."""
        cross = lower_solve(self.factor, self.observed_modes[self.keep] @ modes)
        q, r = np.linalg.qr(cross)
        return self._gain(modes, (q, r), on_modes, on_correction)


class _PBDWError(Uncertainty):
    """Mean-square error on training trajectories held out in turn, plus the noise that comes through.

    The estimate is linear in the data. Spaces built from all trajectories would reproduce each of them
    and claim no error as n approaches their number.
    """

    def __init__(self, prepared: PreparedPBDW, scale: Array) -> None:
        self.prepared, self.scale = prepared, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory; NaN for fewer than three samples."""
        p = self.prepared
        training = p.background.coefficients[:, p.steps]
        error = np.full((len(on_modes), training.shape[2]), np.nan)
        for mask, offset, modes in p.held_out:
            error[:, mask] = 0.0
            for t in range(len(p.steps)):
                extra = None if on_correction is None else on_correction[:, t]
                gain = p.held_out_gain(modes[t if len(modes) > 1 else 0], on_modes[:, t], extra)
                missed = on_modes[:, t] - gain @ p.observed_modes
                error[:, mask] += missed @ (training[:, t, mask] - offset[:, t, None])
        noise = np.zeros(len(on_modes))
        for t in range(len(p.steps)):
            gain = p.data_gain(t, on_modes[:, t], None if on_correction is None else on_correction[:, t])
            noise += (p.noise.colour_transpose(gain.T) ** 2).sum(axis=0)
        return np.asarray((error**2).mean(axis=1)[:, None] + noise[:, None] * self.scale**2)
