"""What to beware of in a scene of elastic waves, known before anything is solved."""

from dataclasses import dataclass

import numpy as np

from dacore.core.mesh import Mesh
from dacore.core.parameters import ParameterSpace
from dacore_elastodynamics import material

LOCKING = 0.49
"""Poisson ratio from which displacements of order 1 are far too small."""
NODES = 10.0
"""Nodes in the shortest wave below which the mesh is called too coarse for it."""
STEPS = 20.0
"""Steps in a period below which they are called too long for it."""


@dataclass(frozen=True)
class Waves:
    """Waves are slowed and damped by a mesh or by steps that are too coarse for them.

    Parameters
    ----------
    spacing : float [cm]
        Median distance of neighbouring nodes.
    frequency : float [Hz]
        The highest of the loads.
    slowest : float
        The smallest factor of the speed of waves on any cell.
    """

    spacing: float
    frequency: float
    slowest: float

    def __call__(self, parameters: ParameterSpace, lag: float) -> str:
        """Return the warning for the ranges of `parameters`, or nothing; `lag` is 1/c [s], c the factor of rates."""
        ends = {"E": parameters["E"].low, "nu": parameters["nu"].high, "density": parameters["density"].high}
        length = self.slowest * material.shear_speed(ends) / self.frequency
        nodes, steps = length / self.spacing, 1.0 / (self.frequency * lag)
        said = []
        if nodes < NODES:
            said.append(f"the shortest shear wave, {length:.2g} cm, has {nodes:.2g} nodes (expected {NODES:g} or more)")
        if steps < STEPS:
            said.append(f"a period has {steps:.2g} steps (expected {STEPS:g} or more)")
        if not said:
            return ""
        what = " and ".join(said)
        return f"waves of {self.frequency:g} Hz are not resolved: {what}; take a finer mesh or shorter steps"


def locking(parameters: ParameterSpace, lag: float) -> str:
    """Return the warning for displacements of order 1 in nearly incompressible material, or nothing."""
    if parameters["nu"].high < LOCKING:
        return ""
    return (
        f"displacements are too small: they have order 1 and nu goes up to {parameters['nu'].high:g} (expected below "
        f"{LOCKING:g}); set physics.order = 2"
    )


def spacing(mesh: Mesh, order: int) -> float:
    """Median length of the edges over the order of the elements [cm]."""
    corners = mesh.points[mesh.cells]
    first, second = np.triu_indices(mesh.dim + 1, 1)
    return float(np.median(np.linalg.norm(corners[:, first] - corners[:, second], axis=-1))) / order
