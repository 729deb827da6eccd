"""Which trajectories to solve in full, and when there are enough: POD-greedy with an estimate of the error.

Each round marches the reduced model for the candidates, estimates the error of each by the indicator
(`dacore.reduction.indicator`) times a factor, and solves those of the largest estimate in full. Before their motions
enter the basis, their true error is known: it gives the factor of the next round, and shows how good the
estimate was. Source of the greedy: Haasdonk and Ohlberger, M2AN 42 (2008) 277.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dacore.algebra.pod import pod
from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.display import Displayed
from dacore.core.model import Trajectory
from dacore.core.parameters import ParameterSpace
from dacore.core.space import Product
from dacore.dynamics.motions import Motions
from dacore.errors import AccuracyError, CapabilityError, ShapeError
from dacore.reduction.galerkin import Galerkin
from dacore.reduction.indicator import random_tests
from dacore.reduction.kinds import Reducible, affine_of
from dacore.reduction.model import ReducedModel
from dacore.reduction.sampling import features, spread
from dacore.reduction.solver import Balance
from dacore.reduction.split import SplitModel, amplitudes_of, coefficients_of

# Modes may leave this share of the tolerance of each motion; the coupling of the fields amplifies what they leave.
MODE_SHARE = 3e-2
# Between rounds only some of the samples are candidates; all of them are checked before the end.
CANDIDATES = 64
# Share of the tolerance that the modes kept at the end may leave of the candidates' trajectories, which need far
# fewer of them than the motions of single loads do.
COMPRESSED = 3e-3
# Share of the tolerance by which no candidate may change then.
MOST_LOST = 0.3
# The factor is the largest of so many samples, and no estimate counts before there are as many.
CALIBRATING = 4
# Errors of unseen samples reach about 1.6 times what the factor of the last few says.
SAFETY = 2.0
_FLOOR = 1e-9

Read = Callable[[Sequence[int]], Sequence[Trajectory]]


@dataclass(frozen=True)
class Settings:
    """Settings of reduced training.

    Parameters
    ----------
    tolerance : float
        Largest estimated relative space–time error of any field of any sample.
    most : int
        Trajectories in full at most.
    seed : int
        Of the random tests.
    kind : {"l2", "h1"}
        Inner product of the fields.
    first, batch : int
        Trajectories of the first round, and of each later one. Those of a round are solved at the same time;
        the larger it is, the more of them tell the same.
    """

    tolerance: float = 1e-4
    most: int = 64
    seed: int = 1
    kind: Product = "l2"
    first: int = 4
    batch: int = 2

    def __post_init__(self) -> None:
        if self.most < self.first + CALIBRATING:
            raise ShapeError(
                f"training.most: got {self.most}, expected at least {self.first + CALIBRATING} trajectories, the last "
                f"{CALIBRATING} of which measure the error"
            )


@dataclass(frozen=True, eq=False, repr=False)
class Round(Displayed):
    """What one round of the greedy found.

    Parameters
    ----------
    solved : tuple of int
        Samples solved in full in this round.
    modes : mapping of str to int
        Modes of each field afterwards.
    true, estimated : (n_fields, b) array
        Relative errors of the samples before their motions entered; NaN where nothing was known.
    worst : (n_fields,) array
        Largest estimate over the candidates when they were chosen; NaN in the first round.
    """

    solved: tuple[int, ...]
    modes: Mapping[str, int]
    true: Array
    estimated: Array
    worst: Array


@dataclass(frozen=True, eq=False, repr=False)
class ReducedTraining(Displayed):
    """A trained reduced model and how it came about.

    Parameters
    ----------
    model : ReducedModel
    rounds : tuple of Round
    solved : (k,) int array
        Samples solved in full, in the order of the greedy.
    galerkin : Galerkin
        Holds the modes.
    states : (r + n_loads, t, K) array
        Reduced trajectories of all samples.
    estimates : (n_fields, K) array
        Estimated relative space–time error of each.
    """

    model: ReducedModel
    galerkin: Galerkin
    rounds: tuple[Round, ...]
    solved: IntArray
    states: Array
    estimates: Array


def train(
    model: Reducible,
    motions: Motions,
    parameters: ParameterSpace,
    samples: Array,
    read: Read,
    settings: Settings,
    progress: Callable[[int, float], None] | None = None,
) -> ReducedTraining:
    """Train a reduced model on as few full solves as its tolerance needs.

    Parameters
    ----------
    model : MarchedModel or HarmonicModel
    motions : Motions
        Of `model`, with the amplitudes of the samples.
    parameters : ParameterSpace
        Names the columns of `samples`.
    samples : (K, n_parameters) array
    read : callable
        Takes numbers of samples, returns their motions; solves those that are not kept yet.
    settings : Settings
    progress : callable, optional
        Called after each round with the number of full solves and the largest estimate.

    Raises
    ------
    AccuracyError
        If ``settings.most`` trajectories do not suffice.
    CapabilityError
        If the model cannot be projected field by field, or there are too few samples to measure errors on.
    """
    if len(samples) < settings.first + CALIBRATING:
        raise CapabilityError(
            f"reduced training: got {len(samples)} samples, expected at least {settings.first + CALIBRATING} to "
            "measure its errors on; set training.method = 'full'"
        )
    return _Greedy(model, motions, parameters, samples, read, settings, progress).run()


class _Greedy:
    def __init__(
        self,
        model: Reducible,
        motions: Motions,
        parameters: ParameterSpace,
        samples: Array,
        read: Read,
        settings: Settings,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self.motions, self.read, self.settings, self.progress = motions, read, settings, progress
        affine = affine_of(model)
        self.split = SplitModel(affine, settings.kind)
        self.galerkin = Galerkin(self.split)
        points = [parameters.as_mapping(row) for row in samples]
        self.coefficients = coefficients_of(affine, points)
        self.amplitudes = amplitudes_of(affine, points)
        self.features = features(self.coefficients)
        self.sketch = random_tests(model, self.split, parameters, settings.seed)
        self.full = model
        self.share = MODE_SHARE * settings.tolerance
        self.factors: list[Array] = []
        self.solved: list[int] = []
        self.rounds: list[Round] = []
        self._made: ReducedModel | None = None

    @property
    def model(self) -> ReducedModel:
        """The reduced model on the modes, and with the factor, there are now."""
        if self._made is None:
            self._made = ReducedModel.of(self.full, self.galerkin, self.sketch.tested(self.galerkin), self._factor)
        return self._made

    def run(self) -> ReducedTraining:
        self._enter(spread(self.features, self.settings.first), np.full(len(self.split.fields), np.nan))
        everyone = np.arange(self.coefficients.shape[1])
        candidates = np.array(spread(self.features, CANDIDATES)) if len(everyone) > 2 * CANDIDATES else everyone
        settled = False
        while True:
            states, estimates = self._estimate(candidates)
            worst = estimates.max(axis=1)
            if self.progress:
                self.progress(len(self.solved), float(worst.max()) if np.isfinite(worst).all() else np.nan)
            known = sum(each.shape[1] for each in self.factors)
            fine = known >= CALIBRATING and bool((worst <= self.settings.tolerance).all())
            if not fine:
                self._refine(candidates, estimates, worst)
            elif not settled:
                settled = self._deepen(candidates, states)
                if settled and len(candidates) < len(everyone):
                    self._compress(candidates)
                    candidates = everyone
            else:
                solved = np.array(self.solved)
                return ReducedTraining(self.model, self.galerkin, tuple(self.rounds), solved, states, estimates)

    def _refine(self, candidates: IntArray, estimates: Array, worst: Array) -> None:
        """Solve more samples; or, where those already solved are no better, take more of their modes."""
        tolerance = self.settings.tolerance
        known = np.isin(candidates, self.solved)
        size = np.nan_to_num(estimates, nan=1.0).max(axis=0)
        # Modes are the bottleneck where the samples that gave them are hardly better than the others.
        kept = size[known].max(initial=0.0) if self.factors else 0.0
        if kept > max(tolerance, 0.5 * size[~known].max(initial=0.0)) and self.share > _FLOOR * tolerance:
            self.share *= 0.3
            self._extend(self.solved)
            return
        fresh = candidates[~known]
        room = self.settings.most - len(self.solved)
        if not fresh.size or room <= 0:
            raise AccuracyError(
                f"reduced training: {len(self.solved)} trajectories leave an estimated error of {worst.max():.1e}, "
                f"expected {tolerance:.1e}; raise training.reduction or training.most, or set training.method = 'full'"
            )
        self._enter(self._choose(fresh, size[~known], min(self.settings.batch, room)), worst)

    def _choose(self, fresh: IntArray, size: Array, count: int) -> list[int]:
        """Take the largest estimates, and none beside another: what one motion adds, its neighbours need no more."""
        chosen: list[int] = []
        near = self.features[:, self.solved]
        for _ in range(min(count, len(fresh))):
            distance = ((self.features[:, fresh][:, :, None] - near[:, None, :]) ** 2).sum(axis=0).min(axis=1)
            weight = np.minimum(distance / max(float(distance.max()), 1e-300), 0.25)
            weight[np.isin(fresh, chosen)] = -1.0
            best = int(fresh[int((size * weight).argmax())])
            chosen.append(best)
            near = np.concatenate([near, self.features[:, [best]]], axis=1)
        return chosen

    def _estimate(self, numbers: IntArray) -> tuple[Array, Array]:
        """Reduced states (r + n_loads, t, b) and estimated relative errors (n_fields, b) of some samples."""
        states, indicated = self._indicate(numbers)
        return states, indicated * self._factor[:, None]

    def _indicate(self, numbers: IntArray) -> tuple[Array, Array]:
        """As `_estimate`, without the factor."""
        return self.model.indicate(self.coefficients[:, numbers], self.amplitudes[:, numbers])

    def _deepen(self, numbers: IntArray, states: Array) -> bool:
        """Take ten times finer modes of what is solved already; whether that changes no sample by the tolerance.

        The factor is measured on samples before their motions enter. What the modes leave of motions that are in
        is seen by the tests, but other samples may amplify it more than those did; this measures it.
        """
        if self.share < _FLOOR * self.settings.tolerance:
            return True
        sizes = self.galerkin.sizes
        self.share *= 0.1
        self._extend(self.solved)
        deeper, _ = self._indicate(numbers)
        changes, start = [], 0
        for name, rows in self.model.march.tested.columns.items():
            part = deeper[rows].copy()
            part[: sizes[name]] -= states[start : start + sizes[name]]
            start += sizes[name]
            changes.append(np.sqrt((part**2).sum(axis=(0, 1))))
        return bool((np.array(changes) <= self.settings.tolerance * self.model.norms(deeper)).all())

    def _compress(self, numbers: IntArray) -> None:
        """Keep of the modes what the trajectories of these samples need, if they hardly change by it.

        Motions of single loads need far more modes than trajectories do.
        """
        whole, model = self.galerkin, self.model
        moments = {name: np.zeros((size, size)) for name, size in whole.sizes.items()}

        def watch(_: slice, balance: Balance) -> None:
            for name, rows in model.march.tested.columns.items():
                moments[name] += balance.value[rows] @ balance.value[rows].T

        states = model.march.run(self.coefficients[:, numbers], self.amplitudes[:, numbers], watch)
        turns = {}
        for name, moment in moments.items():
            squares, vectors = np.linalg.eigh(moment)
            left = np.cumsum(np.maximum(squares, 0.0))
            lost = int((left <= (COMPRESSED * self.settings.tolerance) ** 2 * left[-1]).sum())
            turns[name] = vectors[:, lost:]
        self.galerkin, self._made = whole.turned(turns), None
        fewer, _ = self._indicate(numbers)
        norms, columns = model.norms(states), self.model.march.tested.columns
        for k, (name, rows) in enumerate(model.march.tested.columns.items()):
            change = states[rows] - np.tensordot(turns[name], fewer[columns[name]], axes=1)
            if (np.sqrt((change**2).sum(axis=(0, 1))) > MOST_LOST * self.settings.tolerance * norms[k]).any():
                self.galerkin, self._made = whole, None
                return

    @property
    def _factor(self) -> Array:
        """Twice the largest true error per indicator among the last samples that were solved; unknown at first."""
        if not self.factors:
            return np.full(len(self.split.fields), np.nan)
        return np.asarray(SAFETY * np.concatenate(self.factors, axis=1)[:, -CALIBRATING:].max(axis=1))

    def _enter(self, numbers: Sequence[int], worst: Array) -> None:
        """Solve samples in full, measure what the reduced model made of them, and take their modes."""
        count = len(self.split.fields)
        true, estimated = np.full((count, len(numbers)), np.nan), np.full((count, len(numbers)), np.nan)
        trajectories = self.read(numbers)
        if self.galerkin.dimension:
            states, raw = self._indicate(np.array(numbers))
            for j, (number, trajectory) in enumerate(zip(numbers, trajectories, strict=True)):
                true[:, j] = self._true(number, trajectory, states[:, :, j])
            estimated = self._factor[:, None] * raw
            self.factors.append(np.divide(true, raw, out=np.ones_like(true), where=raw > 0))
            self._made = None
        self.solved.extend(int(number) for number in numbers)
        self._extend(numbers, trajectories)
        self.rounds.append(Round(tuple(int(n) for n in numbers), dict(self.galerkin.sizes), true, estimated, worst))

    def _true(self, number: int, trajectory: Trajectory, states: Array) -> Array:
        """Relative space–time error (n_fields,) of reduced states (r + n_loads, t) against a full solve."""
        full = self.motions.superpose(trajectory, self.amplitudes[:, number])
        norms, columns = self.model.norms(states[:, :, None])[:, 0], self.model.march.tested.columns
        errors = [
            _norm(part - self.galerkin.bases[name] @ states[columns[name]], self.split.products[name])
            for name, part in self.split.free_parts(full).items()
        ]
        return np.divide(errors, norms, out=np.zeros_like(norms), where=norms > 0)

    def _extend(self, numbers: Sequence[int], trajectories: Sequence[Trajectory] | None = None) -> None:
        """Append what the modes leave of the motions of some samples."""
        for k, number in enumerate(numbers):
            trajectory = trajectories[k] if trajectories is not None else self.read([number])[0]
            news = {}
            for name, part in self.split.free_parts(trajectory.states).items():
                product, left = self.split.products[name], self.galerkin.remainder(name, part)
                size, rest = _norm(part, product), _norm(left, product)
                if size > 0 and rest > self.share * size:
                    news[name] = pod(left, product, self.share * size / rest).basis
            self.galerkin.extend(news)
        self._made = None


def _norm(values: Array, product: Sparse) -> float:
    """Root of the sum of the squared norms of the columns of values (n, k)."""
    return float(np.sqrt(max(float(np.einsum("ij,ij->", values, product @ values)), 0.0)))
