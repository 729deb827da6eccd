"""Terzaghi's, Mandel's and Cryer's problems, put on meshes."""

import numpy as np
from scipy.interpolate import CubicSpline

from dacore.core.mesh import Mesh, exterior_facets
from dacore_biot.analytic import Cryer, Mandel, Medium, Terzaghi
from dacore_biot.conditions import Conditions, normal_force, poroelastic, tied
from tests.verification.setting import Case, box, errors, load, march_graded, parameters, put, space_of

COLUMN = Terzaghi(Medium())
BLOCK = Mandel(Medium())
BALL = Cryer(Medium())
LEVELS = 6
WIDTH = 0.25


def terzaghi(name, dim, order, n, piston=False, column=COLUMN, remedy="none"):
    """A column on rollers; loaded on the drained end, or by a tight piston with the drain at the fixed bottom."""
    up, h = dim - 1, column.height
    mesh = box((WIDTH * h,) * up + (h,), (max(1, n // 4),) * up + (n,))
    bottom, top = ("y-", "y+") if dim == 2 else ("z-", "z+")
    held = {f"{axis}{end}": (k,) for k, axis in enumerate("xyz"[:up]) for end in "-+"} | {bottom: (up,)}
    on = put(name, mesh, order)
    conditions = Conditions(held, (bottom if piston else top,))
    pressed = load(on, -column.load * normal_force(on, top))
    model = poroelastic(on, space_of(column.medium), conditions, (pressed,), False, remedy)

    def exact(time):
        def u(x):
            z = x[:, up] if piston else h - x[:, up]
            moved = column.displacement(z, time)
            out = np.zeros_like(x)
            out[:, up] = moved - column.settlement(time) if piston else -moved
            return out

        return u, lambda x: column.pressure(x[:, up] if piston else h - x[:, up], time)

    return Case(model, parameters(column.medium), exact)


class Plate:
    """The settlement of Mandel's plate per cm, as a profile of prescribed values."""

    def __init__(self, block):
        self.block = block

    def __call__(self, times):
        return np.array([self.block.plate(t) if t > 0 else 0.0 for t in np.atleast_1d(times)])


def mandel(name, order, n, plate, block=BLOCK, remedy="none"):
    """A quarter of the block; its plate moves as the formula says ("given") or as its force makes it ("tied")."""
    mesh = box((block.half_width, block.half_height), (n, n))
    on = put(name, mesh, order)
    held = {"x-": (0,), "y-": (1,)} | ({"y+": (1,)} if plate == "given" else {})
    top = on.layout.component("u", 1).start + mesh.boundary_nodes("y+", order)
    if plate == "given":
        moved = np.zeros(on.layout.n_dofs)
        moved[top] = 1.0
        cause = load(on, None, Plate(block), moved)
    else:
        cause = load(on, -block.force / block.half_width * normal_force(on, "y+"))
    model = poroelastic(on, space_of(block.medium), Conditions(held, ("x+",)), (cause,), False, remedy)

    def exact(time):
        return (lambda x: block.displacement(x[:, 0], x[:, 1], time)), (lambda x: block.pressure(x[:, 0], time))

    if plate == "given":
        return Case(model, parameters(block.medium), exact)
    rigid = tied(model, top)
    return Case(rigid.model, parameters(block.medium), exact, rigid.lift)


def octant(radius, n):
    """An eighth of a ball: a cube of Kuhn's tetrahedra drawn onto it along its rays."""
    cube = box((1.0,) * 3, (n,) * 3)
    points = cube.points
    length = np.linalg.norm(points, axis=1)
    points = radius * points * (points.max(axis=1) / np.where(length > 0, length, 1.0))[:, None]
    facets = exterior_facets(cube.cells)
    tags = np.full(len(facets), 4)
    for axis in range(3):
        tags[(cube.points[facets][:, :, axis] == 0).all(axis=1)] = axis + 1
    return Mesh(points, cube.cells, facets, tags, {"x-": 1, "y-": 2, "z-": 3, "surface": 4})


def cryer(name, order, n, ball=BALL):
    """An octant of the ball."""
    mesh = octant(ball.radius, n)
    on = put(name, mesh, order)
    conditions = Conditions({"x-": (0,), "y-": (1,), "z-": (2,)}, ("surface",))
    pressed = load(on, -ball.load * normal_force(on, "surface"))
    model = poroelastic(on, space_of(ball.medium), conditions, (pressed,), inertia=False)

    radii = np.linspace(0.0, 1.01 * ball.radius, 2001)
    radii[0] = 1e-9 * ball.radius

    def exact(time):
        # The series at 2,001 radii, between them a spline (error 1e-11): there are very many quadrature points.
        slope = CubicSpline(radii, ball.displacement(radii, time) / radii)
        pressure = CubicSpline(radii, ball.pressure(radii, time))
        return (
            lambda x: x * slope(np.linalg.norm(x, axis=1))[:, None],
            lambda x: pressure(np.linalg.norm(x, axis=1)),
        )

    return Case(model, parameters(ball.medium), exact)


def solved(case, scale, n, end=0.4, per_level=None):
    """March to `end` time scales with steps proportional to 1/n², and the errors over the last doublings."""
    history = march_graded(case, end * scale, per_level or max(2, n * n // 16), LEVELS)
    return history, errors(case, history, end * scale / 2.0 ** np.arange(4))
