"""A ball with a spherical cavity: a small stand-in for the brain with its ventricles."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dacore.core.arrays import Array
from dacore.core.domain import Domain
from dacore.core.mesh import Mesh, exterior_facets
from dacore.errors import MeshError
from dacore.geometry.quality import Quality, check_quality, on_cavity
from dacore.geometry.stuffing import stuff


@dataclass(frozen=True)
class Ball(Domain):
    """A ball with a spherical cavity, held at the bottom; z = 0 at its lowest point.

    Roles: "ventricles", the cavity's surface; "neck", the outer facets whose centroid is lower than
    `neck_height`; "mre", all the rest outside.

    Parameters
    ----------
    radius : float [cm]
    cavity_radius : float [cm]
    cavity_offset : tuple of 3 floats [cm]
        From the ball's centre to the cavity's.
    edge : float [cm]
        Edge of the background lattice; half of it at the cavity.
    neck_height : float [cm]

    Raises
    ------
    MeshError
        If a setting is out of range, or the cavity leaves the ball.
    """

    tags: ClassVar[dict[str, int]] = {"neck": 1, "ventricles": 2, "mre": 3}

    radius: float = 5.0
    cavity_radius: float = 1.5
    cavity_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    edge: float = 1.6
    neck_height: float = 1.0

    def __post_init__(self) -> None:
        for name in ("radius", "cavity_radius", "edge", "neck_height"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise MeshError(f"ball {name}: got {value} cm, expected a positive length")
        if len(self.cavity_offset) != 3 or not np.isfinite(self.cavity_offset).all():
            raise MeshError(f"ball cavity_offset: got {self.cavity_offset}, expected three lengths in cm")
        wall = self.radius - self.cavity_radius - float(np.linalg.norm(self.cavity_offset))
        if wall < self.edge:
            raise MeshError(
                f"ball: the wall round the cavity is {wall:.3g} cm thin, expected at least one edge "
                f"({self.edge:g} cm); use a smaller cavity, offset or edge"
            )
        if self.cavity_radius < 0.5 * self.edge:
            raise MeshError(
                f"ball edge: got {self.edge} cm, expected at most {2 * self.cavity_radius:g} cm, "
                "twice the cavity's radius"
            )
        if self.radius > 50 * self.edge:
            raise MeshError(
                f"ball edge: {self.edge} cm makes too many cells, expected at least {self.radius / 50:g} cm"
            )
        if self.neck_height >= 2.0 * self.radius:
            raise MeshError(f"ball neck_height: got {self.neck_height} cm, expected less than {2 * self.radius:g} cm")

    @property
    def volume(self) -> float:
        """Exact volume [cm³]."""
        return float(4.0 / 3.0 * np.pi * (self.radius**3 - self.cavity_radius**3))

    def expected_nodes(self) -> int:
        """About as many as lattices of this edge have in the volume, and more near both surfaces."""
        return round((2.5 + 7.3 * self.edge / self.radius) * self.volume / self.edge**3)

    def mesh(self) -> Mesh:
        """Make the mesh [cm]; MeshError if it fails its checks."""
        centre = np.array([0.0, 0.0, self.radius])
        inner = centre + np.array(self.cavity_offset)

        def to_cavity(points: Array) -> Array:
            return np.asarray(np.linalg.norm(points - inner, axis=1) - self.cavity_radius)

        def level_set(points: Array) -> Array:
            to_outside = np.linalg.norm(points - centre, axis=1) - self.radius
            return np.asarray(np.maximum(to_outside, -to_cavity(points)))

        def sizing(points: Array) -> Array:
            return np.where(np.abs(to_cavity(points)) < 0.6 * self.edge, 0.5 * self.edge, self.edge)

        points, cells = stuff(
            level_set, centre - self.radius, centre + self.radius, self.edge, sizing, accept=_two_spheres
        )
        facets = exterior_facets(cells)
        cavity = on_cavity(points, facets)
        low = points[facets][:, :, 2].mean(axis=1) < self.neck_height
        tags = np.where(cavity, self.tags["ventricles"], np.where(low, self.tags["neck"], self.tags["mre"]))
        mesh = Mesh(points, cells, facets, tags, self.tags)
        # Facets cut corners: the volume they miss is of second order in the edge.
        slack = 0.01 + (self.edge / self.radius) ** 2
        check_quality(mesh, 10.0, ((1.0 - slack) * self.volume, (1.0 + slack) * self.volume), (2, 2))
        return mesh


def _two_spheres(quality: Quality) -> str:
    return "" if quality.euler == (2, 2) else f"surfaces of Euler characteristic {quality.euler}, expected (2, 2)"
