"""Balls of another material, as a physics offers them in a scene: which cells lie in them, and what is there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dacore.core.arrays import Array
from dacore.core.mesh import Mesh
from dacore.errors import ShapeError


@dataclass(frozen=True)
class Ball:
    """A ball of another material: the cells whose centroids lie in it. A physics adds its properties as fields.

    Parameters
    ----------
    centre : tuple of float [cm]
        One coordinate a dimension.
    radius : float [cm]

    Raises
    ------
    ShapeError
        If a coordinate is not finite, or the radius not positive.
    """

    centre: tuple[float, ...]
    radius: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.centre).all():
            raise ShapeError(f"inclusion: got the centre {list(self.centre)}, expected finite coordinates")
        self.check_positive("radius")

    def check_positive(self, *names: str) -> None:
        """Raise ShapeError unless some of its numbers are positive and finite."""
        for name in names:
            if not 0 < getattr(self, name) < np.inf:
                raise ShapeError(f"inclusion: got {name} {getattr(self, name)}, expected a positive number")


def cell_factors(mesh: Mesh, balls: Sequence[Ball], what: str) -> Array | None:
    """Factor of a property on each cell, as weights of forms take it: 1 outside of the balls.

    Parameters
    ----------
    mesh : Mesh
    balls : sequence of Ball
        Where they overlap the last one counts.
    what : str
        The field of the balls that says their property relative to the rest.

    Returns
    -------
    (c,) array, or None
        None where it is one everywhere.

    Raises
    ------
    ShapeError
        If a centre has another dimension than the mesh, or no cell's centroid lies in a ball.
    """
    centroids = mesh.points[mesh.cells].mean(axis=1)
    out = np.ones(len(centroids))
    for number, ball in enumerate(balls):
        if len(ball.centre) != mesh.dim:
            raise ShapeError(f"inclusion {number}: got a centre of {len(ball.centre)} coordinates, expected {mesh.dim}")
        away = np.linalg.norm(centroids - np.array(ball.centre), axis=1)
        inside = away <= ball.radius
        if not inside.any():
            raise ShapeError(
                f"inclusion {number}: no cell's centroid lies within {ball.radius:g} cm of {list(ball.centre)}, the "
                f"nearest is {away.min():.3g} cm away; move it or make it larger"
            )
        out[inside] = getattr(ball, what)
    return None if (out == 1).all() else out
