from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from dacore.core.observation import Functionals, ObservationOperator
from dacore.core.quantity import Over, QuantityOfInterest


@dataclass(frozen=True)
class Probes(ObservationOperator):
    needs: ClassVar[frozenset[str]] = frozenset({"points"})

    at: tuple[float, ...]
    field: str = "T"

    def functionals(self, space):
        self.check(space)
        points = np.column_stack([self.at, np.full(len(self.at), 0.5)])
        unit = space.layout.field(self.field).unit
        return Functionals(
            space.evaluation(points, self.field), tuple(f"T at {x}" for x in self.at), unit, points,
            np.zeros((len(points), 2)), np.arange(len(points)),
        )  # fmt: skip


@dataclass(frozen=True)
class End(QuantityOfInterest):
    over_time: Over = "each"

    def functionals(self, space):
        row = csr_array(space.boundary_mean("right", "T"))
        return Functionals(row, ("T right",), "K", np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, dtype=np.int64))
