"""Contracts of a state space: fields, inner products, and what capabilities promise."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from dacore.core.fields import Layout
from dacore.core.simplex import barycentric_gradients, lagrange, n_local
from dacore.core.space import CellGeometry, Product, StateSpace
from dacore.errors import CapabilityError, MeshError, ShapeError
from dacore.testing.spaces import node_points
from dacore.testing.suite import Suite, bind, expect_maker, fail, require

KINDS: tuple[Product, ...] = ("l2", "h1")


@dataclass(eq=False)
class Space:
    """A state space and the roles its boundary has.

    Parameters
    ----------
    make : callable
        Makes the space when it is first needed.
    roles : sequence of str
    """

    make: Callable[[], StateSpace] = field(repr=False)
    roles: Sequence[str] = ()

    @cached_property
    def space(self) -> StateSpace:
        """The space."""
        return self.make()

    @property
    def name(self) -> str:
        """Name of the class, for messages."""
        return type(self.space).__name__

    @cached_property
    def geometry(self) -> CellGeometry:
        """The space's cells."""
        return self.space.cells()


def layout_stays(case: Space) -> None:
    """`layout` is a `Layout`, the same each time, and every field has nodes."""
    layout = case.space.layout
    require(isinstance(layout, Layout), f"{case.name}: layout is a {type(layout).__name__}")
    require(case.space.layout == layout, f"{case.name}: layout changes from call to call")
    empty = [name for name, count in layout.nodes.items() if count < 1]
    require(not empty, f"{case.name}: the field {', '.join(empty)} has no nodes")


def products_are_inner_products(case: Space) -> None:
    """Both products of every field are symmetric positive definite csr_arrays of a row a node, "h1" not below "l2"."""
    for each in case.space.fields:
        n = case.space.layout.nodes[each.name]
        dense = {}
        for kind in KINDS:
            product, where = case.space.scalar_product(each.name, kind), f"{case.name}: {kind} product of {each.name}"
            good = isinstance(product, csr_array) and product.dtype == np.float64
            require(good, f"{where}: is a {type(product).__name__}, expected csr_array of float64")
            require(product.shape == (n, n), f"{where}: has shape {product.shape}, expected {(n, n)}")
            dense[kind] = product.toarray()
            require(bool(np.isfinite(dense[kind]).all()), f"{where}: holds NaN or infinite values")
            gap = float(np.abs(dense[kind] - dense[kind].T).max() / np.abs(dense[kind]).max())
            require(gap < 1e-12, f"{where}: unsymmetric by {gap:.1e} of its largest entry")
            low = float(np.linalg.eigvalsh(dense[kind])[0] / np.abs(dense[kind]).max())
            require(low > 1e-13, f"{where}: has the eigenvalue {low:.2g} of its largest entry, expected positive")
        low = float(np.linalg.eigvalsh(dense["h1"] - dense["l2"])[0] / np.abs(dense["h1"]).max())
        require(low > -1e-12, f"{case.name}: the h1 product of {each.name} is below l2 (eigenvalue {low:.2g})")


def products_stay(case: Space) -> None:
    """Products are the same each time they are asked for."""
    for each in case.space.fields:
        for kind in KINDS:
            first = case.space.scalar_product(each.name, kind).toarray()
            same = np.array_equal(case.space.scalar_product(each.name, kind).toarray(), first)
            require(same, f"{case.name}: the {kind} product of {each.name} changes from call to call")


def products_of_fields(case: Space) -> None:
    """`field_product` repeats the scalar product for each component; `inner_product` weights the fields."""
    weights = {each.name: 2.0 + k for k, each in enumerate(case.space.fields)}
    for kind in KINDS:
        whole = case.space.inner_product(weights, kind).toarray()
        want = np.zeros((case.space.n_dofs,) * 2)
        for each in case.space.fields:
            one = case.space.scalar_product(each.name, kind).toarray()
            for c in range(each.components):
                part = case.space.layout.component(each.name, c)
                want[part, part] = weights[each.name] * one
        gap = float(np.abs(whole - want).max() / np.abs(want).max())
        require(
            gap < 1e-13, f"{case.name}: inner_product differs by {gap:.1e} from the weighted products of the fields"
        )


def wrong_questions_are_refused(case: Space) -> None:
    """An unknown field raises an error, a weight that is not positive ShapeError."""
    first = case.space.fields[0].name
    _raises(
        case, "scalar_product of a field that is not there", lambda: case.space.scalar_product("no_field"), Exception
    )
    _raises(case, "inner_product with a weight of 0", lambda: case.space.inner_product({first: 0.0}), ShapeError)


def capabilities_are_kept(case: Space) -> None:
    """What `capabilities` names works, and what it does not name raises CapabilityError."""
    first = case.space.fields[0].name
    asked: dict[str, Callable[[], object]] = {
        "points": lambda: case.space.evaluation(np.zeros((0, _dim(case))), first),
        "cells": case.space.cells,
        "boundary": lambda: [case.space.boundary_mean(role, first) for role in case.roles],
    }
    if not case.roles:
        asked["boundary"] = lambda: case.space.boundary_mean("no_role", first)
    names = case.space.capabilities
    require(names <= set(asked), f"{case.name}: capabilities are {sorted(names)}, expected some of {sorted(asked)}")
    for name, ask in asked.items():
        if name in names:
            if name != "boundary" or case.roles:
                ask()
        else:
            _raises(case, f"a space without the capability {name}", ask)


def cells_hold_the_fields(case: Space) -> None:
    """Cells are positive simplices whose local nodes are all nodes of each field, of the order of the field."""
    if "cells" not in case.space.capabilities:
        return
    geometry = case.geometry
    dim = geometry.points.shape[1]
    require(geometry.cells.shape[1] == dim + 1, f"{case.name}: cells have {geometry.cells.shape[1]} vertices")
    volumes = barycentric_gradients(geometry.points, geometry.cells)[1]
    require(bool((volumes > 0).all()), f"{case.name}: {int((volumes <= 0).sum())} cells are inverted or flat")
    for each in case.space.fields:
        nodes, count = geometry.nodes[each.name], case.space.layout.nodes[each.name]
        where = f"{case.name}: nodes of {each.name}"
        good = geometry.orders[each.name] == each.order
        require(good, f"{where}: have order {geometry.orders[each.name]}, the field has {each.order}")
        want = (len(geometry.cells), n_local(dim, each.order))
        require(nodes.shape == want, f"{where}: have shape {nodes.shape}, expected {want}")
        used = np.unique(nodes)
        good = np.array_equal(used, np.arange(count))
        require(good, f"{where}: {len(used)} are numbered {used.min()} to {used.max()}, expected 0 to {count - 1}")
        places = node_points(geometry, each.name)
        for corner in range(dim + 1):
            gap = np.abs(places[nodes[:, corner]] - geometry.points[geometry.cells[:, corner]]).max()
            require(float(gap) < 1e-12, f"{where}: local node {corner} is not at vertex {corner} of its cell")


def evaluation_is_that_of_the_cells(case: Space) -> None:
    """Values at points are those of the local polynomials of the cells: row component · p + point, that field only."""
    if not {"points", "cells"} <= case.space.capabilities:
        return
    geometry, rng = case.geometry, np.random.default_rng(0)
    chosen = rng.integers(len(geometry.cells), size=12)
    weights = rng.dirichlet(np.ones(geometry.cells.shape[1]), size=12)
    points = np.einsum("pi,pid->pd", weights, geometry.points[geometry.cells[chosen]])
    for each in case.space.fields:
        matrix = case.space.evaluation(points, each.name).toarray()
        want = np.zeros((each.components, len(points), case.space.n_dofs))
        local = lagrange(each.order, weights)
        for c in range(each.components):
            start = case.space.layout.component(each.name, c).start
            np.put_along_axis(want[c], start + geometry.nodes[each.name][chosen], local, axis=1)
        rows = want.reshape(-1, case.space.n_dofs)
        where = f"{case.name}: evaluation of {each.name}"
        require(matrix.shape == rows.shape, f"{where}: has shape {matrix.shape}, expected {rows.shape}")
        gap = float(np.abs(matrix - rows).max())
        require(gap < 1e-9, f"{where}: differs by {gap:.1e} from the polynomials of the cells at points inside them")


def derivatives_are_slopes(case: Space) -> None:
    """A derivative along an axis is the limit of differences of values inside a cell."""
    if not {"points", "cells"} <= case.space.capabilities:
        return
    geometry, rng = case.geometry, np.random.default_rng(1)
    middles = geometry.points[geometry.cells].mean(axis=1)[rng.integers(len(geometry.cells), size=6)]
    size = 1e-4 * float(np.ptp(geometry.points[geometry.cells], axis=1).min())
    for each in case.space.fields:
        state = rng.standard_normal(case.space.n_dofs)
        for axis in range(middles.shape[1]):
            step = size * np.eye(middles.shape[1])[axis]
            given = case.space.evaluation(middles, each.name, axis) @ state
            ahead, behind = (case.space.evaluation(x, each.name) @ state for x in (middles + step, middles - step))
            want = (ahead - behind) / (2.0 * size)
            gap = float(np.abs(given - want).max() / np.abs(want).max())
            require(
                gap < 1e-6,
                f"{case.name}: the derivative of {each.name} along axis {axis} is off by {gap:.1e} of its size",
            )


def points_outside_are_named(case: Space) -> None:
    """A point outside the domain raises ShapeError that names the first one."""
    if not {"points", "cells"} <= case.space.capabilities:
        return
    points, first = case.geometry.points, case.space.fields[0].name
    middle = points[case.geometry.cells[0]].mean(axis=0)
    where = np.stack([middle, points.max(axis=0) + 7.0 * np.ptp(points, axis=0)])
    try:
        case.space.evaluation(where, first)
    except ShapeError as error:
        require("point 1 " in str(error), f"{case.name}: says {str(error)!r}, expected it to name point 1")
        return
    fail(f"{case.name}: a point far outside raises nothing, expected ShapeError")


def means_over_boundaries(case: Space) -> None:
    """A mean over a role gives one for a constant component and sees no other; unknown roles raise MeshError."""
    if "boundary" not in case.space.capabilities:
        return
    for role in case.roles:
        for each in case.space.fields:
            matrix = case.space.boundary_mean(role, each.name)
            where = f"{case.name}: mean of {each.name} over {role!r}"
            want = (each.components, case.space.n_dofs)
            require(matrix.shape == want, f"{where}: has shape {matrix.shape}, expected {want}")
            for c in range(each.components):
                state = np.zeros(case.space.n_dofs)
                state[case.space.layout.component(each.name, c)] = 1.0
                gap = float(np.abs(matrix @ state - np.eye(each.components)[c]).max())
                require(gap < 1e-12, f"{where}: component {c} being 1 it is {(matrix @ state).tolist()}")
                state = 1.0 - state
                state[case.space.layout.block(each.name)] = 0.0
                require(not (matrix @ state).any(), f"{where}: sees other fields")
    name = case.space.fields[0].name
    _raises(case, "a role that is not there", lambda: case.space.boundary_mean("no_role", name), MeshError)


def spaces_can_be_pickled(case: Space) -> None:
    """A space can be pickled, and the copy has the same layout and products."""
    copy = pickle.loads(pickle.dumps(case.space))
    require(copy.layout == case.space.layout, f"{case.name}: has another layout after pickling")
    for each in case.space.fields:
        for kind in KINDS:
            first, second = (space.scalar_product(each.name, kind).toarray() for space in (case.space, copy))
            require(
                np.array_equal(first, second), f"{case.name}: the {kind} product of {each.name} differs after pickling"
            )


CHECKS = (
    layout_stays, products_are_inner_products, products_stay, products_of_fields, wrong_questions_are_refused,
    capabilities_are_kept, cells_hold_the_fields, evaluation_is_that_of_the_cells, derivatives_are_slopes,
    points_outside_are_named, means_over_boundaries, spaces_can_be_pickled,
)  # fmt: skip


def space_suite(space: Callable[[], StateSpace], roles: Sequence[str] = ()) -> Suite:
    """Make every check of a state space.

    Parameters
    ----------
    space : callable
        Makes the space; some hundred dofs, since products are looked at as dense matrices.
    roles : sequence of str
        Of its boundary, where it has means over boundaries.

    Returns
    -------
    Suite

    Raises
    ------
    PluginError
        If `space` cannot be called.
    """
    expect_maker("space_suite", "space", space)
    return Suite(bind(CHECKS, Space(space, roles)))


def _dim(case: Space) -> int:
    return case.geometry.points.shape[1] if "cells" in case.space.capabilities else 3


def _raises(case: Space, what: str, ask: Callable[[], object], kind: type[Exception] = CapabilityError) -> None:
    __tracebackhide__ = True
    try:
        ask()
    except kind:
        return
    except Exception as error:  # noqa: BLE001  anything else is the finding
        fail(f"{case.name}: {what} raises {type(error).__name__}: {error}; expected {kind.__name__}")
    fail(f"{case.name}: {what} raises nothing, expected {kind.__name__}")
