"""What to beware of in a scene of heat conduction, known before anything is solved."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dacore.core.mesh import Mesh
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.simplex import barycentric_gradients

# Measured on boxes cut into right simplices in two and three dimensions, and on a ball of lattice cells.
MARGIN = 3.0


@dataclass(frozen=True)
class Undershoot:
    """Temperatures leave the bounds of their data beside a jump if a step is too short for the mesh.

    A step of elements of order 1 holds ``capacity M + conductivity/c K`` with c the factor of rates, 1/τ for backward
    Euler. On a regular simplex of edge h its entries between two corners are not positive, so that a step keeps the
    bounds, exactly if ``conductivity/(capacity c) ≥ h²/(2 (d + 2))``. Simplices of other shapes need more; with
    `MARGIN` times as much no temperature left its bounds by more than a hundredth of the jump.

    Parameters
    ----------
    dim : int
    size : float [cm]
        Edge h of the regular simplex whose heights have the sum of inverse squares of the median cell.
    slowest : float
        The smallest factor of conductivity/capacity on any cell.
    walls : mapping of str to float
        For each parameter that is a held temperature, its factor at t = 0.
    """

    dim: int
    size: float
    slowest: float
    walls: Mapping[str, float]

    @classmethod
    def on(cls, mesh: Mesh, order: int, slowest: float, walls: Mapping[str, float]) -> "Undershoot":
        """Return the caution for elements of `order` on a mesh; those of order 2 count as cells of half the size."""
        gradients = barycentric_gradients(mesh.points, mesh.cells)[0]
        sizes = np.sqrt(2 * mesh.dim / np.einsum("cki,cki->c", gradients, gradients))
        return cls(mesh.dim, float(np.median(sizes)) / order, slowest, walls)

    def jumps(self, parameters: ParameterSpace) -> bool:
        """Whether a held temperature may differ from that of the body at t = 0."""
        start = parameters["initial"] if "initial" in parameters.names else None
        body = {0.0} if start is None else {start.low, start.high}
        held = (factor * end for name, factor in self.walls.items() for end in _ends(parameters[name]))
        return any(body != {each} for each in held)

    def shortest(self, parameters: ParameterSpace) -> float:
        """Shortest 1/c [s] that keeps within a hundredth of the bounds, for the slowest material of the ranges."""
        diffusivity = self.slowest * parameters["conductivity"].low / parameters["capacity"].high
        return MARGIN * self.size**2 / (2 * (self.dim + 2) * diffusivity)

    def __call__(self, parameters: ParameterSpace, lag: float) -> str:
        """Return the warning for the ranges of `parameters`, or nothing; `lag` is 1/c [s]."""
        needed = self.shortest(parameters)
        if lag >= needed or not self.jumps(parameters):
            return ""
        return (
            f"T leaves its bounds beside jumps in the first steps: a step is {lag:.2g} s and cells are "
            f"{self.size:.2g} cm, which need {needed:.2g} s; take longer steps, a finer mesh, a course that rises, or "
            "a steady start"
        )


def _ends(parameter: Parameter) -> tuple[float, float]:
    return parameter.low, parameter.high
