"""Parametrised-background data-weak estimation (docs/method.md: PBDW).

With orthonormal representers W of the functionals and orthonormal modes Φ of V_n, G = WᵀMΦ::

    c = argmin ‖G c − l‖²,   v* = offset + Φ c,   η* = W (l − G c),   u* = v* + η*

fits the data exactly; a fit that knows the noise weighs them by what is expected of noise and of what the
background misses (`dacore.estimators.metrics`). One space for the whole cycle or one for each phase of it, with or
without a mean subtracted.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from dacore.algebra.gram import RieszMap
from dacore.core.arrays import IntArray
from dacore.core.background import Background
from dacore.core.estimator import Estimator, observed_steps
from dacore.core.fields import Layout
from dacore.core.noise import NoiseModel
from dacore.core.observation import Functionals
from dacore.errors import ShapeError
from dacore.estimators.frames import (
    Centring,
    Spaces,
    Weights,
    build_frames,
    check_fields,
    field_weights,
    held_out_frames,
    held_out_tails,
    offset_of,
)
from dacore.estimators.prepared_pbdw import PreparedPBDW

Fit = Literal["exact", "regularised", "noise_weighted"]
Rule = Literal["bound", "noise", "gcv", "discrepancy"]


@dataclass(frozen=True)
class PBDW(Estimator):
    """Settings of PBDW.

    Parameters
    ----------
    n : int, "bound", "noise", "gcv" or "discrepancy"
        Dimension of the background space, or a rule for it (nested spaces): the least ε̂_n/β_n, which knows no
        noise; the least error that is expected for the noise of each series, measured on trajectories
        held out; or, from the data of each series alone, generalised cross validation, or the least n
        whose residual is no more than the noise.
    weights : mapping of str to float, or "balanced"
        ζ: weight of each field in the joint inner product; a field left out has weight 1.
    centring : {"none", "cycle", "phase"}
        What is subtracted from the snapshots: nothing (as published), one mean, or one for each phase.
    spaces : {"cycle", "phase"}
        One space for all phases of the cycle, or one small space for each.
    fit : {"exact", "regularised", "noise_weighted"}
        Reproduce the data (as published); minimise ‖η‖²/τ² + ‖misfit‖²/σ², whose limits for σ → 0 and σ → ∞ are
        the other two; or least squares weighted by the noise, without η.
    missed : float, "held_out", "gcv" or "discrepancy"
        τ of a regularised fit, the deviation of each orthonormal direction that the background leaves
        out [norm of the joint product]: a number; measured on trajectories held out; or chosen for
        each series from its data by generalised cross validation, or such that the misfit is that of the noise.
    correction : bool
        Whether to add η, which makes an exact fit reproduce the data.
    box : float, optional
        Keep the coefficients of each mode and step within the range of the training set times this factor.
    tails : {"training", "held_out"}
        Where ε̂_n comes from: the singular values (as published), or trajectories left out in turn.
        The second is needed where n approaches the number of training trajectories.
    max_dimension : int
        Largest n considered.
    """

    n: int | Rule = "bound"
    weights: Weights = field(default_factory=dict)
    centring: Centring = "phase"
    spaces: Spaces = "phase"
    fit: Fit = "exact"
    missed: float | Literal["held_out", "gcv", "discrepancy"] = "held_out"
    correction: bool = True
    box: float | None = None
    tails: Literal["training", "held_out"] = "held_out"
    max_dimension: int = 60

    def __post_init__(self) -> None:
        if not isinstance(self.n, str) and self.n < 1:
            raise ShapeError(f"n: got {self.n}, expected 'bound', 'noise', 'gcv', 'discrepancy' or at least 1")
        if self.max_dimension < 1:
            raise ShapeError(f"max_dimension: got {self.max_dimension}, expected at least 1")
        if self.spaces == "phase" and self.centring == "cycle":
            raise ShapeError("centring: got 'cycle' with one space a phase; expected 'phase' or 'none'")
        if not isinstance(self.missed, str) and not self.missed > 0:
            raise ShapeError(f"missed: got {self.missed}, expected 'held_out', 'gcv', 'discrepancy' or more than 0")
        if self.missed != "held_out" and self.fit != "regularised":
            raise ShapeError(f"missed: only used with fit = 'regularised', got fit = {self.fit!r}; leave it out")
        if self.box is not None and not self.box > 0:
            raise ShapeError(f"box: got {self.box}, expected more than 0; 1 is the range of the training set")

    @property
    def affine(self) -> bool:
        """Whether estimates are affine in the data, for data of one noise scale."""
        return self.box is None and not {self.n, self.missed} & {"gcv", "discrepancy"}

    def prepare(
        self, background: Background, functionals: Functionals, noise: NoiseModel, steps: IntArray | None = None
    ) -> PreparedPBDW:
        """Build the spaces, their cross-Gramians with the representers, β_n and the bound."""
        observed = observed_steps(background, steps)
        coefficients = background.coefficients[:, observed]
        offset = offset_of(coefficients, self.centring)
        weights = field_weights(background, self.weights, coefficients - offset[:, :, None])
        scale = background.scale(weights)
        limit = self.max_dimension if isinstance(self.n, str) else max(self.n, self.max_dimension)
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
                        f"weights: nothing given for {name}; ζ decides what PBDW finds, so state it: weights = "
                        f"'balanced', or a number, {{ {name} = … }}"
                    )
        if self.spaces == "phase" and not isinstance(self.n, str) and self.n > samples:
            raise ShapeError(
                f"n: got {self.n}, but a phase has at most {samples} modes from {samples} samples; lower n"
            )
