"""Synthetic patients: how well a number of interest tells groups apart, and whether claims of it are honest."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Len

from dacore.core.arrays import Array
from dacore.core.parameters import ParameterSpace
from dacore.errors import ShapeError
from dacore.figures.calibration import CalibrationCurve, calibration
from dacore.figures.classify import ClassPanel, OperatingLine, classification
from dacore.io.scene import Scene
from dacore.studies.calibration import LEVELS, Calibration, calibrate, calibrate_quantiles
from dacore.studies.classification import Classification, classify
from dacore.studies.cohort import Group, Patients, draw_patients
from dacore.studies.cohort_estimates import Cohort, CohortOutcome, estimate_cohort
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, tag
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.named import chosen_estimators
from dacore.workflow.studies.study import Exhibit, Findings, Score, Study
from dacore.workflow.tables import name_of, noise_name, number_text, percent, quantity_title

SHOWN = 0.9
# Of fewer patients, shares of the truths inside intervals say little.
ENOUGH = 100


@dataclass(frozen=True)
class PatientGroup:
    """Patients with something in common.

    Parameters
    ----------
    name : str
    patients : int
    ranges : mapping of str to (float, float)
        Narrower ranges of some parameters, in the model's units.
    """

    name: str
    patients: Annotated[int, Ge(1)]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class CohortStudy(Study):
    """Settings of the study.

    Parameters
    ----------
    quantity : str
        The number by which groups are told apart.
    groups : tuple of PatientGroup
        One for calibration alone; two to be told apart, the one with smaller numbers first.
    threshold : float, optional
        Above it a patient is told to be of the second group; by default in the middle between the true numbers.
    estimators : tuple of str
        All of the scene by default.
    noise : tuple of float
        Levels; those of the scene by default.
    seed : int
    """

    heading = "Synthetic patients"

    quantity: str
    groups: Annotated[tuple[PatientGroup, ...], Len(1, 2)]
    threshold: float | None = None
    estimators: tuple[str, ...] = ()
    noise: tuple[float, ...] = ()
    seed: int = 5

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Prepared estimators; no truth of the full model."""
        chosen = chosen_estimators(scene, self.estimators)
        if self.quantity not in scene.quantity:
            raise ShapeError(f"quantity: got {self.quantity!r}, expected one of {', '.join(scene.quantity) or 'none'}")
        return ("parameters", "background", "functionals", "validation", *(f"prepared.{name}" for name in chosen))

    def check(self, parameters: ParameterSpace) -> None:
        """Refuse groups outside the ranges of training."""
        self._patients(parameters)

    def _patients(self, parameters: ParameterSpace) -> Patients:
        groups = [Group(each.name, each.ranges) for each in self.groups]
        return draw_patients(parameters, groups, [each.patients for each in self.groups], self.seed)

    def run(self, bench: Bench) -> Findings:
        """Draw, measure and estimate every patient."""
        session = bench.session
        chosen = chosen_estimators(session.scene, self.estimators)
        levels = self.noise or tuple(session.scene.noise.levels)
        patients = self._patients(session.parameters)
        cohort = estimate_cohort(
            session.background, session.functionals, {name: session.prepared(name) for name in chosen}, patients,
            {self.quantity: session.quantities[self.quantity]}, levels,
            session.builder.contrasts(session.model.space, session.parameters),
            session.builder.observed(len(session.background.times)),
            workers=bench.workers, scheduler=bench.scheduler, progress=bench.progress,
        )  # fmt: skip
        found = self._findings(cohort, chosen, levels)
        truth, second = found.arrays["truth"], found.arrays["group"] == 1
        if second.any() and truth[second].mean() < truth[~second].mean():
            raise ShapeError(
                f"groups: {self.quantity} is larger in {self.groups[0].name!r} than in {self.groups[1].name!r}; give "
                "the group of smaller numbers first"
            )
        return found

    def _findings(self, cohort: Cohort, chosen: tuple[str, ...], levels: tuple[float, ...]) -> Findings:
        table = [[cohort.outcome(name, level) for level in levels] for name in chosen]
        first = table[0][0].quantities[self.quantity]
        labels = [label for label in table[0][0].errors if label != JOINT]

        def collect(take: Any) -> Array:
            return np.array([[take(outcome) for outcome in row] for row in table], dtype=np.float64)

        mean, deviation = cohort.guess[self.quantity]
        arrays = {
            "truth": first.truth[0],
            "group": cohort.patients.group,
            "samples": cohort.patients.samples,
            "probabilities": first.probabilities,
            "estimate": collect(lambda o: o.quantities[self.quantity].estimate[0]),
            "deviation": collect(lambda o: o.quantities[self.quantity].deviation[0]),
            "quantiles": collect(lambda o: o.quantities[self.quantity].quantiles[:, 0]),
            "errors": collect(lambda o: [o.errors[label] for label in labels]),
            "guess_errors": np.array([table[0][0].guess_errors[label] for label in labels]),
            "alarm": collect(_alarm),
            "guess": np.array([mean[0], deviation[0]]),
        }
        return Findings(
            arrays, {"estimators": list(chosen), "levels": list(levels), "errors": labels, "accuracy": cohort.accuracy}
        )

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Tables of who is told right, of calibration, and of errors."""
        builder, facts = canvas.session.builder, found.facts
        unit, title = canvas.quantity_unit(self.quantity), quantity_title(builder, self.quantity)
        accuracy = ", ".join(f"{name} {percent(value)}" for name, value in facts["accuracy"].items())
        count = len(found.arrays["truth"])
        text = (
            f"{count:,} synthetic patients (seed {self.seed}), drawn uniformly from the ranges of their group: "
            + ", ".join(f"{each.patients} {each.name}" for each in self.groups)
            + f". Truths come from the reduced model (expected error of {accuracy}), which is also what the estimators "
            "were trained on: these are errors of the reconstruction alone."
        )
        parts = [
            *self._draw_told(found, canvas, unit, title), self._told(found, canvas, unit, title),
            *self._draw_claimed(found, canvas), self._claimed(found, canvas, unit, title),
        ]  # fmt: skip
        return Exhibit(text, [part for part in parts if part is not None], self._scores(found))

    def _draw_told(self, found: Findings, canvas: Canvas, unit: str, title: str) -> list[Drawn]:
        if len(self.groups) < 2:
            return []
        a, raised, limit = found.arrays, found.arrays["group"] == 1, self.limit(found)
        names, out = (self.groups[0].name, self.groups[1].name), []
        for k, level in enumerate(found.facts["levels"]):
            panels, curves = [], []
            for e, name in enumerate(found.facts["estimators"]):
                label, series = name_of(canvas.session.builder, name), list(canvas.session.scene.estimator).index(name)
                low, high = (self._quantile(found, e, k, tail) for tail in (0.5 - SHOWN / 2, 0.5 + SHOWN / 2))
                ends = (low, high) if low is not None and high is not None else (None, None)
                panels.append(
                    ClassPanel(label, a["truth"], a["estimate"][e, k], raised, limit, ends[0], ends[1], series)
                )
                curve = self.classification(found, e, k).curve
                curves.append(
                    OperatingLine(label, curve.false_positive, curve.true_positive, curve.area, curve.interval, series)
                )
            caption = f"{canvas.caption} · {noise_name(level)}"
            out.append(
                Drawn(
                    f"groups_{tag(level)}", Plot(classification, panels, curves, title, unit, names, SHOWN, caption),
                    f"{title}, {noise_name(level)}: estimate against truth with {100 * SHOWN:.0f}% intervals, the "
                    "threshold between the groups, and operating curves as it moves.",
                    f"scatter of estimated against true {title} of two groups, and operating curves",
                )
            )  # fmt: skip
        return out

    def _draw_claimed(self, found: Findings, canvas: Canvas) -> list[Drawn]:
        if len(found.arrays["truth"]) < ENOUGH:
            return []
        out = []
        for k, level in enumerate(found.facts["levels"]):
            curves = []
            for e, name in enumerate(found.facts["estimators"]):
                one = self.calibration(found, e, k)
                if one is not None:
                    note, cover = f"errors / claimed {one.spread:.2f}", one.coverage
                    label = name_of(canvas.session.builder, name)
                    curves.append(CalibrationCurve(label, cover.levels, cover.empirical, one.transform, note))
            if curves:
                out.append(
                    Drawn(
                        f"claims_{tag(level)}",
                        Plot(calibration, curves, caption=f"{canvas.caption} · {noise_name(level)}"),
                        f"How often central intervals hold the truth against their nominal level, {noise_name(level)}, "
                        "and where truths fall in what is claimed: flat where claims are honest. Bands: 95% of honest "
                        "claims.", "coverage curves beside the diagonal, and histograms",
                    )
                )  # fmt: skip
        return out

    def _quantile(self, found: Findings, estimator: int, level: int, chance: float) -> Array | None:
        place = int(np.argmin(np.abs(found.arrays["probabilities"] - chance)))
        values = found.arrays["quantiles"][estimator, level, place]
        return values if np.isfinite(values).all() else None

    def _rows(self, found: Findings) -> list[tuple[int, str, int, float]]:
        return [
            (e, name, k, level)
            for k, level in enumerate(found.facts["levels"])
            for e, name in enumerate(found.facts["estimators"])
        ]

    def limit(self, found: Findings) -> float:
        """Threshold between the groups: as set, or in the middle between their true numbers."""
        if self.threshold is not None:
            return self.threshold
        truth, raised = found.arrays["truth"], found.arrays["group"] == 1
        return float(0.5 * (truth[~raised].max() + truth[raised].min()))

    def classification(self, found: Findings, estimator: int, level: int) -> Classification:
        """Who is told right by an estimator at a noise level, by their numbers in the findings."""
        raised = found.arrays["group"] == 1
        return classify(found.arrays["estimate"][estimator, level], raised, self.limit(found))

    def calibration(self, found: Findings, estimator: int, level: int) -> Calibration | None:
        """How honest an estimator's claims are; None where it makes none."""
        a = found.arrays
        deviation, estimate = a["deviation"][estimator, level], a["estimate"][estimator, level]
        if not (np.isfinite(deviation).all() and (deviation > 0).all()):
            return None
        quantiles = a["quantiles"][estimator, level]
        if np.isfinite(quantiles).all():
            return calibrate_quantiles(a["truth"], a["probabilities"], quantiles, estimate, deviation)
        return calibrate(a["truth"], estimate, deviation, LEVELS)

    def _told(self, found: Findings, canvas: Canvas, unit: str, title: str) -> Table | None:
        if len(self.groups) < 2:
            return None
        rows: list[list[str | Cell]] = []
        for e, name, k, level in self._rows(found):
            one = self.classification(found, e, k)
            low, high = one.curve.interval
            error = found.arrays["estimate"][e, k] - found.arrays["truth"]
            raised = found.arrays["group"] == 1
            rows.append([
                noise_name(level), name_of(canvas.session.builder, name), str(one.fixed.correct), str(one.left_out),
                f"{one.curve.area:.3f} ({low:.3f} to {high:.3f})",
                number_text(float(np.abs(error[~raised]).max())), number_text(float(np.abs(error[raised]).max())),
            ])  # fmt: skip
        names = [each.name for each in self.groups]
        return Table(
            ["noise", "estimate", "told right", "threshold of the others", "area under the curve (95%)",
             f"largest error, {names[0]} [{unit}]", f"largest error, {names[1]} [{unit}]"],
            rows, f"{names[0]} or {names[1]} by {title}",
            f"Told right: above {number_text(self.limit(found))} {unit}, or not.",
        )  # fmt: skip

    def _claimed(self, found: Findings, canvas: Canvas, unit: str, title: str) -> Table:
        rows: list[list[str | Cell]] = []
        truth, labels = found.arrays["truth"], found.facts["errors"]
        mean, spread = found.arrays["guess"]
        guess = [percent(float(each.mean())) for each in found.arrays["guess_errors"]]
        rows.append([
            "", Cell(name_of(canvas.session.builder, PRIOR), "muted"), *guess,
            number_text(float(np.sqrt(((truth - mean) ** 2).mean()))), number_text(float(spread)), "–", "–", "–", "–",
        ])  # fmt: skip
        for e, name, k, level in self._rows(found):
            a, one = found.arrays, self.calibration(found, e, k)
            rms = float(np.sqrt(((a["estimate"][e, k] - truth) ** 2).mean()))
            told = ["–", "–", "–"]
            if one is not None:
                place = int(np.argmin(np.abs(one.coverage.levels - SHOWN)))
                low, high = one.coverage.intervals[place]
                share = float(one.coverage.empirical[place])
                told = [
                    f"{100 * share:.0f}% ({100 * low:.0f} to {100 * high:.0f})", f"{one.spread:.2f}",
                    number_text(one.crps),
                ]  # fmt: skip
            alarm = float(a["alarm"][e, k].mean())
            rows.append([
                noise_name(level), name_of(canvas.session.builder, name),
                *(percent(float(each.mean())) for each in a["errors"][e, k]), number_text(rms),
                number_text(float(np.sqrt((a["deviation"][e, k] ** 2).mean()))), *told,
                "–" if np.isnan(alarm) else percent(alarm),
            ])  # fmt: skip
        return Table(
            ["noise", "estimate", *(f"e of {label}" for label in labels), f"{title}, rms [{unit}]",
             "claimed deviation", f"{100 * SHOWN:.0f}% intervals hold (95%)", "errors / claimed", "CRPS", "alarm"],
            rows, f"errors and claims, {len(truth):,} patients",
            "CRPS: continuous ranked probability score, less is better. Alarm: data contradict the estimator.",
        )  # fmt: skip

    def _scores(self, found: Findings) -> list[Score]:
        a, scores = found.arrays, []
        kinds = " + ".join(f"{each.patients} {each.name}" for each in self.groups)
        for e, name, k, level in self._rows(found):
            setting = f"{kinds}, {noise_name(level)}"
            rms = float(np.sqrt(((a["estimate"][e, k] - a["truth"]) ** 2).mean()))
            scores.append(Score(setting, name, self.quantity, rms))
            scores += [
                Score(setting, name, label, float(values.mean()))
                for label, values in zip(found.facts["errors"], a["errors"][e, k], strict=True)
            ]
            if e == 0:
                scores.append(
                    Score(setting, PRIOR, self.quantity, float(np.sqrt(((a["truth"] - a["guess"][0]) ** 2).mean())))
                )
                scores += [
                    Score(setting, PRIOR, label, float(values.mean()))
                    for label, values in zip(found.facts["errors"], a["guess_errors"], strict=True)
                ]
        return scores


def _alarm(outcome: CohortOutcome) -> Array:
    misfit = outcome.misfit
    return np.full(len(outcome.sigmas), np.nan) if misfit is None else misfit.alarm.astype(np.float64)
