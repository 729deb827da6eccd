"""Where to measure: slices chosen one by one for a number of interest, or for the stability of PBDW."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Len

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.figures.placement import PlacementPanel, placement
from dacore.io.scene import Scene
from dacore.studies.placement import Criterion, Placement, by_plane, place
from dacore.studies.placement_stability import stability_of
from dacore.studies.placement_variance import PosteriorDeviation, parameter_models, training_model, typical_sigma
from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn, Plot
from dacore.workflow.report_parts import Cell, Table
from dacore.workflow.session import Session
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.study import Exhibit, Findings, Study, Variant
from dacore.workflow.tables import noise_name, number_text, quantity_title

Aim = Literal["training", "parameters", "stability"]
_TITLES: Mapping[str, str] = {
    "training": "deviation left, covariance of the training set",
    "parameters": "deviation left, Fisher information and prior",
    "stability": "stability constant β_n",
}
_CANDIDATES = "candidates"


@dataclass(frozen=True)
class PlacementStudy(Study):
    """Settings of the study.

    Parameters
    ----------
    observation : str
        An observation of the scene by slices; its other settings stay.
    axis : {"x", "y", "z"}
        Normal to the slices.
    positions : tuple of float [cm]
        Candidates.
    quantity : str
        Whose deviation is to become small.
    picks : int
    aims : tuple of {"training", "parameters", "stability"}
        By the training set's covariance, which holds for linear estimates; by Fisher information of the
        parameters, which holds for estimates of state and parameters; by β_n of PBDW.
    noise : float
        Level for which the first two are asked.
    n, weights : int, mapping of str to float
        Of the space whose β_n the third looks at.
    points : int
        Parameter vectors, of the training set, at which Fisher information is taken.
    random : int
        Random orders beside the greedy one.
    seed : int
    """

    heading = "Where to measure"

    observation: str
    positions: Annotated[tuple[float, ...], Len(2)]
    quantity: str
    axis: Literal["x", "y", "z"] = "z"
    picks: Annotated[int, Ge(1)] = 4
    aims: Annotated[tuple[Aim, ...], Len(1)] = ("training", "parameters", "stability")
    noise: Annotated[float, Gt(0)] = 0.1
    n: Annotated[int, Ge(1)] = 10
    weights: Mapping[str, float] | None = None
    points: Annotated[int, Ge(1)] = 8
    random: Annotated[int, Ge(0)] = 20
    seed: int = 11

    def __post_init__(self) -> None:
        if len(set(self.positions)) < len(self.positions) or self.picks > len(self.positions):
            raise ShapeError(
                f"positions: got {len(self.positions)} for {self.picks} picks, expected each once and at least as many"
            )

    def needs(self, scene: Scene) -> tuple[str, ...]:
        """The training set; no data."""
        if self.observation not in scene.observation:
            raise ShapeError(f"observation: got {self.observation!r}, expected one of {', '.join(scene.observation)}")
        if self.quantity not in scene.quantity:
            raise ShapeError(f"quantity: got {self.quantity!r}, expected one of {', '.join(scene.quantity) or 'none'}")
        return ("background", "parameters")

    def variants(self, scene: Scene) -> Mapping[str, Variant]:
        """The scene measured in every candidate at once."""
        slices = [{"axis": self.axis, "position": position} for position in self.positions]
        kept = scene.observation[self.observation].model_dump(exclude_unset=True) | {"slices": slices}
        return {_CANDIDATES: Variant({"observation": {self.observation: kept}}, ("functionals",))}

    def run(self, bench: Bench) -> Findings:
        """Choose greedily by each aim."""
        session = bench.session
        functionals = bench.variant(_CANDIDATES).functionals
        positions, candidates = by_plane(functionals, "xyz".index(self.axis))
        picks = min(self.picks, len(positions))
        arrays: dict[str, Array] = {
            "positions": positions, "counts": np.array([len(each) for each in candidates], dtype=np.float64)
        }  # fmt: skip
        for done, aim in enumerate(self.aims):
            criterion = self._criterion(aim, session, functionals, candidates)
            found: Placement = place(criterion, picks, self.random, np.random.default_rng([self.seed, done]))
            arrays |= {
                f"{aim}.order": found.order.astype(np.float64), f"{aim}.values": found.values,
                f"{aim}.random": found.random, f"{aim}.best": found.best,
            }  # fmt: skip
            bench.tell(done + 1, len(self.aims))
        return Findings(arrays, {"aims": list(self.aims)})

    def _criterion(self, aim: Aim, session: Session, functionals: Any, candidates: Any) -> Criterion[Any]:
        background = session.background
        if aim == "stability":
            return stability_of(background, functionals, candidates, self.n, self.weights or "balanced")
        asked = {self.quantity: session.quantities[self.quantity]}
        sigma = typical_sigma(background, functionals, self.noise)
        if aim == "training":
            return PosteriorDeviation([training_model(background, functionals, candidates, asked, sigma)])
        if background.forward is None:
            raise ShapeError("aims: 'parameters' needs training.method = 'reduced'; train so, or leave it out")
        points = background.samples[: self.points]
        models = parameter_models(background, background.forward, functionals, candidates, asked, sigma, points)
        return PosteriorDeviation(models)

    def show(self, found: Findings, canvas: Canvas) -> Exhibit:
        """Criteria against the number of slices, and the orders."""
        a, title = found.arrays, quantity_title(canvas.session.builder, self.quantity)
        text = (
            f"Slices normal to {self.axis} are taken one by one, each time the one that helps most, out of "
            f"{len(a['positions'])}: so that the least is left of the deviation of {title} at {noise_name(self.noise)} "
            f"(1: as before any data), or so that β_{self.n} of PBDW is largest. Beside them {self.random} random "
            f"orders (seed {self.seed}) and, where there are few enough, the best of all choices. For estimates of "
            "state and parameters follow the Fisher information, for minimum variance the training set, for PBDW β."
        )
        panels = []
        rows: list[list[str | Cell]] = []
        for aim in found.facts["aims"]:
            order = a["positions"][a[f"{aim}.order"].astype(int)]
            names = [f"{position:g}" for position in order]
            best = a[f"{aim}.best"]
            known = best if np.isfinite(best).all() else None
            panels.append(
                PlacementPanel(
                    _TITLES[aim], "β [–]" if aim == "stability" else "share of the deviation left [–]",
                    a[f"{aim}.values"], a[f"{aim}.random"], known, names,
                )
            )  # fmt: skip
            rows.append([_TITLES[aim], ", ".join(names), *(number_text(float(v)) for v in a[f"{aim}.values"][1:])])
        counts = [f"{k + 1} slices" if k else "1 slice" for k in range(len(rows[0]) - 2)]
        table = Table(["aim", f"{self.axis} of the slices [cm], in order", *counts], rows, "the greedy orders")
        drawn = Drawn(
            "orders",
            Plot(placement, panels, "slices", canvas.caption),
            "What each criterion comes to with more slices: greedy, random and best.",
            "criteria against the number of slices",
        )
        return Exhibit(text, [drawn, table])
