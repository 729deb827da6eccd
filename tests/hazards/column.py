"""A column of tissue, drained at its top, after the pressure there or a load on it jumps at t = 0.

It stands on a fixed bottom between frictionless walls, so that all moves along one axis.
"""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from dacore.core.model import Load
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Constant
from dacore_biot import material
from dacore_biot.conditions import Conditions, fixed_parameters, normal_force, poroelastic
from dacore_biot.operators import biot_fields, biot_terms
from tests.backends import backend
from tests.hazards.manufactured import TISSUE

HEIGHT = 4.0
SUDDEN = TimeGrid(5e-4, 20)
SIDES = ("x-", "x+", "y-", "y+")


@dataclass(frozen=True)
class Column:
    """How a column is computed: cells of its height, order of u, remedy, and whether tissue has inertia.

    It is `width` cells wide: on a single one, pressures of opposite sign on the two walls disturb the projection.
    """

    cells: int
    order: int = 1
    stabilization: str = "none"
    inertia: bool = True
    height: float = HEIGHT
    name: str = "skfem"
    width: int = 4

    def mesh(self):
        size = self.height / self.cells
        return Box(
            (0.0, 0.0), (size * self.width, self.height), (self.width, self.cells), {side: (side,) for side in SIDES}
        ).mesh()

    def model(self, cause, theta):
        """Make it; `cause` is a "load": a total pressure of 1 on the top, where p = 0, or a "pressure" there."""
        discretization = backend(self.name).discretize(self.mesh(), biot_fields(2, self.order))
        layout, mesh = discretization.layout, discretization.mesh
        held = np.zeros(layout.n_dofs)
        held[layout.block("p").start + mesh.boundary_nodes("y+")] = float(cause == "pressure")
        load = Load(cause, itemgetter("one"), Constant(), -normal_force(discretization, "y+"), held)
        conditions = Conditions({"y-": (0, 1), "x-": (0,), "x+": (0,)}, ("y+",))
        parameters = fixed_parameters(theta | {"one": 1.0})
        made = poroelastic(discretization, parameters, conditions, [load], self.inertia)
        return replace(made, first_order=biot_terms(discretization, self.stabilization).first_order)

    def solve(self, cause, grid=SUDDEN, scheme=None, **changes):
        """Return heights (n,), pressures (n, t) along the left wall, and displacements (n, t), their means across."""
        theta = TISSUE | changes
        model = self.model(cause, theta)
        states = MarchedModel(model, grid, scheme).solve(theta | {"one": 1.0}).states
        layout, points = model.space.layout, model.space.discretization.mesh.points
        by_height = np.lexsort([points[:, 0], points[:, 1].round(9)])
        rows = by_height.reshape(self.cells + 1, self.width + 1)
        moved = states[layout.component("u", 1)][: len(points)][rows]
        return points[rows[:, 0], 1], states[layout.block("p")][rows[:, 0]], moved.mean(axis=1)


def diffusivity(**changes):
    """c_v = κ/μ_f (λ + 2μ_s)/(1 + S(λ + 2μ_s)/α²)/α² [cm²/s] of the column."""
    theta = TISSUE | changes
    return material.mobility(theta) / (material.confined_swelling(theta) + material.storage(theta))


def at(heights, column):
    """Interpolate what `Column.solve` gave to other heights: pressures and displacements."""
    own, *fields = column
    return tuple(np.stack([np.interp(heights, own, values) for values in field.T], axis=1) for field in fields)


def difference(field, exact, scale=None):
    """Relative difference over nodes and times; the largest absolute entry of `scale` stands for the field if given."""
    reference = np.linalg.norm(exact if scale is None else scale)
    return float(np.linalg.norm(field - exact) / reference)
