"""The weight ζ between the fields: stability, chosen dimension and errors against it, and a rule that needs no truth."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Len

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.estimators.pbdw import PBDW
from dacore.io.scene import Scene
from dacore.studies.errors import JOINT
from dacore.workflow.studies.bench import Bench
from dacore.workflow.studies.study import Findings, Study, Variant

Kind = Literal["l2", "h1"]
_VARIANT = "product h1"


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
        Ends of the weights, in logarithmic steps.
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
        """Truth, data and background."""
        return ("validation", "background", "functionals", "noisy", "measured", "truth")

    def variants(self, scene: Scene) -> dict[str, Variant]:
        """The scene trained in the other product, where it is asked for."""
        other = [kind for kind in self.products if kind != scene.training.product]
        return {kind: Variant({"training.product": kind}, ("background", "functionals")) for kind in other}

    def run(self, bench: Bench) -> Findings:
        """Prepare and judge the estimator at each weight."""
        base, scene = bench.session, bench.session.scene
        estimator = base.builder.estimators.get(self.estimator)
        if not isinstance(estimator, PBDW):
            raise ShapeError(f"estimator: got {self.estimator!r}, expected a PBDW estimator of the scene")
        base.model.space.layout.field(self.field)
        rows = []
        for kind in self.products:
            session = base if kind == scene.training.product else bench.variant(kind)
            judge = _judge(base, session)
            for weight in self.values:
                setting = replace(estimator, weights={self.field: float(weight)})
                rows.append(_judged(base, session, judge, self.estimator, setting))
                bench.tell(len(rows), len(self.products) * self.count)
        shape = (len(self.products), self.count)
        arrays = {
            name: np.array([row[name] for row in rows]).reshape(*shape, *np.shape(rows[0][name])) for name in rows[0]
        }
        errors = [label for label in base.validation.errors if label != JOINT]
        return Findings(
            {"weights": self.values, **arrays},
            {
                "products": list(self.products),
                "levels": list(scene.noise.levels),
                "errors": errors,
                "quantities": list(scene.quantity),
            },
        )
