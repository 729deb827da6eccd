"""Tissue that is stiffer or softer somewhere: Young's modulus times a number on each cell.

With E(x) = s(x) E and everything else the same, shear and dilation are weighted by s on each cell, the storage, which
has E in its denominator, by 1/s. The model has as many terms as without, and stays affine in the same functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.mesh import Mesh
from dacore.errors import ShapeError


@dataclass(frozen=True)
class Inclusion:
    """A ball of another stiffness: the cells whose centroids lie in it.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    radius : float [cm]
    stiffness : float
        Young's modulus inside relative to the rest: 2 is twice as stiff.
    """

    centre: tuple[float, ...]
    radius: float
    stiffness: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.centre).all():
            raise ShapeError(f"inclusion: got the centre {list(self.centre)}, expected finite coordinates")
        for name in ("radius", "stiffness"):
            if not 0 < getattr(self, name) < np.inf:
                raise ShapeError(f"inclusion: got {name} {getattr(self, name)}, expected a positive number")


def stiffness_factors(mesh: Mesh, inclusions: Sequence[Inclusion]) -> Array | None:
    """Factor (c,) of E on each cell; where balls overlap the last one counts. None without inclusions.

    Raises
    ------
    ShapeError
        If a centre has another dimension than the mesh, or no cell's centroid lies in a ball.
    """
    if not inclusions:
        return None
    centroids = mesh.points[mesh.cells].mean(axis=1)
    factors = np.ones(len(centroids))
    for number, inclusion in enumerate(inclusions):
        if len(inclusion.centre) != mesh.dim:
            raise ShapeError(
                f"inclusion {number}: got a centre of {len(inclusion.centre)} coordinates, expected {mesh.dim}"
            )
        away = np.linalg.norm(centroids - np.array(inclusion.centre), axis=1)
        inside = away <= inclusion.radius
        if not inside.any():
            raise ShapeError(
                f"inclusion {number}: no cell's centroid lies within {inclusion.radius:g} cm of "
                f"{list(inclusion.centre)}, the nearest is {away.min():.3g} cm away; move it or make it larger"
            )
        factors[inside] = inclusion.stiffness
    return factors
