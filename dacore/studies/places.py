"""Where the nodes of a space are, and where points are in the cells of another, outside them too."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.display import Displayed
from dacore.core.simplex import barycentric_gradients, lagrange, local_edges
from dacore.core.space import CellGeometry, StateSpace
from dacore.errors import CapabilityError, ShapeError
from dacore.geometry.locate import PointLocator
from dacore.geometry.nearest import NearestPoint

Outside = Literal["nearest", "extend", "error"]
# Barycentric coordinates below this are rounding: a point on a facet is on it.
_DUST = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class FieldTransfer(Displayed):
    """One component of one field.

    Parameters
    ----------
    matrix : (n_target, n_source) csr_array
        Between the nodes of the two spaces.
    outside : int
        Number of the target's nodes that are outside the source's domain.
    distance : float [cm]
        How far the farthest of them is away; 0 if there are none.
    """

    matrix: Sparse
    outside: int
    distance: float


def node_places(space: StateSpace, field: str) -> Array:
    """Places (n_nodes, d) [cm] of a field's nodes; CapabilityError if the space cannot tell."""
    geometry = cells_of(space, "space")
    nodes, order = geometry.nodes[field], geometry.orders[field]
    corners = geometry.points[geometry.cells]
    places = [corners]
    if order == 2:
        places.append(corners[:, np.array(local_edges(corners.shape[2]))].mean(axis=2))
    out = np.full((space.layout.nodes[field], corners.shape[2]), np.nan)
    out[nodes] = np.concatenate(places, axis=1)
    if np.isnan(out).any():
        lost = int(np.isnan(out).any(axis=1).sum())
        raise CapabilityError(f"transfer: {lost} nodes of {field} are in no cell, so that nobody knows where they are")
    return out


def cells_of(space: StateSpace, role: str) -> CellGeometry:
    """Cells of a space that plays a role, for the message; CapabilityError if it has none."""
    if "cells" not in space.capabilities:
        raise CapabilityError(
            f"transfer: the {role}, {type(space).__name__}, has no cells, so that nobody knows where its nodes are; "
            "expected a space of finite elements"
        )
    return space.cells()


class Finder:
    """Where points are in a source, found once for each set of them.

    Parameters
    ----------
    geometry : CellGeometry
    outside : {"nearest", "extend", "error"}
        What a point outside takes: the value at the nearest point, the nearest cell's polynomial, or ShapeError.
    """

    def __init__(self, geometry: CellGeometry, outside: Outside) -> None:
        self._geometry, self._outside = geometry, outside
        self._known: list[tuple[Array, tuple[IntArray, Array, Array]]] = []

    def transfer(self, field: str, x: Array, n_source: int) -> FieldTransfer:
        """Operator from a field's nodes to points x (p, d)."""
        cell, barycentric, distance = self._place(field, x)
        nodes = self._geometry.nodes[field][cell]
        values = lagrange(self._geometry.orders[field], barycentric).copy()  # of order 1 they are the coordinates
        start = np.arange(len(x) + 1) * nodes.shape[1]
        matrix = csr_array((values.ravel(), nodes.ravel(), start), shape=(len(x), n_source))
        matrix.eliminate_zeros()
        matrix.sort_indices()
        return FieldTransfer(matrix, int(np.isfinite(distance).sum()), float(np.nanmax(distance, initial=0.0)))

    def _place(self, field: str, x: Array) -> tuple[IntArray, Array, Array]:
        """Cell, coordinates in it and distance (NaN inside) of each point."""
        for known, found in self._known:
            if known.shape == x.shape and np.array_equal(known, x):
                return found
        cell, barycentric = self._locator.locate(x, outside="mark")
        distance, missing = np.full(len(x), np.nan), np.flatnonzero(cell < 0)
        if missing.size:
            cell[missing], barycentric[missing], distance[missing] = self._nearest.find(x[missing])
            if self._outside == "error":
                worst = missing[distance[missing].argmax()]
                place = ", ".join(f"{value:.4g}" for value in x[worst])
                raise ShapeError(
                    f"transfer of {field}: {len(missing)} of {len(x)} nodes are outside the source's domain, the "
                    f"farthest at ({place}), {distance[worst]:.2g} cm away; expected none: take outside = 'nearest'"
                )
            if self._outside == "extend":
                barycentric[missing] = self._continued(x[missing], cell[missing])
        barycentric[np.abs(barycentric) < _DUST] = 0.0
        barycentric /= barycentric.sum(axis=1, keepdims=True)
        self._known.append((x, (cell, barycentric, distance)))
        return cell, barycentric, distance

    def _continued(self, x: Array, cell: IntArray) -> Array:
        """Barycentric coordinates (p, d + 1) of points in cells that do not hold them."""
        corners = self._geometry.cells[cell]
        gradients, _ = barycentric_gradients(self._geometry.points, corners)
        rest = np.einsum("pid,pd->pi", gradients[:, 1:], x - self._geometry.points[corners[:, 0]])
        return np.concatenate([1.0 - rest.sum(axis=1, keepdims=True), rest], axis=1)

    @cached_property
    def _locator(self) -> PointLocator:
        return PointLocator(self._geometry.points, self._geometry.cells)

    @cached_property
    def _nearest(self) -> NearestPoint:
        return NearestPoint(self._geometry.points, self._geometry.cells)
