"""What forms satisfy on any mesh: symmetry, kernels, sums, Green's identity, integrals of polynomials."""

from functools import cached_property
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.testing.backends.stand import ORDERS, PAIRS, Stand
from dacore.testing.polynomials import Polynomial, box_faces, box_rule
from dacore.testing.suite import fail, require


def symmetric_and_positive(stand: Stand) -> None:
    """Mass, stiffness, strain and divergence are symmetric with no negative eigenvalue; the mass is positive."""
    disc = stand.discretization
    for k in ORDERS:
        forms = {"mass": disc.scalar_mass(f"p{k}"), "stiffness": disc.scalar_stiffness(f"p{k}")}
        forms |= {"strain": disc.strain(f"u{k}"), "divergence": disc.divergence(f"u{k}")}
        forms |= {f"boundary_mass over {role!r}": disc.scalar_boundary_mass(f"p{k}", role) for role in stand.mesh.roles}
        for name, form in forms.items():
            matrix, where = form.toarray(), stand.where(name, f"P{k}")
            size = np.abs(matrix).max()
            gap = np.abs(matrix - matrix.T).max() / size
            require(gap < 1e-12, f"{where}: unsymmetric by {gap:.1e} of its largest entry, expected rounding")
            low = np.linalg.eigvalsh(matrix)[0] / size
            require(low > -1e-12, f"{where}: has the eigenvalue {low:.2g} of its largest entry, expected none below 0")
            require(name != "mass" or low > 1e-8, f"{where}: is singular (eigenvalue {low:.2g}), expected positive")


def kernels(stand: Stand) -> None:
    """Constants and nothing else have no stiffness; rigid motions and nothing else have no strain."""
    dim, disc = stand.dim, stand.discretization
    for k in ORDERS:
        x = stand.mesh.nodes(k)
        rigid = list(np.kron(np.eye(dim), np.ones(len(x))))
        for i in range(dim):
            for j in range(i):
                spin = np.zeros((dim, len(x)))
                spin[i], spin[j] = x[:, j], -x[:, i]
                rigid.append(spin.ravel())
        ones = [np.ones(len(x))]
        for name, form, kernel, what in (
            ("stiffness", disc.scalar_stiffness(f"p{k}"), ones, "the constant"),
            ("strain", disc.strain(f"u{k}"), rigid, "a rigid motion"),
        ):
            where, matrix = stand.where(name, f"P{k}"), form.toarray()
            size = np.abs(matrix).max()
            require(size > 0, f"{where}: is zero everywhere")
            left = max(np.abs(matrix @ one).max() for one in kernel) / size
            require(left < 1e-11, f"{where}: {what} gives {left:.1e} of its largest entry, expected zero")
            found = int((np.linalg.eigvalsh(matrix) < 1e-9 * size).sum())
            require(found == len(kernel), f"{where}: its kernel has dimension {found}, expected {len(kernel)}")
        left = np.abs(disc.divergence(f"u{k}") @ np.array(rigid).T).max() / abs(disc.divergence(f"u{k}")).max()
        require(left < 1e-11, f"{stand.where('divergence', f'P{k}')}: a rigid motion gives {left:.1e}, expected zero")


def sums(stand: Stand) -> None:
    """Basis functions sum to one: masses sum to the volume and to the surface of each role, normals to zero."""
    disc, mesh = stand.discretization, stand.mesh
    volume = float(mesh.volumes.sum())
    for k in ORDERS:
        _close(disc.scalar_mass(f"p{k}").sum(), volume, f"{stand.where('mass', f'P{k}')}: sums to", "the volume")
        total = np.zeros(stand.dim)
        for role in mesh.roles:
            area = float(stand.reference.surface(role).weights.sum())
            where = stand.where(f"boundary_mass over {role!r}", f"P{k}")
            _close(disc.scalar_boundary_mass(f"p{k}", role).sum(), area, f"{where}: sums to", "the surface of the role")
            flux = disc.boundary_coupling(f"p{k}", f"u{k}", role)
            total += flux.sum(axis=1).reshape(stand.dim, -1).sum(axis=1)
        gap = float(np.abs(total).max())
        where = stand.where("boundary_coupling over the whole boundary", f"vector P{k}, scalar P{k}")
        require(gap < 1e-12, f"{where}: the normals sum to {gap:.1e}, expected zero; is one facet turned round?")


def green(stand: Stand) -> None:
    """∫ ∇p·v + ∫ p ∇·v = ∫ p v·n over the whole boundary, for every pair of orders."""
    disc = stand.discretization
    for v, s in PAIRS:
        u, p = f"u{v}", f"p{s}"
        volume = (disc.gradient_coupling(p, u) + disc.divergence_coupling(u, p).T).toarray()
        surface = np.sum([disc.boundary_coupling(p, u, role).toarray() for role in stand.mesh.roles], axis=0)
        gap = np.abs(volume - surface).max() / np.abs(surface).max()
        cause = "; likely cause: normals point inwards" if np.abs(volume + surface).max() < 1e-10 else ""
        require(
            gap < 1e-11,
            f"{stand.where('gradient_coupling + divergence_couplingᵀ', f'vector P{v}, scalar P{s}')}: differs from "
            f"boundary_coupling over all roles by {gap:.1e} of its largest entry, expected rounding{cause}",
        )


class _Fields:
    """Random polynomials that the elements of two orders hold, on the unit box."""

    def __init__(self, stand: Stand, vector: int, scalar: int) -> None:
        rng = np.random.default_rng(10 * vector + scalar)
        dim, mesh = stand.dim, stand.mesh
        self.u, self.v = ([Polynomial(rng, dim, vector) for _ in range(dim)] for _ in range(2))
        self.p, self.q = (Polynomial(rng, dim, scalar) for _ in range(2))
        nodes = mesh.nodes(vector)
        self.U, self.V = (np.concatenate([c(nodes) for c in field]) for field in (self.u, self.v))
        self.P, self.Q = self.p(mesh.nodes(scalar)), self.q(mesh.nodes(scalar))
        self.x, self.w = box_rule(dim)

    @cached_property
    def jacobians(self) -> tuple[Array, Array]:
        """∂_j u_i and ∂_j v_i (points, i, j)."""
        first, second = (np.stack([c.gradient(self.x) for c in field], axis=1) for field in (self.u, self.v))
        return first, second


def integrals_of_scalar_polynomials(stand: Stand) -> None:
    """∫ pq and ∫ ∇p·∇q of polynomials the elements hold are those computed without a mesh."""
    for k in ORDERS:
        f = _Fields(stand, k, k)
        mass = f.Q @ stand.discretization.scalar_mass(f"p{k}") @ f.P
        _close(mass, f.w @ (f.p(f.x) * f.q(f.x)), f"{stand.where('mass', f'P{k}')}: qᵀMp is", "∫ p q")
        inner = np.einsum("qd,qd->q", f.p.gradient(f.x), f.q.gradient(f.x))
        stiff = f.Q @ stand.discretization.scalar_stiffness(f"p{k}") @ f.P
        _close(stiff, f.w @ inner, f"{stand.where('stiffness', f'P{k}')}: qᵀKp is", "∫ ∇p·∇q")


def integrals_of_vector_polynomials(stand: Stand) -> None:
    """∫ ε(u):ε(v) and ∫ (∇·u)(∇·v) of polynomials the elements hold are those computed without a mesh."""
    for k in ORDERS:
        f = _Fields(stand, k, k)
        left, right = ((g + np.swapaxes(g, 1, 2)) / 2 for g in f.jacobians)
        strain = f.V @ stand.discretization.strain(f"u{k}") @ f.U
        want = f.w @ np.einsum("qij,qij->q", left, right)
        _close(strain, want, f"{stand.where('strain', f'P{k}')}: vᵀEu is", "∫ ε(u):ε(v)")
        divergence = f.V @ stand.discretization.divergence(f"u{k}") @ f.U
        traces = [np.trace(g, axis1=1, axis2=2) for g in f.jacobians]
        want = f.w @ (traces[0] * traces[1])
        _close(divergence, want, f"{stand.where('divergence', f'P{k}')}: vᵀDu is", "∫ ∇·u ∇·v")


def integrals_between_fields(stand: Stand) -> None:
    """∫ ∇p·v and ∫ q ∇·u of polynomials the elements hold are those computed without a mesh."""
    for v, s in PAIRS:
        f, orders = _Fields(stand, v, s), f"vector P{v}, scalar P{s}"
        test = np.stack([c(f.x) for c in f.v], axis=1)
        want = f.w @ np.einsum("qd,qd->q", f.p.gradient(f.x), test)
        given = f.V @ stand.discretization.gradient_coupling(f"p{s}", f"u{v}") @ f.P
        _close(given, want, f"{stand.where('gradient_coupling', orders)}: vᵀGp is", "∫ ∇p·v")
        want = f.w @ (f.q(f.x) * np.trace(f.jacobians[0], axis1=1, axis2=2))
        given = f.Q @ stand.discretization.divergence_coupling(f"u{v}", f"p{s}") @ f.U
        _close(given, want, f"{stand.where('divergence_coupling', orders)}: qᵀBu is", "∫ q ∇·u")


def integrals_over_boundaries(stand: Stand) -> None:
    """∫ pq and ∫ p v·n over each role, of polynomials the elements hold, are those computed without a mesh."""
    for v, s in PAIRS:
        f, orders = _Fields(stand, v, s), f"vector P{v}, scalar P{s}"
        for role in stand.mesh.roles:
            mass = flux = 0.0
            for x, w, normal in box_faces(stand.dim, role):
                mass += float(w @ (f.p(x) * f.q(x)))
                flux += float(w @ (f.p(x) * (np.stack([c(x) for c in f.v], axis=1) @ normal)))
            given = f.Q @ stand.discretization.scalar_boundary_mass(f"p{s}", role) @ f.P
            _close(given, mass, f"{stand.where(f'boundary_mass over {role!r}', f'P{s}')}: qᵀMp is", "∫ p q")
            given = f.V @ stand.discretization.boundary_coupling(f"p{s}", f"u{v}", role) @ f.P
            _close(given, flux, f"{stand.where(f'boundary_coupling over {role!r}', orders)}: vᵀNp is", "∫ p v·n")


GENERAL = (symmetric_and_positive, kernels, sums, green)
ON_A_BOX = (
    integrals_of_scalar_polynomials,
    integrals_of_vector_polynomials,
    integrals_between_fields,
    integrals_over_boundaries,
)


def _close(given: Any, expected: Any, what: str, of: str) -> None:
    __tracebackhide__ = True
    gap = abs(given - expected)
    if gap <= 1e-11 * max(1.0, abs(expected)):
        return
    cause = "; likely cause: the sign is wrong" if abs(given + expected) <= 1e-9 * max(1.0, abs(expected)) else ""
    fail(f"{what} {given:.10g}, expected {of} = {expected:.10g} (difference {gap:.2g}){cause}")
