"""The full Biot system against manufactured solutions: rates in space and in time, for u and p apart.

u = a(t) U(x) and p = b(t) P(x) are made of the model's own loads, one for each of a, ȧ, ä, b and ḃ.
u is held on the side x = 0, p on the other sides; the rest are traction and flux.
"""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from dacore.core.fespace import FiniteElementSpace
from dacore.core.model import AffineModel, Load
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.simplex import barycentric_gradients, lagrange, lagrange_gradient
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.generalized_alpha import GeneralizedAlpha
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.scheme import State
from dacore.dynamics.static import consistent_start
from dacore_biot import material
from dacore_biot.operators import biot_fields, biot_terms
from tests.backends import READY, backend

THETA = {
    "density": 1.2,
    "E": 3.0,
    "nu": 0.35,
    "alpha": 0.9,
    "skempton": 0.8,
    "kappa": 0.5,
    "viscosity": 1.0,
    "one": 1.0,
}
SECOND_ORDER = Newmark(0.25, 0.5, "newmark")


@dataclass(frozen=True)
class Sines:
    """Π_j sin(w_j x_j + s_j): value, gradient and Hessian."""

    waves: np.ndarray
    shifts: np.ndarray

    def _product(self, points, axes):
        angle = points * self.waves + self.shifts
        factors = np.sin(angle)
        for axis in axes:
            quarter = np.pi / 2 * axes.count(axis)
            factors[:, axis] = self.waves[axis] ** axes.count(axis) * np.sin(angle[:, axis] + quarter)
        return factors.prod(axis=1)

    def value(self, points):
        return self._product(points, [])

    def gradient(self, points):
        return np.stack([self._product(points, [i]) for i in range(points.shape[1])], axis=1)

    def hessian(self, points):
        axes = range(points.shape[1])
        return np.stack([np.stack([self._product(points, [i, j]) for j in axes], axis=1) for i in axes], axis=1)


@dataclass(frozen=True)
class Linear:
    """c + g·x."""

    constant: float
    slope: np.ndarray

    def value(self, points):
        return self.constant + points @ self.slope

    def gradient(self, points):
        return np.broadcast_to(self.slope, points.shape)

    def hessian(self, points):
        return np.zeros((len(points), points.shape[1], points.shape[1]))


def wavy(dim):
    rng = np.random.default_rng(3)
    return [Sines(rng.uniform(0.5, 2, dim), rng.uniform(0, 3, dim)) for _ in range(dim + 1)]


def straight(dim):
    rng = np.random.default_rng(3)
    return [Linear(rng.uniform(-1, 1), rng.uniform(-1, 1, dim)) for _ in range(dim + 1)]


def interpolate(space, shapes):
    """Nodal values (n_dofs, 2) of (U, 0) and (0, P)."""
    mesh, layout = space.discretization.mesh, space.layout
    out = np.zeros((layout.n_dofs, 2))
    nodes = mesh.nodes(layout.field("u").order)
    for axis in range(mesh.dim):
        out[layout.component("u", axis), 0] = shapes[axis].value(nodes)
    out[layout.block("p"), 1] = shapes[-1].value(mesh.points)
    return out


def manufactured(mesh, order, shapes, a, b, name=READY[0]):
    """Affine model whose solution is a(t) U, b(t) P; a and b are sequences of (f, f', f'')."""
    d = mesh.dim
    discretization = backend(name).discretize(mesh, biot_fields(d, order))
    space, terms = FiniteElementSpace(discretization), biot_terms(discretization)
    layout, nodes = discretization.layout, mesh.nodes(order)
    *U, P = shapes
    shear, lame, mobility = material.shear(THETA), material.lame(THETA), material.mobility(THETA)
    mass_u, mass_p = discretization.scalar_mass("u"), discretization.scalar_mass("p")
    gradients = np.stack([f.gradient(nodes) for f in U], axis=1)
    hessians = np.stack([f.hessian(nodes) for f in U], axis=1)
    divergence = np.einsum("nii->n", gradients)
    stress = shear * (gradients + gradients.transpose(0, 2, 1)) + lame * divergence[:, None, None] * np.eye(d)
    body = shear * np.einsum("nijj->ni", hessians) + (shear + lame) * np.einsum("njij->ni", hessians)
    forces = {name: np.zeros(layout.n_dofs) for name in ("a", "da", "dda", "b", "db")}
    for i in range(d):
        rows = layout.component("u", i)
        forces["a"][rows] = -mass_u @ body[:, i]
        forces["dda"][rows] = material.density(THETA) * (mass_u @ U[i].value(nodes))
        forces["b"][rows] = material.alpha(THETA) * (mass_u @ P.gradient(nodes)[:, i])
        for axis in range(d):
            for side in (0, 1):
                if (axis, side) != (0, 0):
                    surface = discretization.scalar_boundary_mass("u", f"{'xyz'[axis]}{'-+'[side]}")
                    forces["a"][rows] += surface @ ((2 * side - 1) * stress[:, i, axis])
    p, points = layout.block("p"), mesh.points
    forces["db"][p] = material.storage(THETA) * (mass_p @ P.value(points))
    volume = sum(f.gradient(points)[:, i] for i, f in enumerate(U))
    forces["da"][p] = material.alpha(THETA) * (mass_p @ volume)
    inflow = discretization.scalar_boundary_mass("p", "x-") @ -P.gradient(points)[:, 0]
    forces["b"][p] = mobility * (inflow - mass_p @ np.einsum("nii->n", P.hessian(points)))
    constrained = np.zeros(layout.n_dofs, dtype=bool)
    for i in range(d):
        constrained[layout.component("u", i).start + mesh.boundary_nodes("x-", order)] = True
    for side in set(mesh.roles) - {"x-"}:
        constrained[p.start + mesh.boundary_nodes(side)] = True
    prescribed = interpolate(space, shapes) * constrained[:, None]
    none = np.zeros(layout.n_dofs)
    one = itemgetter("one")
    loads = (
        Load("a", one, a[0], forces["a"], prescribed[:, 0]),
        Load("da", one, a[1], forces["da"], none),
        Load("dda", one, a[2], forces["dda"], none),
        Load("b", one, b[0], forces["b"], prescribed[:, 1]),
        Load("db", one, b[1], forces["db"], none),
    )
    groups = (terms.second_order, terms.first_order, terms.zeroth_order)
    parameters = ParameterSpace(tuple(Parameter(name, "1", value, value) for name, value in THETA.items()))
    return AffineModel(space, parameters, *groups, loads, constrained, terms.flow)


def march(model, scheme, shapes, a, b, duration, steps, graded=0, lag=0.0):
    """Final state from a consistent smooth start, whose rates a scheme is told (`lag` = 0) or not (infinite)."""
    zero = np.zeros(1)
    exact = interpolate(model.space, shapes)
    start = State(*(exact @ np.array([[a[k](zero)[0]], [b[k](zero)[0]]]) for k in range(3)))
    start = replace(consistent_start(model, THETA, start), lag=lag)
    marched = MarchedModel(model, TimeGrid(duration, 1, 0, steps, graded), scheme, tolerance=1e-11)
    return marched.march(THETA, start).states[:, -1]


def norms(model, state, shapes, factors):
    """L² errors and H¹ seminorm errors of u and p, sampled inside every cell."""
    cells, layout = model.space.cells(), model.space.layout
    dim = cells.points.shape[1]
    inside = np.random.default_rng(5).dirichlet(np.full(dim + 1, 2.0), 8)
    points = np.einsum("qk,ckd->cqd", inside, cells.points[cells.cells]).reshape(-1, dim)
    gradients, volumes = barycentric_gradients(cells.points, cells.cells)
    volumes = np.repeat(volumes, len(inside)) / len(inside)
    errors = {}
    for field, functions, factor in (("u", shapes[:-1], factors[0]), ("p", shapes[-1:], factors[1])):
        order, values, slopes = cells.orders[field], 0.0, 0.0
        for component, function in enumerate(functions):
            local = state[layout.component(field, component)][cells.nodes[field]]
            value = np.einsum("ql,cl->cq", lagrange(order, inside), local).ravel()
            slope = np.einsum("qlk,ckd,cl->cqd", lagrange_gradient(order, inside), gradients, local, optimize=True)
            values += (value - factor * function.value(points)) ** 2 @ volumes
            slopes += ((slope.reshape(-1, dim) - factor * function.gradient(points)) ** 2).sum(axis=1) @ volumes
        errors[field], errors["grad " + field] = np.sqrt(values), np.sqrt(slopes)
    return errors


def box(divisions):
    """The unit box with a role for each side."""
    ends = ((0.0,) * len(divisions), (1.0,) * len(divisions))
    return Box(*ends, divisions, {side: (side,) for side in Box(*ends, divisions).sides}).mesh()


def family(polynomial):
    return polynomial, polynomial.deriv(), polynomial.deriv(2)


SPACES = {
    "2-D P1–P1": (2, 1, (8, 16, 32), {"u": 2, "grad u": 1, "p": 2, "grad p": 1}),
    "2-D P2–P1": (2, 2, (4, 8, 16), {"u": 2, "grad u": 2, "p": 2, "grad p": 1}),
    "3-D P1–P1": (3, 1, (4, 8, 12), {"u": 2, "grad u": 1, "p": 2, "grad p": 1}),
    "3-D P2–P1": (3, 2, (3, 6), {"u": 2, "grad u": 2, "p": 2, "grad p": 1}),
}


def errors_in_space(name, dim, order, sizes):
    """Quadratic a and b are exact in time for β = 1/4, γ = 1/2, so that two steps leave the error in space."""
    a, b, shapes = family(Polynomial([1.0, 0.5, 0.7])), family(Polynomial([1.0, -0.8, 0.9])), wavy(dim)
    errors = []
    for size in sizes:
        model = manufactured(box((size,) * dim), order, shapes, a, b, name)
        state = march(model, SECOND_ORDER, shapes, a, b, 0.5, 2)
        errors.append(norms(model, state, shapes, (a[0](0.5), b[0](0.5))))
    return errors


@pytest.mark.parametrize("case", SPACES)
@pytest.mark.parametrize("name", READY)
def test_rates_in_space(name, case):
    """In P2–P1 the pressure's own error, of order 2, limits u in L² too; its gradient gains an order."""
    dim, order, sizes, expected = SPACES[case]
    errors = errors_in_space(name, dim, order, sizes)
    for quantity, rate in expected.items():
        seen = np.diff(np.log([e[quantity] for e in errors])) / -np.diff(np.log(sizes))
        assert seen[-1] > rate - 0.15, f"{quantity}: rates {seen}, errors {[e[quantity] for e in errors]}"


SCHEMES = [
    (SECOND_ORDER, 2),
    (Newmark(0.5, 1.0, "backward_euler"), 1),
    (Newmark(0.5, 1.0, "newmark"), 1),
    (Newmark(0.25, 0.5, "backward_euler"), 1),
    (Newmark(0.3025, 0.6, "newmark"), 1),
    (GeneralizedAlpha(0.0), 2),
    (GeneralizedAlpha(0.5), 2),
    (GeneralizedAlpha(1.0), 2),
]


@pytest.mark.parametrize(("scheme", "order"), SCHEMES, ids=lambda each: getattr(each, "label", None))
@pytest.mark.parametrize("graded", [0, 5])
def test_rates_in_time(scheme, order, graded):
    check_rates_in_time(scheme, order, graded)


@pytest.mark.parametrize("rho", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("graded", [0, 5])
def test_rates_in_time_when_the_first_step_is_backward_euler(rho, graded):
    """One step of first order leaves the second order of the whole."""
    check_rates_in_time(GeneralizedAlpha(rho), 2, graded, lag=np.inf)


def check_rates_in_time(scheme, order, graded, lag=0.0):
    counts, errors = errors_in_time(scheme, graded, lag)
    for field, seen in errors.items():
        rates = np.diff(np.log(seen)) / -np.diff(np.log(counts))
        assert abs(rates[-1] - order) < 0.15, f"{field}: rates {rates}, errors {seen}"


def errors_in_time(scheme, graded=0, lag=0.0):
    """Numbers of steps, and errors of u and p at the nodes; linear U and P are exact in space."""
    a = (lambda t: np.sin(3 * t), lambda t: 3 * np.cos(3 * t), lambda t: -9 * np.sin(3 * t))
    b = (lambda t: np.cos(2 * t), lambda t: -2 * np.sin(2 * t), lambda t: -4 * np.cos(2 * t))
    shapes = straight(2)
    model = manufactured(box((3, 3)), 1, shapes, a, b)
    exact = interpolate(model.space, shapes) @ np.array([a[0](1.0), b[0](1.0)])
    counts = np.array([128, 256, 512])
    states = [march(model, scheme, shapes, a, b, 1.0, n, graded, lag) for n in counts]
    differences = np.stack(states, axis=1) - exact[:, None]
    blocks = {field: model.space.layout.block(field) for field in ("u", "p")}
    return counts, {field: np.linalg.norm(differences[rows], axis=0) for field, rows in blocks.items()}
