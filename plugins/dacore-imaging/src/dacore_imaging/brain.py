"""The MNI152 brain with its ventricles, as a tetrahedral mesh."""

import hashlib
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from dacore.core.arrays import Array
from dacore.core.domain import Domain
from dacore.core.mesh import Mesh, exterior_facets
from dacore.errors import MeshError
from dacore.geometry.quality import Quality, check_quality, enclosed_volume, on_cavity
from dacore.geometry.sampled import SampledLevelSet
from dacore.geometry.stuffing import stuff
from dacore_imaging.template import outlines, template_files

LENGTH = 16.86
"""Extent [cm] from back to front: the paper's L."""
_CUT = -70.0
"""Height [mm] of the planar cut through the brainstem in the template."""
_EDGES = {"5k": 1.06, "33k": 0.5075, "100k": 0.336}
_TISSUE, _CAVITY = 1478.0, 17.2
"""Volumes [cm³] of the limit of fine meshes."""


@dataclass(frozen=True)
class Brain(Domain):
    """Brain tissue of the MNI152 template; the lateral and third ventricles are a hole.

    Coordinates in cm: y runs from the back (0) to the front (16.86), z up from the planar cut
    through the brainstem (0), x to the right with 0 in the symmetry plane. Roles: "ventricles",
    the inner surface; "neck", the facets of the outer surface whose centroid is below
    `neck_height`, which is held; "mre", all the rest outside.

    Parameters
    ----------
    nodes : {"5k", "33k", "100k"}
        Size of the mesh: about 5,000, 33,000 or 100,000 nodes.
    edge : float, optional [cm]
        Edge of the background lattice instead of `nodes` (1.06, 0.5075 and 0.336 for the three
        sizes); half of it at the ventricles and at the neck.
    neck_height : float [cm]
        Up to where the outer surface is held. 1 cm holds about 21 cm². The cut alone (1.2 cm²)
        holds the brain too softly to stand the load of one cycle.

    Raises
    ------
    MeshError
        If a setting is out of range.
    """

    tags: ClassVar[dict[str, int]] = {"neck": 1, "ventricles": 2, "mre": 3}

    nodes: Literal["5k", "33k", "100k"] = "5k"
    edge: float | None = None
    neck_height: float = 1.0

    def __post_init__(self) -> None:
        if self.nodes not in _EDGES:
            raise MeshError(f"brain nodes: got {self.nodes!r}, expected one of {', '.join(_EDGES)}")
        if self.edge is not None and not 0.15 <= self.edge <= 1.15:
            raise MeshError(f"brain edge: got {self.edge} cm, expected 0.15 to 1.15 (coarser loses the ventricles)")
        if not 0.2 <= self.neck_height <= 7.0:
            raise MeshError(f"brain neck_height: got {self.neck_height} cm, expected 0.2 to 7")

    def _edge(self) -> float:
        return _EDGES[self.nodes] if self.edge is None else float(self.edge)

    def expected_nodes(self) -> int:
        """About as many as lattices of this edge have in the volume, and more near the surfaces."""
        edge = self._edge()
        return round((2.0 + 2.0 * edge) * _TISSUE / edge**3)

    def mesh(self) -> Mesh:
        """Mesh the template [cm]; MeshError if the result fails its checks."""
        edge = self._edge()
        envelope, ventricles = _placed_outlines()

        def level_set(points: Array) -> Array:
            return np.maximum(envelope(points), -ventricles(points))

        def sizing(points: Array) -> Array:
            fine = (np.abs(ventricles(points)) < 0.6 * edge) | (points[:, 2] < 0.75 * edge)
            return np.where(fine, 0.5 * edge, edge)

        lower, upper = _box(envelope)
        points, cells = stuff(level_set, lower, upper, edge, sizing, floor=True, accept=_topology)
        facets = exterior_facets(cells)
        inner = on_cavity(points, facets)
        low = points[facets][:, :, 2].mean(axis=1) < self.neck_height
        tags = np.where(inner, self.tags["ventricles"], np.where(low, self.tags["neck"], self.tags["mre"]))
        mesh = Mesh(points, cells, facets, tags, self.tags)
        # A coarse surface cuts corners: the error of both volumes is of second order in the edge.
        slack = 0.01 + 0.02 * edge**2
        check_quality(mesh, 10.0, ((1 - slack) * _TISSUE, (1 + slack) * _TISSUE), (2, 2))
        _check_cavity(-enclosed_volume(points, facets[inner]), edge)
        return mesh

    def fingerprint(self) -> str:
        """SHA-256 of the template's images."""
        digest = hashlib.sha256()
        for path in template_files().values():
            digest.update(path.read_bytes())
        return digest.hexdigest()


def _topology(quality: Quality) -> str:
    return "" if quality.euler == (2, 2) else f"surfaces of Euler characteristic {quality.euler}, expected (2, 2)"


def _check_cavity(volume: float, edge: float) -> None:
    slack = 0.03 + 0.15 * edge**2
    if abs(volume - _CAVITY) > slack * _CAVITY:
        raise MeshError(
            f"brain: ventricles of {volume:.2f} cm³, expected {_CAVITY} within {100 * slack:.0f}%; use a smaller edge"
        )


def _placed_outlines() -> tuple[SampledLevelSet, SampledLevelSet]:
    """Envelope and ventricles in the domain's coordinates [cm]."""
    found = outlines()
    back, front = _extent(found.envelope, 1)
    scale = LENGTH / (front - back)
    shift = -scale * np.array([0.0, back, _CUT])
    return found.envelope.placed(scale, shift), found.ventricles.placed(scale, shift)


def _extent(level_set: SampledLevelSet, axis: int) -> tuple[float, float]:
    """Lowest and highest coordinate of the region on an axis, between samples."""
    profile = level_set.samples.min(axis=tuple(k for k in range(3) if k != axis))
    inside = np.flatnonzero(profile < 0.0)
    if inside[0] == 0 or inside[-1] == len(profile) - 1:
        raise MeshError("brain: the outline touches the edge of the image")
    low, high = inside[0], inside[-1]
    ends = (
        low - profile[low] / (profile[low] - profile[low - 1]),
        high + profile[high] / (profile[high] - profile[high + 1]),
    )
    first, last = (float(level_set.origin[axis] + level_set.spacing * end) for end in ends)
    return first, last


def _box(envelope: SampledLevelSet) -> tuple[Array, Array]:
    """Corners of the part of the envelope's grid that is above the cut and holds the region."""
    sides = [_extent(envelope, axis) for axis in (0, 1)]
    profile = envelope.samples.min(axis=(0, 1))
    top = envelope.origin[2] + envelope.spacing * (np.flatnonzero(profile < 0.0)[-1] + 1)
    return np.array([sides[0][0], sides[1][0], 0.0]), np.array([sides[0][1], sides[1][1], top])
