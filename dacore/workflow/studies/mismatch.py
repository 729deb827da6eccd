"""Truths of another model than the estimator's: wrong conditions, other material, a finer mesh or step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np

from dacore.core.arrays import BoolArray, IntArray
from dacore.core.model import Trajectory
from dacore.core.observation import Functionals
from dacore.errors import ShapeError
from dacore.io.scene import Scene
from dacore.studies.errors import ErrorMeter
from dacore.studies.noisy import NoisyData
from dacore.studies.outcomes import Validation
from dacore.studies.reference import Measured
from dacore.studies.transfer import Projection, Transfer, interpolation, unattainable
from dacore.studies.validation import PRODUCT, validate_measured
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn
from dacore.workflow.session import Session
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.drawing import draw_mismatch
from dacore.workflow.studies.grid import Grid
from dacore.workflow.studies.named import Setting, check_labels, chosen_estimators
from dacore.workflow.studies.study import Exhibit, Findings, Study, Variant
from dacore.workflow.tables import noise_name

_NEEDS = ("truth", "measured", "functionals")


@dataclass(frozen=True)
class Truth(Setting):
    """A model that the estimators do not know of.

    Parameters
    ----------
    label, set
        As of a `Setting`.
    series : str
        Truths of one series differ in one size only and make a curve.
    size : float, optional
        Of what is wrong, in the unit of the measured values: shown relative to the largest of them.
    """

    series: str = ""
    size: float | None = None


@dataclass(frozen=True)
class Mismatch(Study):
    """Settings of the study.

    Parameters
    ----------
    truths : tuple of Truth
    estimators : tuple of str
        All of the scene by default.
    """

    heading = "Model mismatch"

    truths: tuple[Truth, ...]
    estimators: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_labels("truths", self.truths)
        for each in self.truths:
            for key in each.set:
                if key in ("time.step", "time.steps"):
                    raise ShapeError(
                        f"truths: {each.label!r} records other times than the scene, by {key}; change time.substeps or "
                        "the scheme"
                    )

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Prepared estimators, and their errors on truths of their own model."""
        return ("validation", *(f"prepared.{name}" for name in chosen_estimators(scene, self.estimators)))

    def variants(self, scene: Scene) -> Mapping[str, Variant]:
        """The scene with each truth's physics."""
        return {each.label: Variant(each.set, _NEEDS) for each in self.truths}

    def run(self, bench: Bench) -> Findings:
        """Estimate each truth's data with the estimators of the scene."""
        base, scene = bench.session, bench.session.scene
        chosen = chosen_estimators(scene, self.estimators)
        found: dict[str, Validation] = {"the estimator's own model": base.validation}
        missing, lost = [0], [0.0]
        for done, truth in enumerate(self.truths):
            one = _Foreign(base, bench.variant(truth.label), truth.label)
            found[truth.label] = one.judged(chosen)
            missing.append(one.missing)
            lost.append(one.lost)
            bench.tell(done + 1, len(self.truths))
        largest = float(np.abs(base.validation.clean).max())
        grid = Grid.of(found, chosen, scene.noise.levels)
        return grid.findings(missing=missing, lost=lost, largest=largest, lost_of=base.model.space.fields[-1].name)

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Tables of errors and alarms, and curves of errors against the size of what is wrong."""
        grid = Grid.kept(found)
        note = "Alarm: share of the cases whose data contradict the estimator, by the chi-squared test of its residual."
        text = (
            "The truth comes from a model that the estimators do not know of; they keep their training set, what they "
            "measure and their settings. Truths on another mesh are interpolated at the nodes of the estimators' mesh "
            "before the errors of fields are measured; data and numbers of interest come from the truth's own mesh."
        )
        others = [
            f"{name}: {count} functionals of the scene are not measured there"
            for name, count in zip(grid.settings, found.facts["missing"], strict=True)
            if count
        ]
        field = found.facts["lost_of"]
        others += [
            f"{name}: {100 * share:.2g}% of the true {field} is what no state on the estimators' mesh has"
            for name, share in zip(grid.settings, found.facts["lost"], strict=True)
            if share
        ]
        told = "\n\n".join([text, *(f"{each}." for each in others)])
        return Exhibit(
            told, [*self._drawn(found, grid, canvas), *grid.tables(canvas, note, alarms=True)], grid.scores()
        )

    def _drawn(self, found: Findings, grid: Grid, canvas: Canvas) -> list[Drawn]:
        out = []
        for series in dict.fromkeys(each.series for each in self.truths if each.series):
            rows = {
                1 + k: each.size / found.facts["largest"]
                for k, each in enumerate(self.truths)
                if each.series == series and each.size is not None
            }
            if len(rows) > 1:
                order = sorted(rows, key=rows.__getitem__)
                sizes = np.array([rows[k] for k in order])
                levels = {noise_name(level): level for level in grid.levels if level > 0}
                out += draw_mismatch(grid, series, order, sizes, levels, canvas)
        return out


class _Foreign:
    """Data and states of a truth's model, as the scene's estimators see them."""

    def __init__(self, base: Session, other: Session, label: str) -> None:
        self.base, self.other = base, other
        self.mask, self._rows = _aligned(base.functionals, other.functionals, label)
        self.missing = int((~self.mask).sum())
        times, expected = other.model.times, base.model.times
        if len(times) != len(expected) or not np.allclose(times, expected, rtol=1e-9, atol=0.0):
            raise ShapeError(
                f"truths: {label!r} records other times than the scene; change time.substeps or time.scheme, not "
                "time.step or time.steps"
            )
        self._transfer = interpolation(other.model.space, base.model.space)

    @cached_property
    def lost(self) -> float:
        """Share of the first truth's last field that no state on the scene's mesh has."""
        there, here = self.other.model.space, self.base.model.space
        if there.n_dofs == here.n_dofs:
            return 0.0
        meter = ErrorMeter(there, PRODUCT, [], {f.name: 1.0 for f in there.fields})
        states = self.other.truth[0].states
        nearest = Projection(there, here)
        return unattainable(nearest, nearest.basis, states, meter)[there.fields[-1].name]

    def judged(self, estimators: Sequence[str]) -> Validation:
        """What the scene's estimators make of the truth's data."""
        base, scene = self.base, self.base.scene
        measured: Measured = self.other.runner["measured"]
        data = np.zeros((base.functionals.count, *measured.data.shape[1:]))
        data[self.mask] = measured.data[self._rows]
        steps = base.builder.observed(len(base.background.times))
        return validate_measured(
            base.background, base.functionals, {name: base.prepared(name) for name in estimators},
            _Moved(self.other.truth, self._transfer), Measured(data, measured.quantities),
            NoisyData.drawn(data, scene.noise.levels, scene.noise.seed, steps), base.quantities,
            base.builder.contrasts(base.model.space, base.parameters), None if self.mask.all() else self.mask,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Moved(Sequence[Trajectory]):
    """Trajectories in another space, moved one at a time."""

    trajectories: Sequence[Trajectory]
    transfer: Transfer

    def __len__(self) -> int:
        return len(self.trajectories)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> list[Trajectory]: ...
    def __getitem__(self, index: int | slice) -> Trajectory | list[Trajectory]:
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        found = self.trajectories[index]
        return Trajectory(self.transfer(found.states), found.times)


def _aligned(base: Functionals, other: Functionals, truth: str) -> tuple[BoolArray, IntArray]:
    """Which functionals (m,) of the scene the truth's model has by the same label, and their rows there."""
    rows = {label: row for row, label in enumerate(other.labels)}
    mask = np.array([label in rows for label in base.labels])
    if not mask.any():
        raise ShapeError(f"truths: {truth!r} measures nothing that the scene measures; keep its observations")
    return mask, np.array([rows[label] for label in base.labels if label in rows])
