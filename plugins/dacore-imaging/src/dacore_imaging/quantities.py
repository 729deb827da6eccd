"""Means of a field over a boundary or over the domain."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse
from dacore.core.observation import Functionals
from dacore.core.quantity import Over, QuantityOfInterest
from dacore.core.simplex import barycentric_gradients, local_edges
from dacore.core.space import CellGeometry, StateSpace
from dacore.errors import ShapeError
from dacore.geometry.clip import basis_means


@dataclass(frozen=True)
class BoundaryMean(QuantityOfInterest):
    """Mean of one component of a field over a boundary, ∫ p dΓ / ∫ dΓ.

    With the defaults and the mean over time it is the ventricular pressure p_v of Galarce et al.
    2023, whose formula lacks the 1/T.

    Parameters
    ----------
    role : str
        Boundary.
    field : str
    component : int
    over_time : {"mean", "each"}
        One number a series, or one number a step.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"boundary"})

    role: str = "ventricles"
    field: str = "p"
    component: int = 0
    over_time: Over = "mean"

    def __post_init__(self) -> None:
        _check(self.component, self.over_time)

    def functionals(self, space: StateSpace) -> Functionals:
        """Return the one functional; MeshError or CapabilityError if there is no such boundary or field."""
        block = space.layout.component(self.field, self.component)
        row = csr_array(space.boundary_mean(self.role, self.field)[[self.component]])
        centre = np.full((1, 3), np.nan)
        if "cells" in space.capabilities:
            centre = csr_array(row[:, block]) @ _node_points(space.cells(), self.field)
        return _functionals(space, self.field, self.component, row, centre, f"over {self.role}")


@dataclass(frozen=True)
class VolumeMean(QuantityOfInterest):
    """Mean of one component of a field over the whole domain, ∫ p dx / |Ω|.

    Parameters
    ----------
    field : str
    component : int
    over_time : {"mean", "each"}
        One number a series, or one number a step.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"cells"})

    field: str = "p"
    component: int = 0
    over_time: Over = "mean"

    def __post_init__(self) -> None:
        _check(self.component, self.over_time)

    def functionals(self, space: StateSpace) -> Functionals:
        """Return the one functional; CapabilityError if the space has no cells or no such field."""
        space.layout.component(self.field, self.component)
        geometry = space.cells()
        nodes, order = geometry.nodes[self.field], geometry.orders[self.field]
        volumes = np.abs(barycentric_gradients(geometry.points, geometry.cells)[1])
        means = basis_means(order, np.eye(geometry.cells.shape[1])[None])[0]
        weights = np.bincount(nodes.ravel(), (volumes[:, None] * means).ravel()) / volumes.sum()
        row = space.place(csr_array(weights[None]), self.field, [self.component])
        centre = weights[None] @ _node_points(geometry, self.field)
        return _functionals(space, self.field, self.component, row, centre, "over the domain")


def _check(component: int, over_time: Over) -> None:
    if component < 0:
        raise ShapeError(f"component: got {component}, expected 0 or more")
    if over_time not in ("mean", "each"):
        raise ShapeError(f"over_time: got {over_time!r}, expected 'mean' or 'each'")


def _functionals(space: StateSpace, name: str, component: int, row: Sparse, centre: Array, where: str) -> Functionals:
    """One functional with its label and the centroid of where it looks."""
    field = space.layout.field(name)
    dim = centre.shape[1]
    direction = np.zeros((1, dim))
    suffix = "" if field.components == 1 else f"_{component}"
    if field.components == dim:
        direction[0, component] = 1.0
        suffix = f"_{'xyz'[component]}"
    label = f"mean of {name}{suffix} {where}"
    return Functionals(row, (label,), field.unit, centre, direction, np.zeros(1, dtype=np.int64))


def _node_points(geometry: CellGeometry, field: str) -> Array:
    """Coordinates (n_nodes, d) [cm] of the nodes of a field."""
    corners = geometry.points[geometry.cells]
    if geometry.orders[field] == 2:
        edges = np.array(local_edges(geometry.points.shape[1]))
        corners = np.concatenate([corners, corners[:, edges].mean(axis=2)], axis=1)
    nodes = geometry.nodes[field]
    out = np.zeros((int(nodes.max()) + 1, geometry.points.shape[1]))
    out[nodes.ravel()] = corners.reshape(-1, out.shape[1])
    return out
