"""What is drawn: the space of whatever a user has in hand, a plane through it, values on the plane."""

from typing import Literal, TypeAlias

import numpy as np
from scipy.sparse import block_diag, csr_array, hstack

from dacore.core.arrays import Array, IntArray, Sparse
from dacore.core.background import Background
from dacore.core.estimator import Estimate
from dacore.core.mesh import Mesh
from dacore.core.model import ForwardModel
from dacore.core.space import StateSpace
from dacore.errors import CapabilityError, ShapeError
from dacore.figures.slices import Frame, View
from dacore.geometry.cut import cut_plane, planar_domain
from dacore.workflow.session import Session

Axis: TypeAlias = Literal["x", "y", "z"]
Subject: TypeAlias = Session | ForwardModel | Background | Estimate | StateSpace


def space_of(subject: Subject) -> StateSpace:
    """Return the state space of a session, a model, a background, an estimate, or the space itself.

    Parameters
    ----------
    subject : Session, ForwardModel, Background, Estimate or StateSpace

    Returns
    -------
    StateSpace
    """
    if isinstance(subject, StateSpace):
        return subject
    if isinstance(subject, Session):
        return subject.model.space
    return subject.background.space if isinstance(subject, Estimate) else subject.space


def axis_number(axis: str, dim: int) -> int:
    """Number of an axis given by its letter; ShapeError if there is no such axis."""
    if axis not in tuple("xyz"[:dim]):
        raise ShapeError(f"axis: got {axis!r}, expected {', '.join(map(repr, 'xyz'[:dim]))}")
    return "xyz".index(axis)


def view_of(points: Array, cells: IntArray, axis: str, position: float | None,
            fine: bool = False) -> View:  # fmt: skip
    """Plane through a mesh: the whole of a planar one, or where an axis has a value, the middle by default.

    Parameters
    ----------
    points : (n, d) array [cm]
    cells : (c, d + 1) int array
    axis : {"x", "y", "z"}
    position : float, optional [cm]
    fine : bool
        Split its triangles, for fields of order 2.
    """
    if points.shape[1] == 2:
        cut = planar_domain(points, cells)
    elif points.shape[1] == 3:
        number = axis_number(axis, 3)
        low, high = points[:, number].min(), points[:, number].max()
        cut = cut_plane(points, cells, number, float(0.5 * (low + high)) if position is None else position)
    else:
        raise CapabilityError(
            f"a domain of {points.shape[1]} dimensions has no slices; draw its values with matplotlib"
        )
    return View(cut.refined(points, cells) if fine else cut, Frame())


def slice_of(space: StateSpace, field: str, axis: str, position: float | None) -> View:
    """Plane through the domain of a state, fine enough for a field; CapabilityError for a space without cells."""
    geometry = space.cells()
    return view_of(geometry.points, geometry.cells, axis, position, geometry.orders[space.layout.field(field).name] > 1)


def on_view(space: StateSpace, view: View, field: str) -> Sparse:
    """Values of a field at the points of a view as functionals (c · q, n_dofs), component by component."""
    layout, geometry = space.layout, space.cells()
    matrix = view.cut.interpolation(geometry.nodes[field], geometry.orders[field], layout.nodes[field])
    block = layout.block(field)
    inside = block_diag([matrix] * layout.field(field).components, format="csr")
    before, after = (csr_array((inside.shape[0], n)) for n in (block.start, space.n_dofs - block.stop))
    return csr_array(hstack([before, inside, after], format="csr"))


def shown_part(values: Array, component: int | str | None, field: str) -> tuple[Array, str]:
    """What is shown (q,) of components (c, q), and what it is called: the length of a vector, or one component."""
    count = len(values)
    if component is None:
        return (values[0], field) if count == 1 else (np.linalg.norm(values, axis=0), f"|{field}|")
    number = "xyz".find(component) if isinstance(component, str) and len(component) == 1 else component
    if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < count:
        raise ShapeError(f"component of {field}: got {component!r}, expected 0 to {count - 1} or a letter of an axis")
    return values[int(number)], field if count == 1 else f"{field}_{'xyz'[int(number)] if count <= 3 else number}"


def one_state(space: StateSpace, state: Array) -> Array:
    """Check that `state` is one state (n_dofs,) of `space`; ShapeError says how to take one."""
    given = np.asarray(state, dtype=np.float64)
    if given.shape != (space.n_dofs,):
        raise ShapeError(
            f"state: got shape {given.shape}, expected ({space.n_dofs},); take one step of a trajectory, "
            "trajectory.states[:, step], and one series of an estimate, estimate.state(series, step)"
        )
    return given


def mesh_of(subject: Subject | Mesh) -> Mesh:
    """Return the mesh of a session or a finite element space, or the mesh itself; CapabilityError without one."""
    if isinstance(subject, Mesh):
        return subject
    if isinstance(subject, Session):
        return subject.mesh
    found = getattr(getattr(space_of(subject), "discretization", None), "mesh", None)
    if not isinstance(found, Mesh):
        raise CapabilityError(f"{type(subject).__name__} has no mesh; give a Mesh, or a scene with a domain")
    return found
