"""Compare a matrix with the expected one, and say what is wrong with it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray
from dacore.errors import PluginError
from dacore.testing.reference import Expected
from dacore.testing.suite import fail

# Of the size of the numbers that go into an entry: a thousand times what rounding makes of them.
TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Side:
    """What the rows or the columns of a matrix stand for.

    Parameters
    ----------
    places : (n, d) array [cm]
        Of the nodes, or of the points of an evaluation.
    components : int
    what : {"node", "point"}
    """

    places: Array
    components: int = 1
    what: str = "node"

    def name(self, index: int) -> str:
        """Component, number and place of one row or column."""
        component, number = divmod(index, len(self.places))
        place = ", ".join(f"{value:.4g}" for value in self.places[number])
        part = f"component {component} of " if self.components > 1 else ""
        return f"{part}{self.what} {number} at ({place})"


@dataclass(frozen=True, eq=False)
class Form:
    """A form that is compared: its name, what its rows and columns are, and mistakes that would explain it.

    Parameters
    ----------
    name : str
        As a message shows it, with element orders and mesh.
    rows, columns : Side
    mistakes : mapping of str to callable
        What the matrix would be after a certain mistake: text of the mistake to a function that makes the matrix.
    """

    name: str
    rows: Side
    columns: Side
    mistakes: Mapping[str, Callable[[], Array]] = field(default_factory=dict)


def agree(ask: Callable[[], Any], raw: Callable[[], Any], expected: Expected, form: Form) -> None:
    """Raise `ContractError` unless every entry is the expected one up to rounding.

    Parameters
    ----------
    ask : callable
        Asks the discretisation for the form.
    raw : callable
        Asks the assembler itself, which says what is wrong with a matrix that the discretisation refuses.
    expected : Expected
    form : Form
    """
    __tracebackhide__ = True
    try:
        matrix = np.asarray(ask().toarray(), dtype=np.float64)
    except PluginError:
        _shape(raw, expected, form)
        raise
    # Entries no cell contributes to may hold dust of the size of the smallest contribution.
    scale = np.where(expected.scale > 0, expected.scale, expected.scale[expected.scale > 0].min(initial=np.inf))
    error = np.abs(matrix - expected.matrix) / scale
    wrong = ~(error <= TOLERANCE)
    if not wrong.any():
        return
    worst = np.unravel_index(np.argmax(np.where(np.isnan(error), np.inf, error)), error.shape)
    i, j = int(worst[0]), int(worst[1])
    cause = likely_cause(matrix, expected, form)
    fail(
        f"{form.name}: {_count(wrong, expected.scale > 0)}; the worst, of "
        f"{form.rows.name(i)} and {form.columns.name(j)}, is {matrix[i, j]:.10g}, expected "
        f"{expected.matrix[i, j]:.10g} (difference {abs(matrix[i, j] - expected.matrix[i, j]):.2g}, allowed "
        f"{TOLERANCE * scale[i, j]:.1g}){cause}"
    )


def _shape(raw: Callable[[], Any], expected: Expected, form: Form) -> None:
    """Fail if it is its shape for which a form was refused; return if it is something else."""
    __tracebackhide__ = True
    try:
        matrix = np.asarray(csr_array(raw()).toarray(), dtype=np.float64)
    except Exception:  # noqa: BLE001  it was refused for raising, which the caller tells
        return
    want = expected.matrix
    if matrix.shape == want.shape:
        return
    cause = likely_cause(matrix, expected, form)
    if not cause and matrix.shape == want.shape[::-1]:
        cause = "; likely cause: rows and columns are exchanged, rows belong to the test function"
    one = want.shape[0] // form.rows.components, want.shape[1] // form.columns.components
    if not cause and matrix.shape == one:
        cause = "; likely cause: it is for one component, expected all of the vector"
    fail(f"{form.name}: has shape {matrix.shape}, expected {want.shape}{cause}")


def _count(wrong: BoolArray, pattern: BoolArray) -> str:
    """How many entries differ: of those that cells contribute to, and of the others."""
    inside, outside = int((wrong & pattern).sum()), int((wrong & ~pattern).sum())
    differ = f"{inside} of {int(pattern.sum())} entries differ"
    return f"{differ}, and {outside} are not zero where no cell contributes" if outside else differ


def likely_cause(matrix: Array, expected: Expected, form: Form) -> str:
    """What would turn the expected matrix into the given one: "; likely cause: …", or nothing."""
    want = expected.matrix
    size = float(np.abs(expected.scale).max())
    if np.isnan(matrix).any():
        return "; it holds NaN"
    if not matrix.any():
        return "; it is zero everywhere: was it assembled, and over the right cells or facets?"

    def same(other: Array, within: float = 1e-8) -> bool:
        return other.shape == matrix.shape and bool(np.abs(matrix - other).max() <= within * size)

    if same(want, 1e-6):
        return "; likely cause: numbers of too few digits: single precision, or rounded quadrature points or weights"
    for text, mistake in form.mistakes.items():
        if same(mistake()):
            return f"; likely cause: {text}"
    if same(want.T):
        return "; likely cause: it is transposed, rows belong to the test function"
    if matrix.shape != want.shape:
        return ""
    ratio = float(np.vdot(want, matrix) / np.vdot(want, want))
    if same(ratio * want):
        return f"; likely cause: it is {ratio:.6g} times what it should be"
    if want.shape[0] == want.shape[1] and same(np.diag(want.sum(axis=1))):
        return "; likely cause: it is lumped, or quadrature is at the nodes alone"
    return _order_of_dofs(matrix, want, form, same) or _quadrature(matrix, expected, form)


def _quadrature(matrix: Array, expected: Expected, form: Form) -> str:
    """Whether integrals of the lowest polynomials are right, and only those of higher ones are not."""
    want, pattern = expected.matrix, expected.scale > 0
    sides = (form.rows, form.columns)
    if any(side.what != "node" for side in sides) or np.abs(matrix[~pattern]).max(initial=0.0) > 0:
        return ""
    if want.shape[0] == want.shape[1] and np.allclose(want, want.T) and not np.allclose(matrix, matrix.T):
        return ""
    # Nodal values of constants and of linear functions, one component at a time: (functions, dofs).
    constant = [np.kron(np.eye(side.components), np.ones(len(side.places))) for side in sides]
    linear = [np.kron(np.eye(side.components), side.places.T) for side in sides]
    for pairs in (
        [(constant[0], constant[1])],
        [(constant[0], linear[1]), (linear[0], constant[1])],
        [(linear[0], linear[1])],
    ):
        size = max(float((abs(a) @ abs(want) @ abs(b).T).max()) for a, b in pairs)
        if max(float(np.abs(a @ (matrix - want) @ b.T).max()) for a, b in pairs) > 1e-10 * size:
            return ""
        if max(float(np.abs(a @ want @ b.T).max()) for a, b in pairs) > 1e-10 * size:
            return "; likely cause: quadrature of too low order: integrals of polynomials of low degree are right"
    return ""


def _order_of_dofs(matrix: Array, want: Array, form: Form, same: Callable[[Array], bool]) -> str:
    for side, axis in ((form.rows, 0), (form.columns, 1)):
        if side.components == 1:
            continue
        count = len(side.places)
        blocked = np.arange(count * side.components)
        interleaved = blocked.reshape(side.components, count).T.ravel()
        both = form.rows.components == form.columns.components
        for order, text in (
            (interleaved, "dofs are ordered node by node, expected component by component"),
            (np.argsort(interleaved), "dofs are ordered node by node, expected component by component"),
            (blocked.reshape(side.components, count)[::-1].ravel(), "components are in reverse order"),
            (np.roll(blocked, count), "components are permuted"),
        ):
            moved = want[np.ix_(order, order)] if both else np.take(want, order, axis=axis)
            if same(moved):
                return f"; likely cause: {text}"
    if np.allclose(np.sort(matrix, axis=None), np.sort(want, axis=None), rtol=1e-7, atol=1e-9 * np.abs(want).max()):
        return (
            "; likely cause: the same numbers stand in other places: nodes or components are numbered differently "
            "(expected: component times number of nodes plus row of mesh.nodes(order))"
        )
    return ""
