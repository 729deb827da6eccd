"""A study by somebody else: between which values a true number of interest lies, in a scene and a variant of it."""

from dataclasses import dataclass

import numpy as np

from dacore.errors import ShapeError
from dacore.studies.outcomes import PRIOR
from dacore.workflow.report_parts import Table
from dacore.workflow.studies.study import Exhibit, Findings, Score, Study, Variant
from dacore.workflow.tables import number_text


@dataclass(frozen=True)
class Samples(Study):
    heading = "Smallest and largest"

    quantity: str
    samples: int = 8

    def needs(self, scene):
        if self.quantity not in scene.quantity:
            raise ShapeError(f"quantity: got {self.quantity!r}, expected one of {', '.join(scene.quantity) or 'none'}")
        return ("validation",)

    def variants(self, scene):
        return {"fewer": Variant({"training.samples": self.samples})}

    def run(self, bench):
        found = []
        for session in (bench.session, bench.variant("fewer")):
            outcome = session.validation.outcome(PRIOR, 0.0).quantities[self.quantity]
            found.append([outcome.truth.min(), outcome.truth.max(), outcome.rms])
            bench.tell(len(found), 2)
        return Findings({"ends": np.array(found)}, {"samples": self.samples})

    def show(self, found, canvas):
        rows = [[name, *(number_text(float(value)) for value in row)]
                for name, row in zip(("all", "fewer"), found.arrays["ends"], strict=True)]  # fmt: skip
        scores = [Score("all", PRIOR, self.quantity, float(found.arrays["ends"][0, 2]))]
        return Exhibit("What a stranger asked.", [Table(["training", "least", "most", "guess"], rows, "ends")], scores)
