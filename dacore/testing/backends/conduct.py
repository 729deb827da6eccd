"""How a backend behaves: what it keeps, shares, changes, prints, and what its results may depend on."""

import pickle
from collections.abc import Mapping
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.sparse import csr_array

from dacore.core.discretization import Assembler, Backend, Discretization
from dacore.core.mesh import Mesh
from dacore.testing.backends.stand import Stand, discretize, every_form, sample_points
from dacore.testing.meshes import shuffled_box, with_points
from dacore.testing.silence import written_by
from dacore.testing.suite import fail, require

FORMS = (
    "mass", "stiffness", "strain", "divergence", "gradient_coupling", "divergence_coupling", "boundary_mass",
    "boundary_coupling", "evaluation",
)  # fmt: skip
_POWERS = {
    "mass": 0, "stiffness": -2, "strain": -2, "divergence": -2, "gradient_coupling": -1, "divergence_coupling": -1,
    "boundary_mass": -1, "boundary_coupling": -1,
}  # fmt: skip


def canonical_matrices(stand: Stand) -> None:
    """Every form is a csr_array of float64 of the layout's shape, sorted, finite, with no entry twice."""
    disc = stand.discretization
    points = sample_points(stand.mesh, 5)
    forms = every_form(disc) | {"evaluation, P2": disc.evaluation(points, "p2")}
    for name, form in forms.items():
        where = f"backend {stand.backend.name}: {name}, on the {stand.name}"
        require(isinstance(form, csr_array), f"{where}: is a {type(form).__name__}, expected csr_array")
        require(form.dtype == np.float64, f"{where}: has type {form.dtype}, expected float64")
        ordered = csr_array((form.data, form.indices, form.indptr), shape=form.shape).has_canonical_format
        require(bool(ordered), f"{where}: its indices are not sorted or an entry is there twice")
        require(bool(np.isfinite(form.data).all()), f"{where}: holds NaN or infinite values")
        if "P1" in name or "P2" in name:
            require(form.shape == _shape(stand, name, len(points)), f"{where}: has shape {form.shape}")


def nothing_is_assembled_too_early(stand: Stand) -> None:
    """`discretize` calls no method of the backend but at the first question, and `assembler` assembles no form."""
    kept = type(stand.backend).discretize is Backend.discretize
    require(kept, f"backend {stand.backend.name}: overrides discretize, which is final; implement assembler alone")
    cls = type(stand.assembler())
    asked: list[str] = []
    spy = _spy(type(stand.backend).assembler, "assembler", asked)
    with patch.multiple(type(stand.backend), assembler=spy):
        stand.fresh()
    require(
        not asked, f"backend {stand.backend.name}: discretize puts the library on the mesh before a form is asked for"
    )
    spies = {name: _spy(getattr(cls, name), name, asked) for name in FORMS}
    with patch.multiple(cls, **spies):
        stand.assembler()
    require(
        not asked,
        f"backend {stand.backend.name}: assembler(mesh) assembles {', '.join(asked)} on being made; "
        "assemble a form when it is asked for",
    )


def forms_are_kept(stand: Stand) -> None:
    """A form is assembled once: asked for again, the same matrix comes back."""
    disc = stand.discretization
    for ask, field in ((disc.strain, "u2"), (disc.scalar_mass, "p1")):
        again = ask(field) is ask(field)
        require(again, f"backend {stand.backend.name}: {ask.__name__} is another matrix each time it is asked for")
    same = disc.scalar_mass("p2") is disc.scalar_mass("u2")
    require(same, f"backend {stand.backend.name}: fields of equal elements do not share their mass")


def forms_share_no_memory(stand: Stand) -> None:
    """Overwriting one form changes no other form, whether it is there already or asked for later, nor the mesh."""
    want = {name: form.toarray() for name, form in every_form(stand.discretization).items()}
    disc = stand.fresh()
    names = list(want)
    forms = every_form(disc)
    for k, name in enumerate(names):
        for other in names[:k]:
            for part in ("data", "indices", "indptr"):
                if np.shares_memory(getattr(forms[name], part), getattr(forms[other], part)):
                    fail(f"backend {stand.backend.name}: {name} and {other} share the memory of their {part}")
    assembler = stand.assembler()
    for method, arguments in (("mass", (1,)), ("stiffness", (1,)), ("divergence", (1,)), ("gradient_coupling", (1, 1))):
        made = csr_array(getattr(assembler, method)(*arguments))
        made.data[:] = np.nan
    strain, mass = csr_array(assembler.strain(1)).toarray(), csr_array(assembler.mass(2)).toarray()
    coupling = csr_array(assembler.divergence_coupling(1, 1)).toarray()
    for name, matrix in (
        ("strain, P1", strain), ("mass, P2", mass), ("divergence_coupling, vector P1, scalar P1", coupling),
    ):  # fmt: skip
        gap = _gap(matrix, want[name])
        require(
            gap < 1e-12,
            f"backend {stand.backend.name}: {name} changes when forms that were returned earlier are overwritten; "
            "return copies of what is kept",
        )


def the_same_again(stand: Stand) -> None:
    """Forms are the same to the last bit when made again, and up to rounding when asked for in another order."""
    disc = stand.fresh()
    first = every_form(disc)
    disc.release()
    again = every_form(disc)
    backwards = every_form(stand.fresh(), reverse=True)
    for name, form in first.items():
        where = f"backend {stand.backend.name}: {name}, on the {stand.name}"
        gap = _gap(again[name].toarray(), form.toarray())
        require(gap == 0.0, f"{where}: differs by {gap:.1e} of its largest entry when made again the same way")
        gap = _gap(backwards[name].toarray(), form.toarray())
        require(gap < 1e-13, f"{where}: differs by {gap:.1e} of its largest entry when forms are asked for backwards")


def meshes_do_not_disturb_each_other(stand: Stand) -> None:
    """Forms do not depend on other meshes that the backend is put on before or in between."""
    want = every_form(stand.discretization)
    other = discretize(stand.backend, shuffled_box(5 - stand.dim, 2, seed=9))
    disc, twin = stand.fresh(), discretize(stand.backend, with_points(stand.mesh, 2.0 * stand.mesh.points))
    for ask in (other.strain, twin.strain, twin.divergence, other.divergence):
        disc.scalar_mass("p1")
        ask("u2")
    for name, form in every_form(disc).items():
        gap = _gap(form.toarray(), want[name].toarray())
        require(
            gap < 1e-13,
            f"backend {stand.backend.name}: {name}, on the {stand.name}: differs by {gap:.1e} of its largest entry "
            "when other meshes are in use; what is kept must belong to one mesh",
        )


def survives_pickling(stand: Stand) -> None:
    """A discretisation can be pickled, also after its use, and the copy gives the same forms."""
    disc = stand.discretization
    want = every_form(disc)
    copy = pickle.loads(pickle.dumps(disc))
    require(isinstance(copy, Discretization), f"backend {stand.backend.name}: the copy is a {type(copy).__name__}")
    for name, form in every_form(copy).items():
        require(
            np.array_equal(form.toarray(), want[name].toarray()),
            f"backend {stand.backend.name}: {name}, on the {stand.name}: is different after pickling",
        )


def inputs_stay_as_they_are(stand: Stand) -> None:
    """Nothing that is given is changed, and read-only arrays are enough: the mesh, points, roles."""
    mesh = stand.mesh
    held: dict[str, Any] = {name: getattr(mesh, name) for name in ("points", "cells", "facets", "facet_tags")}
    held |= {"nodes(2)": mesh.nodes(2), "cell_nodes(2)": mesh.cell_nodes(2), "exterior_facets": mesh.exterior_facets}
    points = sample_points(mesh, 5)
    points.flags.writeable = False
    before = {name: value.copy() for name, value in held.items()}
    roles, seen = dict(mesh.roles), points.copy()
    disc = stand.fresh()
    every_form(disc)
    stand.assembler().evaluation(points, 2, 0)
    for name, value in held.items():
        same = np.array_equal(value, before[name])
        require(same, f"backend {stand.backend.name}: changes mesh.{name}; copy what the library must change")
        require(not value.flags.writeable, f"backend {stand.backend.name}: makes mesh.{name} writeable")
    require(dict(mesh.roles) == roles, f"backend {stand.backend.name}: changes mesh.roles")
    require(np.array_equal(points, seen), f"backend {stand.backend.name}: evaluation changes the points it is given")


def any_memory_order(stand: Stand) -> None:
    """Arrays of the mesh may be stored by columns."""
    mesh = stand.mesh
    points, cells, facets = (
        np.asfortranarray(mesh.points),
        np.asfortranarray(mesh.cells),
        np.asfortranarray(mesh.facets),
    )
    columns = Mesh(points, cells, facets, mesh.facet_tags, mesh.roles)
    _compare(stand, columns, "arrays of the mesh are stored by columns", 1e-13)


def any_tags(stand: Stand) -> None:
    """Tags of roles may be zero, negative or large, and two roles may have the same tag."""
    mesh = stand.mesh
    names = list(mesh.roles)
    tags = dict(zip(names, [0, -3, 70_000, *range(5, 5 + len(names))]))
    numbers = np.array([next(tags[role] for role in names if mesh.roles[role] == tag) for tag in mesh.facet_tags])
    other = Mesh(mesh.points, mesh.cells, mesh.facets, numbers, {"alias": 0} | tags)
    _compare(stand, other, "tags of the roles are 0, -3, 70000", 1e-13)


def lengths_may_be_small(stand: Stand) -> None:
    """A mesh a thousandth the size has forms scaled by the power of length that each form has."""
    factor, mesh = 1e-3, stand.mesh
    small = discretize(stand.backend, with_points(mesh, factor * mesh.points))
    want = every_form(stand.discretization)
    for name, form in every_form(small).items():
        power = stand.dim + _POWERS[name.partition(",")[0].partition(" ")[0]]
        gap = _gap(form.toarray() / factor**power, want[name].toarray())
        require(
            gap < 1e-10,
            f"backend {stand.backend.name}: {name}, on the {stand.name} times {factor:g}: differs by {gap:.1e} from "
            f"the form times {factor:g}^{power}; is there an absolute tolerance?",
        )
    points = sample_points(mesh)
    for axis, power in ((None, 0), (0, -1)):
        given = small.evaluation(factor * points, "p2", axis).toarray() / factor**power
        gap = _gap(given, stand.discretization.evaluation(points, "p2", axis).toarray())
        require(
            gap < 1e-9,
            f"backend {stand.backend.name}: evaluation, P2, on the {stand.name} scaled by {factor:g}: differs by "
            f"{gap:.1e}; is there an absolute tolerance?",
        )


def the_origin_may_be_elsewhere(stand: Stand) -> None:
    """Moving the mesh by twenty times its size changes no form beyond rounding."""
    _compare(stand, with_points(stand.mesh, stand.mesh.points + 20.0), "the mesh is moved by 20", 1e-10)


def writes_nothing(stand: Stand) -> None:
    """Nothing is written to the process's standard output or error, also not by compiled code."""
    points = sample_points(stand.mesh, 5)

    def work() -> None:
        stand.backend.version()
        disc = stand.fresh()
        every_form(disc)
        disc.evaluation(points, "p2", 0)

    work()  # what is compiled at first use may be told then
    text = written_by(work)
    require(not text, f"backend {stand.backend.name}: writes {text[:200]!r}; silence the library")


CHECKS = (
    canonical_matrices, nothing_is_assembled_too_early, forms_are_kept, forms_share_no_memory, the_same_again,
    meshes_do_not_disturb_each_other, survives_pickling, inputs_stay_as_they_are, any_memory_order, any_tags,
    lengths_may_be_small, the_origin_may_be_elsewhere, writes_nothing,
)  # fmt: skip


def _compare(stand: Stand, mesh: Mesh, when: str, tolerance: float) -> None:
    """Forms on `mesh` are those of the stand's mesh."""
    __tracebackhide__ = True
    want, given = every_form(stand.discretization), every_form(discretize(stand.backend, mesh))
    for name, form in want.items():
        gap = _gap(given[name].toarray(), form.toarray())
        require(
            gap < tolerance,
            f"backend {stand.backend.name}: {name}, on the {stand.name}: differs by {gap:.1e} of its largest entry "
            f"when {when}",
        )


def _gap(given: Any, want: Any) -> float:
    """Largest difference as a part of the largest entry; infinite for NaN."""
    gap = np.abs(given - want).max(initial=0.0) / max(np.abs(want).max(initial=0.0), 1e-300)
    return float(gap) if np.isfinite(gap) else float("inf")


def _shape(stand: Stand, name: str, points: int) -> tuple[int, int]:
    """Shape of the form called `name`."""
    nodes: Mapping[str, int] = {f"P{k}": len(stand.mesh.nodes(k)) for k in (1, 2)}
    form, _, orders = name.partition(", ")
    if form == "evaluation":
        return points, nodes[orders]
    if "vector" in orders:
        vector, scalar = (nodes[part.split()[1]] for part in orders.split(", "))
        tall = stand.dim * vector, scalar
        return tall[::-1] if form == "divergence_coupling" else tall
    size = nodes[orders] * (stand.dim if form in ("strain", "divergence") else 1)
    return size, size


def _spy(method: Any, name: str, asked: list[str]) -> Any:
    def spied(self: Assembler, *arguments: Any) -> Any:
        asked.append(name)
        return method(self, *arguments)

    return spied
