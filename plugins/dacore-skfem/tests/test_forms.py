"""Every form against integrals of polynomials computed without any mesh."""

from itertools import product

import numpy as np
import pytest

from dacore.core.fields import Field
from dacore_skfem.backend import SkfemBackend

CASES = [(dim, order_u, order_p) for dim in (2, 3) for order_u in (1, 2) for order_p in (1, 2)]


class Polynomial:
    """A random polynomial of given degree, with its gradient."""

    def __init__(self, rng, dim, degree):
        self.powers = np.array([e for e in product(range(degree + 1), repeat=dim) if sum(e) <= degree])
        self.factors = rng.normal(size=len(self.powers))

    def __call__(self, x):
        return np.prod(x[..., None, :] ** self.powers, axis=-1) @ self.factors

    def gradient(self, x):
        parts = []
        for axis in range(x.shape[-1]):
            lowered = self.powers.copy()
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            parts.append(np.prod(x[..., None, :] ** lowered, axis=-1) @ (self.factors * self.powers[:, axis]))
        return np.stack(parts, axis=-1)


def gauss(dim):
    """Points (q, dim) and weights (q,) on the unit box, exact to degree 7 in each coordinate."""
    x, w = np.polynomial.legendre.leggauss(4)
    points = np.array(list(product((x + 1) / 2, repeat=dim))).reshape(-1, dim)
    return points, np.prod(np.array(list(product(w / 2, repeat=dim))).reshape(-1, dim), axis=1)


def faces(dim, role):
    """Gauss points, weights and outward normal of each face of the unit box with `role`."""
    x, w = gauss(dim - 1)
    for axis, end in product(range(dim), (0, 1)):
        name = ("left", "right")[end] if axis == 0 else "side"
        if name == role:
            yield np.insert(x, axis, end, axis=1), w, np.where(np.arange(dim) == axis, 2 * end - 1, 0)


class Case:
    """A discretised box and random polynomials that its elements hold exactly."""

    def __init__(self, mesh, order_u, order_p, seed=0):
        rng = np.random.default_rng(seed)
        dim = mesh.dim
        self.mesh = mesh
        self.disc = SkfemBackend().discretize(mesh, [Field("u", dim, order_u), Field("p", 1, order_p)])
        self.u, self.v = ([Polynomial(rng, dim, order_u) for _ in range(dim)] for _ in range(2))
        self.p, self.q = (Polynomial(rng, dim, order_p) for _ in range(2))
        nodes_u, nodes_p = mesh.nodes(order_u), mesh.nodes(order_p)
        self.U, self.V = (np.concatenate([c(nodes_u) for c in field]) for field in (self.u, self.v))
        self.P, self.Q = self.p(nodes_p), self.q(nodes_p)
        self.x, self.w = gauss(dim)

    def grads(self, field):
        """Jacobians (q, component, axis) at the Gauss points."""
        return np.stack([c.gradient(self.x) for c in field], axis=1)


@pytest.fixture(params=CASES, ids=lambda c: f"{c[0]}d-P{c[1]}-P{c[2]}")
def case(request, shuffled_box):
    dim, order_u, order_p = request.param
    return Case(shuffled_box(dim, n=2 if dim == 3 else 3, seed=sum(request.param)), order_u, order_p)


def agree(given, expected):
    np.testing.assert_allclose(given, expected, rtol=1e-11, atol=1e-11)


def test_mass_and_stiffness(case):
    agree(case.Q @ case.disc.scalar_mass("p") @ case.P, case.w @ (case.p(case.x) * case.q(case.x)))
    inner = np.einsum("qd,qd->q", case.p.gradient(case.x), case.q.gradient(case.x))
    agree(case.Q @ case.disc.scalar_stiffness("p") @ case.P, case.w @ inner)


def test_strain(case):
    eps_u, eps_v = ((g + np.swapaxes(g, 1, 2)) / 2 for g in (case.grads(case.u), case.grads(case.v)))
    agree(case.V @ case.disc.strain("u") @ case.U, case.w @ np.einsum("qij,qij->q", eps_u, eps_v))


def test_divergence(case):
    div_u, div_v = (np.trace(case.grads(f), axis1=1, axis2=2) for f in (case.u, case.v))
    agree(case.V @ case.disc.divergence("u") @ case.U, case.w @ (div_u * div_v))


def test_couplings(case):
    v = np.stack([c(case.x) for c in case.v], axis=1)
    agree(
        case.V @ case.disc.gradient_coupling("p", "u") @ case.P,
        case.w @ np.einsum("qd,qd->q", case.p.gradient(case.x), v),
    )
    div_u = np.trace(case.grads(case.u), axis1=1, axis2=2)
    agree(case.Q @ case.disc.divergence_coupling("u", "p") @ case.U, case.w @ (case.q(case.x) * div_u))


@pytest.mark.parametrize("role", ["left", "right", "side"])
def test_boundary_forms(case, role):
    mass = flux = 0.0
    for x, w, normal in faces(case.mesh.dim, role):
        mass += w @ (case.p(x) * case.q(x))
        flux += w @ (case.p(x) * (np.stack([c(x) for c in case.v], axis=1) @ normal))
    agree(case.Q @ case.disc.scalar_boundary_mass("p", role) @ case.P, mass)
    agree(case.V @ case.disc.boundary_coupling("p", "u", role) @ case.P, flux)


@pytest.mark.parametrize(("dim", "order_u", "order_p"), CASES)
def test_green_identity_holds_on_a_bumpy_boundary(shuffled_box, dim, order_u, order_p):
    case = Case(shuffled_box(dim, n=2, seed=5, bumpy=True), order_u, order_p)
    volume = case.disc.gradient_coupling("p", "u") + case.disc.divergence_coupling("u", "p").T
    surface = sum(case.disc.boundary_coupling("p", "u", role) for role in case.mesh.roles)
    assert abs(surface).max() > 1e-3
    assert abs(volume - surface).max() < 1e-14


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_forms_are_symmetric_with_the_right_kernels(shuffled_box, dim, order):
    mesh = shuffled_box(dim, n=2, seed=1, bumpy=True)
    disc = SkfemBackend().discretize(mesh, [Field("u", dim, order)])
    strain, divergence = disc.strain("u").toarray(), disc.divergence("u").toarray()
    x = mesh.nodes(order)
    for matrix in (disc.scalar_mass("u").toarray(), disc.scalar_stiffness("u").toarray(), strain, divergence):
        assert abs(matrix - matrix.T).max() < 1e-13
        assert np.linalg.eigvalsh(matrix).min() > -1e-13
    # Basis functions sum to one: mass gives the volume, derivatives vanish.
    assert disc.scalar_mass("u").sum() == pytest.approx(mesh.volumes.sum(), rel=1e-13)
    assert abs(disc.scalar_stiffness("u").sum(axis=1)).max() < 1e-13
    rigid = list(np.kron(np.eye(dim), np.ones(len(x))))
    for i in range(dim):
        for j in range(i):
            spin = np.zeros((dim, len(x)))
            spin[i], spin[j] = x[:, j], -x[:, i]
            rigid.append(spin.ravel())
    for motion in rigid:
        assert abs(strain @ motion).max() < 1e-12
        assert abs(divergence @ motion).max() < 1e-12
    # Nothing else is in the kernel of the strain.
    assert (np.linalg.eigvalsh(strain) < 1e-10).sum() == len(rigid)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_agrees_with_vector_elements_of_scikit_fem(shuffled_box, dim, order):
    import skfem
    from skfem.helpers import ddot, div, sym_grad

    mesh = shuffled_box(dim, n=2, seed=2, bumpy=True)
    disc = SkfemBackend().discretize(mesh, [Field("u", dim, order)])
    kind = {2: "Tri", 3: "Tet"}[dim]
    element = skfem.ElementVector(getattr(skfem, f"Element{kind}P{order}")())
    basis = skfem.Basis(getattr(skfem, f"Mesh{kind}")(mesh.points.T.copy(), mesh.cells.T.copy()), element, intorder=4)
    # Vector element dofs are found again by place and component: scikit-fem numbers them in its own way.
    place = np.round(mesh.nodes(order), 9)
    node = {tuple(x): k for k, x in enumerate(place.tolist())}
    number = np.empty(basis.N, dtype=int)
    for local in range(basis.Nbfun):
        for dof in basis.element_dofs[local]:
            number[dof] = local % dim * len(place) + node[tuple(np.round(basis.doflocs[:, dof], 9).tolist())]
    for form, ours in [
        (lambda u, v, w: ddot(sym_grad(u), sym_grad(v)), disc.strain("u")),
        (lambda u, v, w: div(u) * div(v), disc.divergence("u")),
    ]:
        theirs = skfem.BilinearForm(form).assemble(basis).toarray()
        assert abs(ours[number][:, number].toarray() - theirs).max() < 1e-13
