"""Every entry of every form is that of an independent computation."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from dacore.core.arrays import Array
from dacore.testing.backends.stand import ORDERS, PAIRS, Stand
from dacore.testing.compare import Form, agree
from dacore.testing.reference import Expected

Mistakes = dict[str, Callable[[], Array]]


def mass(stand: Stand) -> None:
    """`mass` is ∫ a b, entry by entry, for both orders."""
    for k in ORDERS:
        side, want = stand.side(k), stand.reference.mass(k)
        form = Form(stand.where("mass", f"P{k}"), side, side)
        agree(partial(stand.discretization.scalar_mass, f"p{k}"), partial(_raw, stand, "mass", k), want, form)


def stiffness(stand: Stand) -> None:
    """`stiffness` is ∫ ∇a·∇b, entry by entry, for both orders."""
    for k in ORDERS:
        side, want = stand.side(k), stand.reference.stiffness(k)
        mistakes = {"it is the mass": _matrix(stand.reference.mass, k)}
        form = Form(stand.where("stiffness", f"P{k}"), side, side, mistakes)
        agree(
            partial(stand.discretization.scalar_stiffness, f"p{k}"),
            partial(_raw, stand, "stiffness", k),
            want,
            form,
        )


def strain(stand: Stand) -> None:
    """`strain` is ∫ ε(a):ε(b) with the symmetric gradient, entry by entry, for both orders."""
    for k in ORDERS:
        side, ref = stand.side(k, vector=True), stand.reference
        mistakes: Mistakes = {
            "it is ∫ ∇a:∇b, take the symmetric part of the gradient": _matrix(ref.gradient_product, k),
            "shear is that of engineering strains, ε_ij is half of it": partial(_double_shear, stand, k),
            "it is the divergence form": _matrix(ref.divergence, k),
        }
        form = Form(stand.where("strain", f"P{k}"), side, side, mistakes)
        agree(partial(stand.discretization.strain, f"u{k}"), partial(_raw, stand, "strain", k), ref.strain(k), form)


def divergence(stand: Stand) -> None:
    """`divergence` is ∫ (∇·a)(∇·b), entry by entry, for both orders."""
    for k in ORDERS:
        side, want = stand.side(k, vector=True), stand.reference.divergence(k)
        mistakes: Mistakes = {"it is the strain form": _matrix(stand.reference.strain, k)}
        mistakes |= _without_a_component(want.matrix, stand.dim, rows=True, columns=True)
        form = Form(stand.where("divergence", f"P{k}"), side, side, mistakes)
        agree(partial(stand.discretization.divergence, f"u{k}"), partial(_raw, stand, "divergence", k), want, form)


def gradient_coupling(stand: Stand) -> None:
    """`gradient_coupling` is ∫ ∇p·v with v the test function, entry by entry, for every pair of orders."""
    for v, s in PAIRS:
        want = stand.reference.gradient_coupling(s, v)
        other = _matrix(stand.reference.divergence_coupling, v, s)
        mistakes: Mistakes = {
            "it is ∫ p ∇·v, the derivative belongs on the scalar": partial(_turned, other, 1.0),
            "it is −∫ p ∇·v, integration by parts leaves a boundary term": partial(_turned, other, -1.0),
        }
        mistakes |= _without_a_component(want.matrix, stand.dim, rows=True)
        form = Form(_pair(stand, "gradient_coupling", v, s), stand.side(v, vector=True), stand.side(s), mistakes)
        agree(
            partial(stand.discretization.gradient_coupling, f"p{s}", f"u{v}"),
            partial(_raw, stand, "gradient_coupling", s, v),
            want,
            form,
        )


def divergence_coupling(stand: Stand) -> None:
    """`divergence_coupling` is ∫ q ∇·u with q the test function, entry by entry, for every pair of orders."""
    for v, s in PAIRS:
        want = stand.reference.divergence_coupling(v, s)
        other = _matrix(stand.reference.gradient_coupling, s, v)
        mistakes: Mistakes = {
            "it is ∫ ∇q·u, the derivative belongs on the vector": partial(_turned, other, 1.0),
            "it is −∫ ∇q·u, integration by parts leaves a boundary term": partial(_turned, other, -1.0),
        }
        mistakes |= _without_a_component(want.matrix, stand.dim, columns=True)
        form = Form(_pair(stand, "divergence_coupling", v, s), stand.side(s), stand.side(v, vector=True), mistakes)
        agree(
            partial(stand.discretization.divergence_coupling, f"u{v}", f"p{s}"),
            partial(_raw, stand, "divergence_coupling", v, s),
            want,
            form,
        )


def boundary_mass(stand: Stand) -> None:
    """`boundary_mass` is ∫ a b over the facets of one role, entry by entry, for both orders and every role."""
    for role in stand.mesh.roles:
        for k in ORDERS:
            side = stand.side(k)
            mistakes = _other_roles(stand, role, partial(stand.reference.boundary_mass, k))
            form = Form(stand.where(f"boundary_mass over {role!r}", f"P{k}"), side, side, mistakes)
            want = stand.reference.boundary_mass(k, role)
            agree(
                partial(stand.discretization.scalar_boundary_mass, f"p{k}", role),
                partial(_raw, stand, "boundary_mass", k, role),
                want,
                form,
            )


def boundary_coupling(stand: Stand) -> None:
    """`boundary_coupling` is ∫ p v·n over one role, n outward, entry by entry, for every pair of orders and role."""
    for role in stand.mesh.roles:
        for v, s in PAIRS:
            want = stand.reference.boundary_coupling(s, v, role)
            mistakes: Mistakes = {"the normal points inwards": partial(np.negative, want.matrix)}
            mistakes |= _other_roles(stand, role, partial(stand.reference.boundary_coupling, s, v))
            for k, facet in enumerate(stand.mesh.boundary_facets(role)):
                text = f"the normal of the facet {sorted(facet.tolist())} points inwards"
                mistakes[text] = partial(_turned_round, stand, want.matrix, (s, v, role, k))
            mistakes |= _without_a_component(want.matrix, stand.dim, rows=True)
            name = _pair(stand, f"boundary_coupling over {role!r}", v, s)
            form = Form(name, stand.side(v, vector=True), stand.side(s), mistakes)
            agree(
                partial(stand.discretization.boundary_coupling, f"p{s}", f"u{v}", role),
                partial(_raw, stand, "boundary_coupling", s, v, role),
                want,
                form,
            )


CHECKS = (
    mass, stiffness, strain, divergence, gradient_coupling, divergence_coupling, boundary_mass, boundary_coupling,
)  # fmt: skip


def _matrix(form: Callable[..., Expected], *orders: int) -> Callable[[], Array]:
    return lambda: form(*orders).matrix


def _turned(make: Callable[[], Array], sign: float) -> Array:
    return sign * make().T


def _turned_round(stand: Stand, whole: Array, facet: tuple[int, int, str, int]) -> Array:
    """A boundary coupling with the normal of one facet reversed."""
    return np.asarray(whole - 2.0 * stand.reference.boundary_coupling(*facet).matrix)


def _raw(stand: Stand, form: str, *arguments: int | str) -> Any:
    """A form as the assembler itself returns it."""
    return getattr(stand.assembler(), form)(*arguments)


def _pair(stand: Stand, form: str, vector: int, scalar: int) -> str:
    return stand.where(form, f"vector P{vector}, scalar P{scalar}")


def _double_shear(stand: Stand, order: int) -> Array:
    """The strain form with γ_ij = 2 ε_ij in place of ε_ij off the diagonal: 4 ε:ε − 3 Σ_i ε_ii(a) ε_ii(b)."""
    full, strain = (form(order).matrix for form in (stand.reference.gradient_product, stand.reference.strain))
    count = len(strain) // stand.dim
    normal = np.zeros_like(strain)
    for i in range(stand.dim):
        # Block (i, i) of the strain is ½ (Σ_m D_mm + D_ii), that of the full gradient Σ_m D_mm.
        block = slice(i * count, (i + 1) * count)
        normal[block, block] = 2.0 * strain[block, block] - full[block, block]
    return np.asarray(4.0 * strain - 3.0 * normal)


def _without_a_component(matrix: Array, dim: int, rows: bool = False, columns: bool = False) -> Mistakes:
    """Matrices in which one component of the vector is left out."""

    def without(axis: int) -> Array:
        out = matrix.copy()
        if rows:
            out.reshape(dim, -1, matrix.shape[1])[axis] = 0.0
        if columns:
            out.reshape(len(matrix), dim, -1)[:, axis] = 0.0
        return out

    return {f"component {axis} of the vector is missing": partial(without, axis) for axis in range(dim)}


def _other_roles(stand: Stand, role: str, form: Callable[[str], Expected]) -> Mistakes:
    """Matrices over another role, and over the whole boundary."""
    every = list(stand.mesh.roles)
    others: Mistakes = {
        f"it is over the role {other!r}": partial(lambda name: form(name).matrix, other)
        for other in every
        if other != role
    }
    others["it is over the whole boundary"] = lambda: np.sum([form(each).matrix for each in every], axis=0)
    return others
