"""Errors fall at the rates theory promises, for approximation and for solving."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from dacore.core.fields import Field
from dacore.testing.meshes import shuffled_box
from dacore_skfem.backend import SkfemBackend

MESHES = {2: (6, 12, 24), 3: (3, 6, 12)}


def exact(x):
    return np.prod(np.sin(2.0 * x + 0.3), axis=1)


def slope(x):
    return 2.0 * np.cos(2.0 * x[:, 0] + 0.3) * np.prod(np.sin(2.0 * x[:, 1:] + 0.3), axis=1)


def rate(errors):
    """Order of convergence on the last halving of the mesh size."""
    return np.log2(errors[-2] / errors[-1])


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_interpolation(dim, order):
    x = np.random.default_rng(0).uniform(size=(2000, dim))
    values, slopes = [], []
    for n in MESHES[dim]:
        mesh = shuffled_box(dim, n=n)
        disc = SkfemBackend().discretize(mesh, [Field("p", 1, order)])
        nodal = exact(mesh.nodes(order))
        values.append(rms(disc.evaluation(x, "p") @ nodal - exact(x)))
        slopes.append(rms(disc.evaluation(x, "p", 0) @ nodal - slope(x)))
    assert rate(values) == pytest.approx(order + 1, abs=0.2)
    assert rate(slopes) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), pytest.param(3, 2, marks=pytest.mark.slow)])
def test_poisson_with_held_and_free_boundary(dim, order):
    """−Δp = f, p given on "left" and "side", its normal derivative on "right"."""
    x = np.random.default_rng(0).uniform(size=(2000, dim))
    errors = []
    for n in MESHES[dim]:
        mesh = shuffled_box(dim, n=n)
        disc = SkfemBackend().discretize(mesh, [Field("p", 1, order)])
        nodes = mesh.nodes(order)
        load = disc.scalar_mass("p") @ (4.0 * dim * exact(nodes))
        load += disc.scalar_boundary_mass("p", "right") @ slope(nodes)
        stiffness = disc.scalar_stiffness("p")
        held = np.union1d(mesh.boundary_nodes("left", order), mesh.boundary_nodes("side", order))
        free = np.setdiff1d(np.arange(len(nodes)), held)
        p = exact(nodes)
        p[free] = spsolve(stiffness[free][:, free].tocsc(), load[free] - stiffness[free][:, held] @ p[held])
        errors.append(rms(disc.evaluation(x, "p") @ p - exact(x)))
    assert rate(errors) == pytest.approx(order + 1, abs=0.25)


@pytest.mark.parametrize("order", [1, 2])
def test_elasticity_with_tractions(order):
    """2μ ε + λ div I with all tractions given but on "left": the weak form a model builds of these blocks."""
    mu, lam = 1.3, 0.7
    x = np.random.default_rng(0).uniform(size=(2000, 2))

    # u = (sin x cos y, x² y)
    def u(z):
        return np.stack([np.sin(z[:, 0]) * np.cos(z[:, 1]), z[:, 0] ** 2 * z[:, 1]])

    def stress(z):
        a, b = z.T
        ux, uy, vx, vy = np.cos(a) * np.cos(b), -np.sin(a) * np.sin(b), 2 * a * b, a**2
        return 2 * mu * ux + lam * (ux + vy), mu * (uy + vx), 2 * mu * vy + lam * (ux + vy)

    def force(z):
        a, b = z.T
        uxx, uyy, uxy = -np.sin(a) * np.cos(b), -np.sin(a) * np.cos(b), -np.cos(a) * np.sin(b)
        vxx, vyy, vxy = 2 * b, np.zeros_like(a), 2 * a
        return -np.stack(
            [
                2 * mu * uxx + mu * (uyy + vxy) + lam * (uxx + vxy),
                mu * (uxy + vxx) + 2 * mu * vyy + lam * (uxy + vyy),
            ]
        )

    errors = []
    for n in MESHES[2]:
        mesh = shuffled_box(2, n=n)
        disc = SkfemBackend().discretize(mesh, [Field("u", 2, order), Field("p", 1, order)])
        nodes = mesh.nodes(order)
        matrix = (2 * mu * disc.strain("u") + lam * disc.divergence("u")).tocsr()
        mass = disc.scalar_mass("u")
        load = np.concatenate([mass @ component for component in force(nodes)])
        # σn through ∫ p v·n: row c of the stress, one component of the normal at a time.
        xx, xy, yy = stress(nodes)
        size = len(nodes)
        for role in ("right", "side"):
            normal = disc.boundary_coupling("p", "u", role)
            load[:size] += normal[:size] @ xx + normal[size:] @ xy
            load[size:] += normal[:size] @ xy + normal[size:] @ yy
        held = np.concatenate([c * size + mesh.boundary_nodes("left", order) for c in range(2)])
        free = np.setdiff1d(np.arange(2 * size), held)
        state = u(nodes).ravel()
        state[free] = spsolve(matrix[free][:, free].tocsc(), load[free] - matrix[free][:, held] @ state[held])
        at = disc.evaluation(x, "u")
        errors.append(rms(np.stack([at @ state[:size], at @ state[size:]]) - u(x)))
    assert rate(errors) == pytest.approx(order + 1, abs=0.3)
