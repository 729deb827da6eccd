"""States of one space in another: truths of a finer mesh, of another order, of a slightly other domain.

Interpolation takes the value at each node of the target. A node outside the source's domain, on a boundary that is
curved or somewhere else, takes that of the nearest point of the source: how many do, and how far they are away, is
counted. Projection takes what is nearest in the source's own norm; what is left is what no target state can have.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np
from scipy.sparse import block_diag, csr_array, eye_array

from dacore.algebra.linear_solver import prepared, product
from dacore.algebra.solvers import Auto
from dacore.core.arrays import Array, Sparse
from dacore.core.display import Displayed
from dacore.core.solver import LinearSolver
from dacore.core.space import Product, StateSpace
from dacore.errors import CapabilityError, ConvergenceError, ShapeError
from dacore.studies.errors import ErrorMeter
from dacore.studies.places import FieldTransfer, Finder, Outside, cells_of, node_places

_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Transfer(Displayed):
    """Interpolation of states at the nodes of another space; made by `interpolation`.

    Parameters
    ----------
    source, target : StateSpace
    fields : mapping of str to FieldTransfer
    """

    source: StateSpace
    target: StateSpace
    fields: Mapping[str, FieldTransfer]

    @property
    def outside(self) -> int:
        """The largest number, over the fields, of the target's nodes outside the source's domain."""
        return max(field.outside for field in self.fields.values())

    @property
    def distance(self) -> float:
        """How far [cm] the farthest of them is away."""
        return max(field.distance for field in self.fields.values())

    @property
    def matrix(self) -> Sparse:
        """The whole operator (n_dofs of the target, n_dofs of the source), a csr_array."""
        blocks = [self.fields[f.name].matrix for f in self.source.fields for _ in range(f.components)]
        return csr_array(block_diag(blocks, format="csr"))

    def __call__(self, states: Array) -> Array:
        """States (n,) or (n, t) of the source as states of the target.

        Raises
        ------
        ShapeError
            If they are not states of the source.
        """
        return _by_component(self.source, self.target, states, lambda name, part: product(self.matrix_of(name), part))

    def matrix_of(self, field: str) -> Sparse:
        """Operator (n_target, n_source) on one component of a field."""
        return self.fields[field].matrix


class Projection:
    """The state of a coarser space that is nearest to a given one, in the finer space's own norm.

    With E the values of the target's functions at the source's nodes, J those of the source's at the target's, M and N
    the inner products of the two, it is, field by field and component by component, the c that minimises::

        ‖E c − y‖²_M + hold ‖c − J y‖²_N

    Where the domains are not the same, a function of the target may have no node of the source in its support, or
    hardly one, and could take any value; the second term holds it near what interpolation gives. What the first
    term loses by it is of order hold².

    Parameters
    ----------
    source, target : StateSpace
        The source's mesh must resolve the functions of the target.
    kind : {"l2", "h1"}
    outside : {"nearest", "extend", "error"}
        What a function is where the other domain reaches beyond its own.
    hold : float
        Not negative; 0 for the projection alone.

    Attributes
    ----------
    basis : Transfer
        E: from the target back to the source.
    nodal : Transfer
        J: from the source to the target.

    Raises
    ------
    ShapeError
        As `interpolation`, or if `hold` is negative.
    """

    def __init__(
        self,
        source: StateSpace,
        target: StateSpace,
        kind: Product = "l2",
        outside: Outside = "nearest",
        hold: float = 1e-2,
    ) -> None:
        if not 0 <= hold < np.inf:
            raise ShapeError(f"hold: got {hold}, expected 0 or a positive number")
        self.source, self.target, self.kind, self.hold = source, target, kind, float(hold)
        self.basis = interpolation(target, source, outside)
        self.nodal = interpolation(source, target, outside)

    def __call__(self, states: Array) -> Array:
        """States (n,) or (n, t) of the source as states of the target.

        Raises
        ------
        ShapeError
            If they are not states of the source, or nothing holds what the source does not determine.
        """
        return _by_component(self.source, self.target, states, self._nearest)

    def _nearest(self, field: str, part: Array) -> Array:
        right = self.basis.matrix_of(field).T @ product(self.source.scalar_product(field, self.kind), part)
        if self.hold:
            nodal = product(self.nodal.matrix_of(field), part)
            right = right + self.hold * product(self.target.scalar_product(field, self.kind), nodal)
        return self._solvers[field].solve(right)

    @cached_property
    def _solvers(self) -> dict[str, LinearSolver]:
        """What solves EᵀM E + hold N of each field."""
        out = {}
        for field in self.source.fields:
            basis = self.basis.matrix_of(field.name)
            normal = csr_array(basis.T @ (self.source.scalar_product(field.name, self.kind) @ basis))
            if self.hold:
                normal = csr_array(normal + self.hold * self.target.scalar_product(field.name, self.kind))
            unseen = int((normal.diagonal() <= 0.0).sum())
            try:
                if unseen:
                    raise ConvergenceError(f"{unseen} have no node in their support")
                out[field.name] = prepared(Auto(), normal, np.ones(normal.shape[0], dtype=bool), _TOLERANCE)
            except ConvergenceError as error:
                raise ShapeError(
                    f"projection of {field.name}: the source's {basis.shape[0]} nodes do not tell the target's "
                    f"{basis.shape[1]} functions apart ({error}); expected a finer source, or hold above 0"
                ) from error
        return out


def interpolation(source: StateSpace, target: StateSpace, outside: Outside = "nearest") -> Transfer:
    """Make the operator that evaluates states of one space at the nodes of another.

    Where a field has the same order and nodes in both, it is the identity.

    Parameters
    ----------
    source : StateSpace
        With capability "cells"; with "points" alone if the target's nodes are all inside.
    target : StateSpace
        With capability "cells", which tells where its nodes are.
    outside : {"nearest", "extend", "error"}
        What a node outside the source's domain takes: the value at the nearest point, which stays within the
        bounds of the data; the polynomial of the cell there, continued; or nothing, ShapeError.

    Returns
    -------
    Transfer

    Raises
    ------
    ShapeError
        If the fields differ in name, components or unit, the spaces in dimension, or a node is outside and
        `outside` is "error".
    CapabilityError
        If a space cannot tell where its nodes are, or evaluate a state there.
    """
    if outside not in get_args(Outside):
        raise ShapeError(f"outside: got {outside!r}, expected 'nearest', 'extend' or 'error'")
    _check_fields(source, target)
    geometry = cells_of(target, "target")
    cells = source.cells() if "cells" in source.capabilities else None
    if cells is not None and cells.points.shape[1] != geometry.points.shape[1]:
        raise ShapeError(
            f"transfer: got a source of {cells.points.shape[1]} dimensions and a target of "
            f"{geometry.points.shape[1]}, expected the same"
        )
    finder = None if cells is None else Finder(cells, outside)
    fields = {}
    for field in target.fields:
        x = node_places(target, field.name)
        if finder is None:
            fields[field.name] = FieldTransfer(_evaluated(source, field.name, x), 0, 0.0)
        elif _same_nodes(source, target, field.name, x):
            fields[field.name] = FieldTransfer(csr_array(eye_array(len(x), format="csr")), 0, 0.0)
        else:
            fields[field.name] = finder.transfer(field.name, x, source.layout.nodes[field.name])
    return Transfer(source, target, fields)


def unattainable(there: Transfer | Projection, back: Transfer, states: Array, meter: ErrorMeter) -> dict[str, float]:
    """Return the part of a truth that is lost on the way to another space and back, relative to the truth.

    After a `Projection` and its ``basis`` it is what no state of the target can have.

    Parameters
    ----------
    there : Transfer or Projection
    back : Transfer
    states : (n_dofs, t) array
        Of the source of `there`.
    meter : ErrorMeter
        On that source.

    Returns
    -------
    dict of str to float
        Ratio of the norms over space and time, for each label of the meter.
    """
    pairs = meter.errors(states - back(there(states)), meter.reference(states))
    return {label: float(np.sqrt((left**2).sum() / (whole**2).sum())) for label, (left, whole) in pairs.items()}


def _by_component(source: StateSpace, target: StateSpace, states: Array, move: Callable[[str, Array], Array]) -> Array:
    """States (n, ...) of the target, each component of each field moved by a function of its name and values (k, t)."""
    given = np.asarray(states, dtype=np.float64)
    if given.ndim not in (1, 2) or len(given) != source.n_dofs:
        raise ShapeError(f"states to transfer: got shape {given.shape}, expected ({source.n_dofs},) or with columns")
    columns = given.reshape(len(given), -1)
    out = np.empty((target.n_dofs, columns.shape[1]))
    for field in source.fields:
        for component in range(field.components):
            rows, places = (space.layout.component(field.name, component) for space in (source, target))
            out[places] = move(field.name, columns[rows])
    return out.reshape(target.n_dofs, *given.shape[1:])


def _check_fields(source: StateSpace, target: StateSpace) -> None:
    one, other = ([(f.name, f.components, f.unit) for f in space.fields] for space in (source, target))
    if one != other:
        texts = [", ".join(f"{name} ({n}) [{unit}]" for name, n, unit in fields) for fields in (one, other)]
        raise ShapeError(f"transfer: got fields {texts[0]} and {texts[1]}, expected the same of both spaces")


def _same_nodes(source: StateSpace, target: StateSpace, field: str, x: Array) -> bool:
    """Whether a field has the same elements at the same nodes in both, so that nothing is to be done."""
    if source.layout.field(field).order != target.layout.field(field).order:
        return False
    return source.layout.nodes[field] == len(x) and np.array_equal(node_places(source, field), x)


def _evaluated(source: StateSpace, field: str, x: Array) -> Sparse:
    """Values of one component at points, of a source that has no cells to look into."""
    try:
        values = source.evaluation(x, field)
    except CapabilityError as error:
        raise CapabilityError(
            f"transfer: the source, {type(source).__name__}, has neither cells nor points, so that its states have no "
            "values in space; expected a space of finite elements"
        ) from error
    return csr_array(values[: len(x), source.layout.component(field, 0)])
