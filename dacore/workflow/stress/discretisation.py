"""Meshes and elements at their limits: slivers, grading, locking, oscillating pressures."""

from collections.abc import Callable
from itertools import combinations, permutations
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.core.fields import Field
from dacore.core.mesh import Mesh, exterior_facets
from dacore.core.model import AffineModel
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.workflow.stress.case import Case, Outcome
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.physics import compare
from dacore.workflow.stress.reference import EPS, long

STEPS = 6


def _smallest_angle(mesh: Mesh) -> float:
    """Smallest angle [degrees] between two facets of a cell."""
    gradients = _gradients(mesh)
    unit = gradients / np.linalg.norm(gradients, axis=2, keepdims=True)
    worst = max(float((unit[:, i] * unit[:, j]).sum(axis=1).max()) for i, j in _opposite(mesh.dim))
    # Inward normals of two facets with the angle φ between them have the product −cos φ.
    least = min(float((unit[:, i] * unit[:, j]).sum(axis=1).min()) for i, j in _opposite(mesh.dim))
    return float(np.degrees(min(np.arccos(np.clip(-least, -1, 1)), np.pi - np.arccos(np.clip(-worst, -1, 1)))))


def _opposite(dim: int) -> list[tuple[int, int]]:
    return list(combinations(range(dim + 1), 2))


def _gradients(mesh: Mesh) -> Array:
    """Gradients (c, d + 1, d) of the barycentric coordinates."""
    corners = mesh.points[mesh.cells]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    return np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)


def _slivers(context: Context) -> Mesh:
    """The scene's mesh, squeezed along its last axis until the smallest angle is one degree."""
    mesh = context.mesh

    def squeezed(factor: float) -> Mesh:
        points = mesh.points.copy()
        points[:, -1] *= factor
        return Mesh(points, mesh.cells, mesh.facets, mesh.facet_tags, mesh.roles)

    low, high = 1e-4, 1.0
    for _ in range(30):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if _smallest_angle(squeezed(middle)) < 1.0 else (low, middle)
    return squeezed(high)


def _graded(context: Context) -> Mesh:
    """A box with the scene's roles, whose layers shrink a millionfold towards one side."""
    roles = context.mesh.roles
    axes = [np.linspace(0.0, 4.0, 5)] * (context.mesh.dim - 1) + [np.append(0.0, np.geomspace(4e-6, 4.0, 21))]
    shape = [len(axis) for axis in axes]
    points = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=1)
    strides = np.array([int(np.prod(shape[k + 1 :])) for k in range(len(shape))])
    corner = sum(
        part.ravel() * stride
        for part, stride in zip(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), strides, strict=True)
    )
    pieces = [
        np.asarray(corner)[:, None] + np.concatenate([[0], np.cumsum(strides[list(p)])])
        for p in permutations(range(len(shape)))
    ]
    cells = np.concatenate(pieces)
    edges = points[cells][:, 1:] - points[cells][:, :1]
    flipped = np.linalg.det(edges) < 0
    cells[flipped, :2] = cells[flipped, 1::-1]
    facets = exterior_facets(cells)
    # The roles in turn, each on a side of its own; the last has all that is left.
    sides = [(points[facets, axis] == at).all(axis=1) for axis in range(len(shape)) for at in (0.0, 4.0)]
    tags = np.full(len(facets), list(roles.values())[-1])
    for tag, side in zip(list(roles.values())[:-1], sides[::-1], strict=False):
        tags[side] = tag
    return Mesh(points, cells, facets, tags, roles)


def _forms(make: Callable[[Context], Mesh]) -> Callable[[Context], Outcome]:
    """Energies of linear fields, which every form has exactly: the volume times a number known beforehand."""

    def run(context: Context) -> Outcome:
        mesh = make(context)
        d = mesh.dim
        fields = (Field("u", d, 1, "cm"), Field("p", 1, 1, "dyn/cm^2"))
        forms = context.ask(lambda: context.builder.backend.discretize(mesh, fields))
        slope = context.rng(1).standard_normal((d, d))
        x = mesh.points - mesh.points.mean(axis=0)
        vector, scalar = (x @ slope.T).T.ravel(), x @ slope[0]
        corners = long(mesh.points)[mesh.cells]
        edges = corners[:, 1:] - corners[:, :1]
        volume = _determinants(edges).sum() / (6 if d == 3 else 2)
        sym, trace = 0.5 * (slope + slope.T), np.trace(slope)
        ones = np.ones(len(mesh.points))
        pairs = [
            (ones @ (forms.scalar_mass("p") @ ones), 1.0),
            (scalar @ (forms.scalar_stiffness("p") @ scalar), float(slope[0] @ slope[0])),
            (vector @ (forms.strain("u") @ vector), float((sym**2).sum())),
            (vector @ (forms.divergence("u") @ vector), float(trace**2)),
            (ones @ (forms.divergence_coupling("u", "p") @ vector), float(trace)),
            (vector @ (forms.gradient_coupling("p", "u") @ scalar), None),
        ]
        worst = 0.0
        for found, exact in pairs:
            expected = _moment(mesh, vector, slope[0]) if exact is None else exact * volume
            worst = max(worst, float(abs(found - expected) / abs(expected)))
        stretch = float(np.linalg.cond(edges.astype(np.float64)).max())
        return Outcome(worst, 10 * EPS * stretch, note=f"cells are stretched up to {stretch:.0e} : 1")

    return run


def _determinants(edges: Any) -> Any:
    """Determinants (c,) of (c, d, d) arrays in extended precision."""
    if edges.shape[1] == 2:
        return edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    return (edges[:, 0] * np.cross(edges[:, 1], edges[:, 2])).sum(axis=1)


def _moment(mesh: Mesh, vector: Array, slope: Array) -> Any:
    """∫ ∇p·v of a linear v in extended precision: cell volumes times means of v over the corners."""
    corners = long(mesh.points)[mesh.cells]
    volumes = _determinants(corners[:, 1:] - corners[:, :1]) / (6 if mesh.dim == 3 else 2)
    values = long(vector.reshape(mesh.dim, -1))[:, mesh.cells].mean(axis=2)
    return (long(slope) @ values) @ volumes


def _marched(make: Callable[[Context], Mesh]) -> Callable[[Context], Outcome]:
    def run(context: Context) -> Outcome:
        return compare(context, context.affine(context.builder.physics, make(context)), context.parameters())

    return run


def _against_quadratic(field: str, stabilization: str, **changes: float) -> Any:
    """Distance to elements of order 2 on the same mesh; nominal is twice that distance in the middle of the ranges."""

    def run(context: Context) -> Outcome:
        model = context.affine(context.physics(displacement_order=1, stabilization=stabilization))
        plain = context.affine(context.physics(displacement_order=1, stabilization="none"))
        finer = context.affine(context.physics(displacement_order=2, stabilization="none"))
        nominal = 2 * _distance(context, plain, finer, field, context.parameters())
        values = context.parameters(**changes)
        error = context.ask(lambda: _distance(context, model, finer, field, values))
        # A run says before it trains what its parameters have to fear.
        points = context.session.parameters.restrict({name: (value, value) for name, value in values.items()})
        told = "; ".join(MarchedModel(model, TimeGrid(context.step, STEPS), context.scheme).cautions(points))
        return Outcome(error, nominal, told, f"{field} against order 2")

    return run


def _distance(context: Context, model: AffineModel, finer: AffineModel, field: str, values: dict[str, float]) -> float:
    """Relative difference of a field at the vertices, all steps together."""
    found, expected = (
        _at_vertices(
            each, MarchedModel(each, TimeGrid(context.step, STEPS), context.scheme).solve(values).states, field
        )
        for each in (model, finer)
    )
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _at_vertices(model: AffineModel, states: Array, field: str) -> Array:
    layout = model.space.layout
    count = layout.nodes["p"]
    parts = [states[layout.component(field, c)][:count] for c in range(layout.field(field).components)]
    return np.concatenate(parts)


_LOCK = "linear elements cannot keep their volume without freezing: the displacement comes out too small"
_RING = "equal-order elements let a pressure alternate from node to node"

CASES = (
    Case("slivers of 1 degree, forms", "discretisation", "cells flattened to 1°", "gradients cancel", _forms(_slivers)),
    Case(
        "slivers of 1 degree, time steps",
        "discretisation",
        "cells flattened to 1°",
        "entries span decades",
        _marched(_slivers),
    ),
    Case(
        "graded mesh, forms",
        "discretisation",
        "layers from 4 cm to 4e-6 cm",
        "cells are stretched a million to one",
        _forms(_graded),
    ),
    Case(
        "graded mesh, time steps",
        "discretisation",
        "layers from 4 cm to 4e-6 cm",
        "entries span twelve decades",
        _marched(_graded),
    ),
    Case("locking, nu = 0.49", "discretisation", "ν = 0.49, linear u", _LOCK, _against_quadratic("u", "none", nu=0.49)),
    Case(
        "locking, nu = 0.4999",
        "discretisation",
        "ν = 0.4999, linear u",
        _LOCK,
        _against_quadratic("u", "none", nu=0.4999),
    ),
    *(
        Case(
            f"little seepage, {remedy}",
            "discretisation",
            f"κ = 1e-16 cm², B = 1, stabilization = '{remedy}'",
            _RING,
            _against_quadratic("p", remedy, kappa=1e-16, alpha=1.0, skempton=1.0),
        )
        for remedy in ("none", "projected", "lumped")
    ),
)
