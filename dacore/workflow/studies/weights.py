"""The weight ζ between the fields: stability, chosen n and errors against it, and a rule that needs no truth."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt, Len

from dacore.core.arrays import Array
from dacore.core.noise import WhiteNoise
from dacore.errors import ShapeError, UnstableError
from dacore.estimators.pbdw import PBDW
from dacore.figures.weights import WeightStudy, weights
from dacore.io.scene import Scene
from dacore.studies.errors import JOINT
from dacore.studies.outcomes import PRIOR
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot, error_name, tag, unit_text
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.session import Session
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.judged import Judging
from dacore.workflow.studies.named import expect_kind
from dacore.workflow.studies.study import Exhibit, Findings, Study, Variant
from dacore.workflow.tables import name_of, noise_name, number_text, percent, quantity_title, tone_of

Kind = Literal["l2", "h1"]


@dataclass(frozen=True)
class Weights(Study):
    """Settings of the study.

    Parameters
    ----------
    estimator : str
        A PBDW estimator of the scene; its other settings stay.
    field : str
        Whose weight varies.
    lowest, highest : float
        Ends of the weights, which rise by equal factors.
    count : int
    products : tuple of {"l2", "h1"}
        Inner products of the state.
    """

    heading = "The weight between the fields"

    estimator: str
    field: str
    lowest: Annotated[float, Gt(0)] = 1e-20
    highest: Annotated[float, Gt(0)] = 1e-8
    count: int = 13
    products: Annotated[tuple[Kind, ...], Len(1)] = ("l2",)

    def __post_init__(self) -> None:
        if not self.lowest < self.highest or self.count < 2:
            raise ShapeError(
                f"weights: got {self.count} from {self.lowest:g} to {self.highest:g}, expected at least 2 that rise"
            )

    @property
    def values(self) -> Array:
        """The weights (count,)."""
        return np.geomspace(self.lowest, self.highest, self.count)

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """Data, background and truth."""
        expect_kind(scene, self.estimator, "pbdw")
        return ("validation", "background", "functionals", "noisy", "measured", "truth")

    def variants(self, scene: Scene) -> Mapping[str, Variant]:
        """The scene trained in the other product, where it is asked for."""
        other = [kind for kind in self.products if kind != scene.training.product]
        return {kind: Variant({"training.product": kind}, ("background", "functionals")) for kind in other}

    def run(self, bench: Bench) -> Findings:
        """Prepare and judge the estimator at each weight."""
        base, scene = bench.session, bench.session.scene
        estimator = base.builder.estimators.get(self.estimator)
        if not isinstance(estimator, PBDW):
            raise ShapeError(f"estimator: got {self.estimator!r}, expected the name of a PBDW estimator of the scene")
        base.model.space.layout.field(self.field)
        rows: list[dict[str, Array]] = []
        for kind in self.products:
            session = base if kind == scene.training.product else bench.variant(kind)
            one = _Weighed(base, session, self.estimator)
            for weight in self.values:
                rows.append(one.judged(replace(estimator, weights={self.field: float(weight)})))
                bench.tell(len(rows), len(self.products) * self.count)
        shape = (len(self.products), self.count)
        arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        facts: dict[str, Any] = {
            "products": list(self.products),
            "levels": list(scene.noise.levels),
            "errors": [label for label in base.validation.errors if label != JOINT],
            "quantities": list(scene.quantity),
        }
        return Findings(
            {"weights": self.values, **{k: v.reshape(*shape, *v.shape[1:]) for k, v in arrays.items()}}, facts
        )

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Tables of errors against the weight, the least of a column marked, and what the rule picks."""
        facts, builder = found.facts, canvas.session.builder
        text = (
            f"{name_of(builder, self.estimator)} with other weights ζ of {self.field} in the inner product, all else "
            "the same. The rule takes the ζ whose claimed deviation of the first number of interest, from training "
            "trajectories held out and the noise that comes through, is least: it needs no truth."
        )
        parts: list[Table | Drawn] = []
        for k, kind in enumerate(facts["products"]):
            for j, level in enumerate(facts["levels"]):
                caption = f"{kind} product, {noise_name(level)}"
                parts += [self._drawn(found, canvas, k, j, caption), self._table(found, canvas, k, j, caption)]
        return Exhibit(text, parts)

    def _drawn(self, found: Findings, canvas: Canvas, k: int, j: int, caption: str) -> Drawn:
        a, facts, session = found.arrays, found.facts, canvas.session
        prior, layout = session.validation.outcome(PRIOR, 0.0), session.background.space.layout
        errors = {error_name(label): a["errors"][k, :, j, i] for i, label in enumerate(facts["errors"])}
        guess = {error_name(label): float(prior.space_time[label].mean()) for label in facts["errors"]}
        units = [unit_text(layout.field(name).unit) for name in (layout.fields[0].name, self.field)]
        marks = {"balanced": session.validation.joint_weights[self.field]}
        inside = {name: value for name, value in marks.items() if self.lowest <= value <= self.highest}
        shown = WeightStudy(
            a["weights"], errors, np.nan_to_num(a["inf_sup"][k, :, j]), np.nan_to_num(a["n"][k, :, j]),
            f"({units[0]} / ({units[1]}))²", inside, guess,
        )  # fmt: skip
        return Drawn(
            f"{facts['products'][k]}_{tag(facts['levels'][j])}",
            Plot(weights, shown, f"{canvas.caption} · {caption}"),
            f"Errors, stability and dimension against ζ, {caption}; dashed: guessing the training mean.",
            "curves of errors, stability constants and dimensions against the weight",
        )

    def _table(self, found: Findings, canvas: Canvas, k: int, j: int, caption: str) -> Table:
        facts, arrays = found.facts, found.arrays
        headers = ["ζ", "n (exact data)", "β_n", *(f"e of {each}" for each in facts["errors"])]
        units = [canvas.quantity_unit(q) for q in facts["quantities"]]
        titles = [quantity_title(canvas.session.builder, q) for q in facts["quantities"]]
        headers += [f"{title}, rms [{unit}]" for title, unit in zip(titles, units, strict=True)]
        headers += [f"claimed deviation [{units[0]}]"] if facts["quantities"] else []
        prior = canvas.session.validation.outcome(PRIOR, 0.0)
        guess = [float(prior.space_time[label].mean()) for label in facts["errors"]]
        guess += [prior.quantities[q].rms for q in facts["quantities"]]
        columns = [*arrays["errors"][k, :, j].T, *arrays["rms"][k, :, j].T]
        texts = [percent] * len(facts["errors"]) + [number_text] * len(facts["quantities"])
        claimed = arrays["claimed"][k, :, j, 0] if facts["quantities"] else np.full(self.count, np.nan)
        best = [int(np.argmin(np.nan_to_num(column, nan=np.inf))) for column in columns]
        picked = int(np.argmin(np.nan_to_num(claimed, nan=np.inf))) if np.isfinite(claimed).any() else -1
        known = [Cell(text(value), "muted") for text, value in zip(texts, guess, strict=True)]
        last = [Cell("–", "muted")] * bool(facts["quantities"])
        rows: list[list[str | Cell]] = [[Cell("guessing the training mean", "muted"), "–", "–", *known, *last]]
        for i, weight in enumerate(arrays["weights"]):
            row: list[str | Cell] = [f"{weight:.0e}" + (" (rule)" if i == picked else "")]
            row += [f"{arrays['n'][k, i, j]:.3g}", f"{arrays['inf_sup'][k, i, j]:.1e}"]
            for column, least, text, known_value in zip(columns, best, texts, guess, strict=True):
                value = float(column[i])
                tone = "" if np.isnan(value) else tone_of(i + 1, least + 1, value, known_value)
                row.append(Cell("unstable" if np.isnan(value) else text(value), tone))
            row += [number_text(float(claimed[i]))] if facts["quantities"] else []
            rows.append(row)
        return Table(headers, rows, caption)


class _Weighed:
    """One product: what an estimator of it does at a weight."""

    def __init__(self, base: Session, session: Session, name: str) -> None:
        self.base, self.session, self.name = base, session, name
        judging = Judging(base, session.background)
        self.judge, self.labels = judging.judge, judging.labels

    def judged(self, setting: PBDW) -> dict[str, Array]:
        """Dimension, stability, errors and claimed deviations, level by level; NaN where the weight is unusable."""
        session, noisy = self.session, self.base.runner["noisy"]
        levels, quantities = list(noisy.data), list(self.base.quantities)
        out = {
            "n": np.full(len(levels), np.nan),
            "inf_sup": np.full(len(levels), np.nan),
            "errors": np.full((len(levels), len(self.labels)), np.nan),
            "rms": np.full((len(levels), len(quantities)), np.nan),
            "claimed": np.full((len(levels), len(quantities)), np.nan),
        }
        try:
            steps = self.base.builder.observed(len(session.background.times))
            prepared = setting.prepare(session.background, session.functionals, WhiteNoise(1.0), steps)
            found = self.judge.judge(self.name, prepared, noisy)
        except UnstableError:
            return out
        for j, outcome in enumerate(found.outcomes):
            out["n"][j] = np.median([space.n for space in found.spaces])
            out["inf_sup"][j] = np.nanmin(found.inf_sup)
            out["errors"][j] = [outcome.space_time[label].mean() for label in self.labels]
            out["rms"][j] = [outcome.quantities[name].rms for name in quantities]
            out["claimed"][j] = [np.sqrt((outcome.quantities[q].deviation ** 2).mean()) for q in quantities]
        return out
