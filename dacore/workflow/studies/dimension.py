"""The dimension of the background space: errors against n, and what every rule for n makes of it."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from annotated_types import Len

from dacore.core.arrays import Array
from dacore.core.noise import WhiteNoise
from dacore.errors import ShapeError
from dacore.estimators.pbdw import PBDW, Rule
from dacore.estimators.prepared_pbdw import PreparedPBDW
from dacore.figures.dimension import DimensionPanel, dimension
from dacore.io.scene import Scene
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, error_name
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.judged import Judging
from dacore.workflow.studies.named import expect_kind
from dacore.workflow.studies.study import Exhibit, Findings, Study
from dacore.workflow.tables import name_of, noise_name, number_text, percent, quantity_title

RULES: tuple[Rule, ...] = ("bound", "noise", "gcv", "discrepancy")
_TITLES = {"bound": "ε̂_n/β_n", "noise": "expected error", "gcv": "cross validation", "discrepancy": "discrepancy"}


@dataclass(frozen=True)
class Dimension(Study):
    """Settings of the study.

    Parameters
    ----------
    estimator : str
        A PBDW estimator of the scene; all but its n stays.
    largest : int
        Largest n.
    rules : tuple of {"bound", "noise", "gcv", "discrepancy"}
    """

    heading = "Dimension of the background space"

    estimator: str
    largest: int = 60
    rules: Annotated[tuple[Rule, ...], Len(1)] = RULES

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Data, background and truth."""
        expect_kind(scene, self.estimator, "pbdw")
        return ("validation", "background", "functionals", "noisy", "measured", "truth")

    def run(self, bench: Bench) -> Findings:
        """Estimate with every n, and with every rule."""
        session = bench.session
        setting = session.builder.estimators.get(self.estimator)
        if not isinstance(setting, PBDW):
            raise ShapeError(f"estimator: got {self.estimator!r}, expected the name of a PBDW estimator of the scene")
        background = session.background
        steps = session.builder.observed(len(background.times))
        first = replace(setting, n="noise", max_dimension=self.largest).prepare(
            background, session.functionals, WhiteNoise(1.0), steps
        )
        noisy, judged = session.runner["noisy"], Judging(session)
        count = min(self.largest, int(min((beta >= 1e-10).sum() for beta in first.constants)))
        numbers = np.arange(1, count + 1)
        rows: dict[str, list[Any]] = {"errors": [], "rms": [], "rule_errors": [], "rule_rms": [], "rule_n": []}
        done, total = 0, len(noisy.data) * (count + len(self.rules))
        for level in noisy.data:
            data, scale = noisy.given(level), noisy.sigmas[level]
            errors, rms = [], []
            for _, estimate in first.estimate_each(data, scale, numbers.tolist()):
                found = judged.means(estimate)
                errors.append(found[0])
                rms.append(found[1])
                done += 1
                bench.tell(done, total)
            by_rule = []
            for rule in self.rules:
                one = first.by(rule)
                by_rule.append((*judged.means(one.estimate(data, scale)), float(np.median(one.choose(data, scale)))))
                done += 1
                bench.tell(done, total)
            for name, values in zip(rows, (errors, rms, *zip(*by_rule, strict=True)), strict=True):
                rows[name].append(values)
        arrays = {name: np.array(values, dtype=np.float64) for name, values in rows.items()}
        facts = {
            "levels": list(noisy.data), "errors": judged.labels, "quantities": list(session.scene.quantity),
            "rules": list(self.rules),
        }  # fmt: skip
        return Findings({"n": numbers.astype(np.float64), **_space(first, count), **arrays}, facts)

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """A table of the rules against the best n, and curves."""
        a, facts = found.arrays, found.facts
        name = name_of(canvas.session.builder, self.estimator)
        text = (
            f"{name} with every n and all else the same. The best n has the least mean error of the hidden field, "
            "which only the truth knows; beside it what each rule takes. The bound ε̂_n/β_n knows no noise, the "
            "expected error is measured on training trajectories held out, for the noise of each series; cross "
            "validation and discrepancy look at the data alone."
        )
        parts: list[Table | Drawn] = [self._table(found, canvas)]
        panels = []
        for k, level in enumerate(facts["levels"]):
            chosen = {
                _TITLES[rule]: int(np.clip(round(a["rule_n"][k, r]), a["n"][0], a["n"][-1]))
                for r, rule in enumerate(facts["rules"])
            }
            errors = {error_name(label): a["errors"][k, :, j] for j, label in enumerate(facts["errors"])}
            panels.append(
                DimensionPanel(noise_name(level), a["n"].astype(np.int64), errors, a["tails"], a["inf_sup"], chosen)
            )
        parts.append(
            Drawn(
                "dimension", Plot(dimension, panels, caption=f"{canvas.caption} · {name}"),
                "Mean space–time errors over the unseen cases against n, and the n of each rule.",
                "error curves, stability constants and tails against the dimension of the background space",
            )
        )  # fmt: skip
        return Exhibit(text, parts)

    def _table(self, found: Findings, canvas: Canvas) -> Table:
        a, facts = found.arrays, found.facts
        hidden = len(facts["errors"]) - 1
        prior = canvas.session.validation.outcome(PRIOR, 0.0)
        guess = np.array([float(prior.space_time[label].mean()) for label in facts["errors"]])
        spread = [prior.quantities[q].rms for q in facts["quantities"]]
        muted = [Cell(percent(float(value)), "muted") for value in guess]
        rows: list[list[str | Cell]] = [
            ["", Cell("guessing the training mean", "muted"), "–", *muted, "–",
             *(Cell(number_text(value), "muted") for value in spread)]
        ]  # fmt: skip
        for k, level in enumerate(facts["levels"]):
            best = int(np.argmin(a["errors"][k, :, hidden]))
            least, n = a["errors"][k, best], float(a["n"][best])
            rows.append(self._row(noise_name(level), "best n", n, least, a["rms"][k, best], least, guess))
            for r, rule in enumerate(facts["rules"]):
                values = a["rule_errors"][k, r]
                rows.append(self._row("", _TITLES[rule], a["rule_n"][k, r], values, a["rule_rms"][k, r], least, guess))
        quantities = [
            f"{quantity_title(canvas.session.builder, q)}, rms [{canvas.quantity_unit(q)}]" for q in facts["quantities"]
        ]
        note = f"Of the best: error of {facts['errors'][hidden]} over that of the best n. Red: worse than guessing."
        return Table(
            ["noise", "rule", "n", *(f"e of {label}" for label in facts["errors"]), "of the best", *quantities],
            rows, "errors by rule for n", note,
        )  # fmt: skip

    def _row(
        self, noise: str, rule: str, n: float, errors: Array, rms: Array, least: Array, guess: Array
    ) -> list[str | Cell]:  # fmt: skip
        ratio = float(errors[-1] / least[-1])
        return [
            noise, rule, f"{n:.3g}",
            *(Cell(percent(float(e)), "bad" if e > g else "") for e, g in zip(errors, guess, strict=True)),
            f"{ratio:.2f}",
            *(number_text(float(value)) for value in rms),
        ]  # fmt: skip


def _space(prepared: PreparedPBDW, count: int) -> dict[str, Array]:
    """Least stability constant and largest tail of the spaces, for n = 1 … `count`."""
    return {
        "inf_sup": np.min([beta[:count] for beta in prepared.constants], axis=0),
        "tails": np.max([frame.tails[1 : count + 1] for frame in prepared.frames], axis=0),
    }
