"""Parametrised-background data-weak estimation, exact data fit (METHOD: PBDW).

With orthonormal representers W of the functionals and orthonormal modes Φ of V_n, G = WᵀMΦ::

    c = argmin ‖G c − l‖²,   v* = offset + Φ c,   η* = W (l − G c),   u* = v* + η*

One space for the whole cycle or one for each phase of it, with or without a mean subtracted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dacore.algebra.gram import RieszMap, lower_solve, lower_transpose_solve, orthonormaliser
from dacore.algebra.stability import inf_sup_constants
from dacore.core.arrays import Array, BoolArray, IntArray
from dacore.core.background import Background
from dacore.core.estimator import Estimate, Estimator, PreparedEstimator, Uncertainty, check_data
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.errors import ShapeError, UnstableError
from dacore.estimators.frames import (
    Centring,
    Frame,
    Spaces,
    Weights,
    cross_validated_tails,
    field_weights,
    joint_frame,
    offsets,
)

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
        observed = np.arange(len(background.times)) if steps is None else np.asarray(steps)
        offset = offsets(background, observed, self.centring)
        fluctuations = background.coefficients[:, observed] - offset[:, :, None]
        weights = field_weights(background, self.weights, fluctuations)
        scale = background.scale(weights)
        limit = self.max_dimension if self.n == "bound" else max(self.n, self.max_dimension)
        frames = self._frames(fluctuations, scale, limit)
        riesz = RieszMap(background.space, functionals, weights, background.kind)
        return PreparedPBDW(self, background, functionals, noise, observed, offset, frames, riesz, weights)

    def _frames(self, fluctuations: Array, scale: Array, limit: int) -> tuple[Frame, ...]:
        r, t, count = fluctuations.shape
        if self.spaces == "phase":
            sets, samples = [fluctuations[:, k] for k in range(t)], np.arange(count)
        else:
            sets, samples = [fluctuations.reshape(r, -1)], np.tile(np.arange(count), t)
        frames = []
        for data in sets:
            frame = joint_frame(data, scale, limit)
            if self.tails == "held_out":
                frame = replace(frame, tails=cross_validated_tails(data, scale, samples, limit))
            frames.append(frame)
        return tuple(frames)


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
    ) -> None:
        self.settings, self.background, self.functionals, self.noise = settings, background, functionals, noise
        self.steps, self.offset, self.frames, self.riesz, self.weights = steps, offset, tuple(frames), riesz, weights
        self.observed_modes = background.observe(functionals.matrix)
        self.keep = np.arange(functionals.count) if mask is None else np.flatnonzero(mask)
        self.factor = orthonormaliser(riesz.gram, functionals.labels, mask)
        seen = self.observed_modes[self.keep]
        self.cross = [lower_solve(self.factor, seen @ frame.modes) for frame in self.frames]
        self.constants = [inf_sup_constants(cross) for cross in self.cross]
        self.dimensions = np.array(
            [self._choose(frame, beta) for frame, beta in zip(self.frames, self.constants, strict=True)]
        )
        self.solvers = [np.linalg.qr(g[:, :n]) for g, n in zip(self.cross, self.dimensions, strict=True)]

    def _choose(self, frame: Frame, constants: Array) -> int:
        wanted = self.settings.n
        if wanted == "bound":
            return int(np.argmin(self.bound(frame, constants))) + 1
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
        """ε̂_n/β_n for n = 1 … N, infinite where β_n vanishes (METHOD: nested-space selection)."""
        tails = frame.tails[1 : len(constants) + 1]
        with np.errstate(divide="ignore"):
            return np.asarray(np.where(constants >= SMALLEST_INF_SUP, tails / constants, np.inf))

    @property
    def inf_sup(self) -> Array:
        """β_n (t,) in use at each observed step."""
        values = np.array([beta[n - 1] for beta, n in zip(self.constants, self.dimensions, strict=True)])
        return np.broadcast_to(values, (len(self.steps),)).copy() if len(values) == 1 else values

    def masked(self, mask: BoolArray) -> "PreparedPBDW":
        """Return the same estimator on the functionals of `mask` (m,); the Gram matrix is reused."""
        if mask.shape != (self.functionals.count,):
            raise ShapeError(f"mask: got shape {mask.shape}, expected ({self.functionals.count},)")
        return PreparedPBDW(
            self.settings, self.background, self.functionals, self.noise, self.steps, self.offset, self.frames,
            self.riesz, self.weights, mask,
        )  # fmt: skip

    def estimate(self, data: Array, noise_scale: Array | float = 1.0, mask: BoolArray | None = None) -> Estimate:
        """Estimate states; the data are fitted exactly whatever the noise."""
        if mask is not None and not mask.all():
            return self.masked(mask).estimate(np.where(mask[:, None, None], data, 0.0), noise_scale)
        values = check_data(data, self.functionals.count, len(self.steps))[self.keep]
        shifted = values - (self.observed_modes[self.keep] @ self.offset)[:, :, None]
        white = lower_solve(self.factor, shifted)
        coefficients = np.repeat(self.offset[:, :, None], data.shape[2], axis=2)
        left = np.empty_like(white)
        for k, selection in self._groups():
            n = self.dimensions[k]
            q, r = self.solvers[k]
            block = white[:, selection].reshape(len(white), -1)
            c = np.linalg.solve(r, q.T @ block)
            shape = (-1, white[:, selection].shape[1], data.shape[2])
            coefficients[:, selection] += (self.frames[k].modes[:, :n] @ c).reshape(shape)
            left[:, selection] = (block - self.cross[k][:, :n] @ c).reshape(shape)
        correction = None
        if self.settings.correction:
            correction = np.zeros_like(np.asarray(data, dtype=np.float64))
            correction[self.keep] = lower_transpose_solve(self.factor, left)
        scale = np.broadcast_to(np.asarray(noise_scale, dtype=np.float64), (data.shape[2],))
        return Estimate(
            self.background, self.steps, coefficients, correction, self.riesz, _PBDWError(self, scale),
            {"n": self.dimensions, "inf_sup": self.inf_sup},
        )  # fmt: skip

    def _groups(self) -> list[tuple[int, slice]]:
        if len(self.frames) == 1:
            return [(0, slice(None))]
        return [(k, slice(k, k + 1)) for k in range(len(self.frames))]

    def data_gain(self, step: int, on_modes: Array, on_correction: Array | None) -> Array:
        """Weights (s, m) with which raw data at one step enter linear functionals of the estimate."""
        k = step if len(self.frames) > 1 else 0
        n = self.dimensions[k]
        q, r = self.solvers[k]
        pseudo = np.linalg.solve(r, q.T)
        gain = (on_modes @ self.frames[k].modes[:, :n]) @ pseudo
        if on_correction is not None and self.settings.correction:
            rest = lower_solve(self.factor, on_correction[:, self.keep].T).T
            gain = gain + rest - (rest @ self.cross[k][:, :n]) @ pseudo
        out = np.zeros((len(on_modes), self.functionals.count))
        out[:, self.keep] = lower_transpose_solve(self.factor, gain.T).T
        return out


class _PBDWError(Uncertainty):
    """Mean-square error over the training set's distribution plus noise.

    The estimate is linear in the data, so for a state a = mean + A ω, ω ~ N(0, I), its error is
    linear in ω and in the noise. What the training set cannot represent is not counted.
    """

    def __init__(self, prepared: PreparedPBDW, scale: Array) -> None:
        self.prepared, self.scale = prepared, scale

    def variance(self, on_modes: Array, on_correction: Array | None) -> Array:
        """Variance (s, k) of linear functionals of the trajectory."""
        p = self.prepared
        training = p.background.coefficients[:, p.steps]
        mean = training.mean(axis=2)
        count = training.shape[2]
        signal = np.zeros((len(on_modes), count))
        bias = np.zeros(len(on_modes))
        noise = np.zeros(len(on_modes))
        for t in range(len(p.steps)):
            extra = None if on_correction is None else on_correction[:, t]
            gain = p.data_gain(t, on_modes[:, t], extra)
            missed = on_modes[:, t] - gain @ p.observed_modes
            signal += missed @ (training[:, t] - mean[:, t, None])
            bias += missed @ (mean[:, t] - p.offset[:, t])
            noise += (p.noise.colour_transpose(gain.T) ** 2).sum(axis=0)
        fixed = (signal**2).sum(axis=1) / max(count - 1, 1) + bias**2
        return np.asarray(fixed[:, None] + noise[:, None] * self.scale**2)
