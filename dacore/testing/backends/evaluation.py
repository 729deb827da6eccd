"""Values and derivatives at points."""

from collections.abc import Callable
from functools import partial

import numpy as np

from dacore.core.arrays import Array
from dacore.errors import ShapeError
from dacore.testing.backends.stand import ORDERS, Stand, sample_points
from dacore.testing.compare import Form, Side, agree
from dacore.testing.polynomials import Polynomial
from dacore.testing.reference import Expected
from dacore.testing.suite import fail, require


def values_at_points(stand: Stand) -> None:
    """`evaluation` gives the values of all basis functions at points inside, on facets, on edges and at vertices."""
    points = sample_points(stand.mesh)
    for k in ORDERS:
        want = stand.reference.evaluation(points, k, None)
        mistakes: dict[str, Callable[[], Array]] = {"it takes the nearest vertex": partial(_nearest, stand, points, k)}
        form = Form(stand.where("evaluation", f"P{k}"), Side(points, what="point"), stand.side(k), mistakes)
        _agree(stand, points, k, None, want, form)


def derivatives_at_points(stand: Stand) -> None:
    """Derivatives are those of the cell that holds the point; on facets between cells, of the lowest-numbered one."""
    points = sample_points(stand.mesh)
    for k in ORDERS:
        for axis in range(stand.dim):
            want = stand.reference.evaluation(points, k, axis)
            others = {
                f"it is the derivative along axis {other}": partial(_derivative, stand, points, k, other)
                for other in range(stand.dim)
                if other != axis
            }
            name = stand.where(f"evaluation of the derivative along axis {axis}", f"P{k}")
            form = Form(name, Side(points, what="point"), stand.side(k), others)
            _agree(stand, points, k, axis, want, form)


def evaluation_at_nodes(stand: Stand) -> None:
    """At the nodes, boundary included, values are the dofs themselves: the matrix is the identity."""
    for k in ORDERS:
        nodes = stand.mesh.nodes(k)
        gap = abs(stand.discretization.evaluation(nodes, f"p{k}") - np.eye(len(nodes))).max()
        where = stand.where("evaluation at the nodes", f"P{k}")
        require(
            gap < 1e-8, f"{where}: differs from the identity by {gap:.1e}; are nodes numbered as mesh.nodes(order)?"
        )


def evaluation_of_polynomials(stand: Stand) -> None:
    """Values and derivatives of polynomials the elements hold are exact, anywhere in the box."""
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(size=(100, stand.dim)), sample_points(stand.mesh)])
    for k in ORDERS:
        polynomial = Polynomial(rng, stand.dim, k)
        nodal, slopes = polynomial(stand.mesh.nodes(k)), polynomial.gradient(points)
        wanted = {None: polynomial(points)} | {axis: slopes[:, axis] for axis in range(stand.dim)}
        for axis, want in wanted.items():
            gap = np.abs(stand.discretization.evaluation(points, f"p{k}", axis) @ nodal - want)
            worst = int(gap.argmax())
            what = "value" if axis is None else f"derivative along axis {axis}"
            require(
                bool(gap[worst] < 1e-10),
                f"{stand.where('evaluation', f'P{k}')}: {what} of a polynomial of degree {k} at "
                f"{points[worst].round(4).tolist()} is off by {gap[worst]:.1e}, expected rounding",
            )


def points_outside(stand: Stand) -> None:
    """Points outside, far away, just beside the boundary or in a hole, raise ShapeError naming the first of them."""
    mesh, dim = stand.mesh, stand.dim
    inside = sample_points(mesh, 3)[:3]
    beside = []
    for role in mesh.roles:
        patch = stand.reference.surface(role)
        middle = mesh.points[mesh.boundary_facets(role)[0]].mean(axis=0)
        size = float(np.ptp(mesh.points[mesh.boundary_facets(role)[0]], axis=0).max())
        beside.append((f"beside the boundary {role!r}", middle + 0.01 * size * patch.normals[0]))
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for where, point in [("far away", high + 10 * (high - low)), *beside]:
        for k in ORDERS:
            for axis in (None, dim - 1):
                points = np.concatenate([inside, point[None], inside[:1], point[None]])
                name = f"{stand.where('evaluation', f'P{k}')}: a point {where}, {point.round(6).tolist()}"
                try:
                    stand.discretization.evaluation(points, f"p{k}", axis)
                except ShapeError as error:
                    text = str(error)
                    require(
                        "outside" in text and f"point {len(inside)} " in text,
                        f"{name}, raises {text!r}; expected it to say that point {len(inside)} lies outside",
                    )
                except Exception as error:  # noqa: BLE001  whatever else a library raises is the finding
                    fail(f"{name}, raises {type(error).__name__}: {error}; expected ShapeError")
                else:
                    fail(f"{name}, raises nothing; expected ShapeError")


def no_points(stand: Stand) -> None:
    """No points give a matrix with no rows."""
    for axis in (None, 0):
        made = stand.discretization.evaluation(np.empty((0, stand.dim)), "p2", axis)
        want = (0, len(stand.mesh.nodes(2)))
        require(
            made.shape == want, f"{stand.where('evaluation at no points', 'P2')}: has shape {made.shape}, not {want}"
        )


GENERAL = (values_at_points, derivatives_at_points, evaluation_at_nodes)
ON_A_BOX = (evaluation_of_polynomials,)
WITH_A_HOLE = (points_outside, no_points)


def _nearest(stand: Stand, points: Array, order: int) -> Array:
    distance = np.linalg.norm(points[:, None] - stand.mesh.points[None], axis=2)
    return np.asarray(np.eye(len(stand.mesh.nodes(order)))[distance.argmin(axis=1)])


def _derivative(stand: Stand, points: Array, order: int, axis: int) -> Array:
    return stand.reference.evaluation(points, order, axis).matrix


def _agree(stand: Stand, points: Array, order: int, axis: int | None, want: Expected, form: Form) -> None:
    __tracebackhide__ = True
    agree(
        lambda: stand.discretization.evaluation(points, f"u{order}", axis),
        lambda: stand.assembler().evaluation(points, order, axis),
        want,
        form,
    )
