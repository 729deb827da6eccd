"""How well anything could do: the mean of a sampled posterior, and local bounds, beside what the estimators do."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.estimators.posterior import PreparedPosterior
from dacore.figures.learned import learned
from dacore.io.scene import Scene
from dacore.studies.limits import Chain, Limits, limits
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, unit_text
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.judged import Judging
from dacore.workflow.studies.named import expect_kind
from dacore.workflow.studies.study import Exhibit, Findings, Study
from dacore.workflow.tables import name_of, noise_name, number_text, percent, quantity_title

# Less of the variance than this taken away is nothing that a decision could rest on.
UNSEEN = 0.1


@dataclass(frozen=True)
class LimitStudy(Study):
    """Settings of the study.

    Parameters
    ----------
    estimator : str
        A posterior estimator of the scene: its prior and forward model are those of the limit.
    walkers, steps : int
        Of the sampler.
    density : {"emulated", "exact"}
        Sample by the emulated forward map, or by the reduced model itself, which takes a thousand times longer.
    seed : int
    """

    heading = "The limit"

    estimator: str
    walkers: Annotated[int, Ge(8)] = 32
    steps: Annotated[int, Ge(100)] = 1000
    density: Literal["emulated", "exact"] = "emulated"
    seed: int = 7

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Data with noise, the prepared posterior, and what the estimators made of the data."""
        expect_kind(scene, self.estimator, "posterior")
        if not any(level > 0 for level in scene.noise.levels):
            raise ShapeError("noise: the scene has no noise, and exact data no limit; give noise.levels a positive one")
        return ("validation", "noisy", "measured", "truth", f"prepared.{self.estimator}")

    def run(self, bench: Bench) -> Findings:
        """Sample the posterior of every case at every positive noise level."""
        session = bench.session
        prepared = session.prepared(self.estimator)
        if not isinstance(prepared, PreparedPosterior):
            raise ShapeError(f"estimator: got {self.estimator!r}, expected one of kind 'posterior'")
        noisy, measured, judging = session.runner["noisy"], session.runner["measured"], Judging(session)
        levels = [level for level in noisy.data if level > 0]
        chain = Chain(self.walkers, self.steps, self.steps // 4, 5, self.density)
        points = session.runner["truth"].samples
        found: list[Limits] = []
        for done, level in enumerate(levels):
            found.append(
                limits(
                    prepared, noisy.given(level), noisy.sigmas[level], points, session.quantities, measured.quantities,
                    self.seed, chain,
                )
            )  # fmt: skip
            bench.tell(done + 1, len(levels))
        names = list(session.quantities)
        errors = [judging.errors(each.posterior)[0] for each in found]
        outcomes = [[session.validation.outcome(name, level) for level in levels] for name in session.scene.estimator]
        known = [each.posterior.parameters for each in found]
        arrays = {
            "errors": np.array([[each[label] for label in judging.labels] for each in errors]),
            "quantities": np.array([[_first(each.errors[name]) for name in names] for each in found]),
            "bounds": np.array([[_first(each.bounds[name]) for name in names] for each in found]),
            "claimed": np.array([
                [_first(each.posterior.standard_deviation(session.quantities[name])) for name in names]
                for each in found
            ]),
            "learned": np.array([each.learned for each in known if each is not None]),
            "local": np.array([each.parameters for each in found]),
            "prior": known[0].prior if known[0] is not None else np.zeros(0),
            "estimator_errors": np.array([
                [[one.space_time[label] for label in judging.labels] for one in row] for row in outcomes
            ]),
            "estimator_quantities": np.array([
                [[_first(one.quantities[n].estimate - one.quantities[n].truth) for n in names] for one in row]
                for row in outcomes
            ]),
        }  # fmt: skip
        facts = {
            "levels": levels, "errors": judging.labels, "quantities": names,
            "estimators": list(session.scene.estimator),
            "parameters": list(known[0].names) if known[0] is not None else [],
        }  # fmt: skip
        return Findings(arrays, facts)

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Tables of errors over those of the limit, of bounds, and what was learned of each parameter."""
        text = (
            "The mean of the posterior has the least mean-square error of all estimates that know the model, the prior "
            f"and the noise. It is sampled by emcee ({self.walkers} walkers, {self.steps} steps, seed {self.seed}, "
            f"{self.density} forward model) for every unseen case; errors stand beside its errors on the same data. "
            "Local deviations are those of a linearised problem: Fisher information at the true parameters with the "
            "prior's added, which the nonlinear posterior may undercut."
        )
        parts: list[Table | Drawn] = [self._ratios(found, canvas, k) for k in range(len(found.facts["levels"]))]
        parts.append(self._parameters(found, canvas))
        shares = {noise_name(level): found.arrays["learned"][k] for k, level in enumerate(found.facts["levels"])}
        parts.append(
            Drawn(
                "learned", Plot(learned, found.facts["parameters"], shares, caption=canvas.caption),
                "Share of the prior's variance that the data take away, of the sampled posterior: the median case and "
                "the middle 80%.", "bars of the share of variance learned of each parameter",
            )
        )  # fmt: skip
        return Exhibit(text, parts)

    def _ratios(self, found: Findings, canvas: Canvas, k: int) -> Table:
        a, facts, builder = found.arrays, found.facts, canvas.session.builder
        level = facts["levels"][k]
        best = [float(np.sqrt((row**2).mean())) for row in (*a["errors"][k], *a["quantities"][k])]
        texts = [percent] * len(facts["errors"]) + [number_text] * len(facts["quantities"])
        rows: list[list[str | Cell]] = [
            ["the limit: sampled posterior mean", *(text(value) for text, value in zip(texts, best, strict=True))]
        ]
        if len(facts["quantities"]):
            local = [float(np.sqrt((row**2).mean())) for row in a["bounds"][k]]
            told = ["–"] * len(facts["errors"]) + [number_text(value) for value in local]
            rows.append(["local deviation (Fisher and prior)", *told])
        for e, name in enumerate(facts["estimators"]):
            values = [
                float(np.sqrt((row**2).mean()))
                for row in (*a["estimator_errors"][e, k], *a["estimator_quantities"][e, k])
            ]
            cells = []
            for text, value, least in zip(texts, values, best, strict=True):
                ratio = value / least if least > 0 else float("nan")
                tone: Any = "best" if ratio <= 1.15 else ""
                cells.append(Cell(f"{text(value)} ({number_text(ratio)})", tone))
            rows.append([name_of(builder, name), *cells])
        titles = [f"{quantity_title(builder, q)} [{canvas.quantity_unit(q)}]" for q in facts["quantities"]]
        return Table(
            ["root mean square over the cases", *(f"e of {label}" for label in facts["errors"]), *titles], rows,
            f"{noise_name(level)}: errors (over those of the limit)", "Green: within 1.15 of the limit.",
        )  # fmt: skip

    def _parameters(self, found: Findings, canvas: Canvas) -> Table:
        a, facts = found.arrays, found.facts
        parameters = canvas.session.background.parameters
        rows: list[list[str | Cell]] = []
        for j, name in enumerate(facts["parameters"]):
            row: list[str | Cell] = [_with_unit(name, parameters[name].unit), number_text(float(a["prior"][j]))]
            for k in range(len(facts["levels"])):
                share = float(np.median(a["learned"][k, j]))
                row.append(number_text(float(np.median(a["local"][k, j]))))
                row.append(Cell(percent(max(share, 0.0)), "" if share >= UNSEEN else "bad"))
            rows.append(row)
        headers = ["parameter", "deviation of the prior"]
        for level in facts["levels"]:
            headers += [f"local deviation, {noise_name(level)}", f"variance learned, {noise_name(level)}"]
        return Table(headers, rows, "what the data say of the parameters, median case", "Red: not seen.")


def _with_unit(name: str, unit: str) -> str:
    return name if unit in ("", "1") else f"{name} [{unit_text(unit)}]"


def _first(values: Array) -> Array:
    """Root mean square (k,) over the numbers of a quantity."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))
