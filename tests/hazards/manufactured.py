"""One step of quasi-static poroelasticity on the unit square, from rest to a state known by formula.

The displacement is free of divergence and the pressure is zero on the boundary, so that the same state solves the
equations for every ν, κ, S and τ; only the sources differ.
"""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from dacore.core.fespace import FiniteElementSpace
from dacore.core.model import AffineModel, Load
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Constant
from dacore_biot import material
from dacore_biot.conditions import fixed_parameters
from dacore_biot.operators import biot_fields, biot_terms
from tests.backends import backend

TISSUE = {"E": 3e5, "nu": 0.425, "kappa": 3e-9, "density": 1.0, "viscosity": 1e-2, "alpha": 1.0, "skempton": 0.99}


def pressure(points):
    """p/μ_s: sin πx sin πy."""
    return np.sin(np.pi * points).prod(axis=1)


def displacement(points):
    """The curl of sin²πx sin²πy, over 2π: (n, 2)."""
    x, y = np.pi * points.T
    return np.stack([np.sin(x) ** 2 * np.sin(2 * y), -np.sin(2 * x) * np.sin(y) ** 2], axis=1) / 2


def force(points):
    """−∇·2ε(u) + ∇p/μ_s: what holds the state; ∇·u = 0 (n, 2)."""
    x, y = np.pi * points.T
    laplace = np.pi**2 * np.stack(
        [
            np.cos(2 * x) * np.sin(2 * y) - 2 * np.sin(x) ** 2 * np.sin(2 * y),
            2 * np.sin(2 * x) * np.sin(y) ** 2 - np.sin(2 * x) * np.cos(2 * y),
        ],
        axis=1,
    )
    slope = np.pi * np.stack([np.cos(x) * np.sin(y), np.sin(x) * np.cos(y)], axis=1)
    return slope - laplace


@dataclass(frozen=True)
class Errors:
    """Relative L² errors, and how much more than the exact pressure the computed one varies from node to node."""

    displacement: float
    pressure: float
    overshoot: float


def square(cells, wild=False):
    """The unit square in 2 · cells² triangles; `wild` ones have corners moved by up to a fifth of their size."""
    mesh = Box((0.0, 0.0), (1.0, 1.0), (cells, cells), {"rim": ("x-", "x+", "y-", "y+")}).mesh()
    if not wild:
        return mesh
    points = mesh.points.copy()
    inside = np.setdiff1d(np.arange(len(points)), mesh.boundary_nodes("rim"))
    points[inside] += np.random.default_rng(5).uniform(-0.2, 0.2, (len(inside), 2)) / cells
    return replace(mesh, points=points)


def one_step(cells=16, order=1, stabilization="none", step=5e-4, wild=False, tolerance=1e-10, name="skfem", **changes):
    """Solve and compare; `changes` are of `TISSUE`."""
    theta = TISSUE | changes
    mesh = square(cells, wild)
    discretization = backend(name).discretize(mesh, biot_fields(2, order))
    layout, terms = discretization.layout, biot_terms(discretization, stabilization)
    u, p = layout.block("u"), layout.block("p")
    nodes, mass_u, mass_p = mesh.nodes(order), discretization.scalar_mass("u"), discretization.scalar_mass("p")
    shear = material.shear(theta)
    exact = np.zeros(layout.n_dofs)
    exact[u], exact[p] = displacement(nodes).T.ravel(), shear * pressure(mesh.points)
    source = np.zeros(layout.n_dofs)
    source[u] = shear * (mass_u @ force(nodes)).T.ravel()
    source[p] = mass_p @ (exact[p] * (material.storage(theta) / step + material.mobility(theta) * 2 * np.pi**2))
    held = np.zeros(layout.n_dofs, dtype=bool)
    for axis in range(2):
        held[layout.component("u", axis).start + mesh.boundary_nodes("rim", order)] = True
    held[p.start + mesh.boundary_nodes("rim")] = True
    load = Load("source", itemgetter("one"), Constant(), source, np.where(held, exact, 0.0))
    theta["one"] = 1.0
    model = AffineModel(
        FiniteElementSpace(discretization), fixed_parameters(theta), (), terms.first_order, terms.zeroth_order,
        (load,), held, terms.flow,
    )  # fmt: skip
    found = MarchedModel(model, TimeGrid(step, 1), tolerance=tolerance).solve(theta).states[:, 0]

    def size(values, mass):
        return np.sqrt(np.sum(values * (mass @ values)))

    split = (found - exact)[u].reshape(2, -1).T, exact[u].reshape(2, -1).T
    return Errors(
        size(split[0], mass_u) / size(split[1], mass_u),
        size((found - exact)[p], mass_p) / size(exact[p], mass_p),
        float(np.abs(found[p]).max() / np.abs(exact[p]).max() - 1.0),
    )
