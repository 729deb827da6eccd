"""What the problems have in common: a case to solve, marching it from a sudden start, its errors, and spoiling it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from dacore.core.model import AffineModel, Load
from dacore.core.timegrid import TimeGrid
from dacore.domains.box import Box
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark, State
from dacore.dynamics.profiles import Constant
from dacore_biot.conditions import fixed_parameters
from dacore_biot.operators import biot_fields
from tests.backends import backend
from tests.verification.norms import sizes_and_errors

EULER = Newmark(0.5, 1.0, "backward_euler")
SECOND_ORDER = Newmark(0.25, 0.5, "newmark")
ALPHA = ("swelling", "pressure gradient", "pressure on the boundary")
SPOILT = {
    "alpha 5% high": dict.fromkeys(ALPHA, 1.05),
    "storage 5% high": {"storage": 1.05},
    "permeability 5% high": {"seepage": 1.05},
    "shear modulus 5% high": {"shear": 1.05},
    "Lamé's modulus 5% high": {"dilation": 1.05},
    "density 5% high": {"inertia": 1.05},
    "no pressure on the boundary": {"pressure on the boundary": 0.0},
}
"""Mistakes a model could have: factors of its terms."""


@dataclass(frozen=True, eq=False)
class Case:
    """A model of a problem and the solution by formula.

    `exact(time)` gives two functions of points (n, d): u (n, d) and p (n,).
    """

    model: AffineModel
    parameters: dict
    exact: Callable
    lift: object = None

    def spoilt(self, factors):
        def scaled(terms):
            return tuple(
                replace(t, coefficient=lambda theta, t=t: factors.get(t.name, 1.0) * t.coefficient(theta))
                for t in terms
            )

        m = self.model
        changed = replace(
            m,
            second_order=scaled(m.second_order),
            first_order=scaled(m.first_order),
            zeroth_order=scaled(m.zeroth_order),
        )
        return replace(self, model=changed)


@dataclass(frozen=True, eq=False)
class History:
    times: np.ndarray
    states: np.ndarray

    def at(self, time):
        k = int(np.argmin(np.abs(self.times - time)))
        assert abs(self.times[k] - time) < 1e-9 * time
        return self.states[:, k]


def put(name, mesh, order):
    return backend(name).discretize(mesh, biot_fields(mesh.dim, order))


def box(upper, divisions):
    """A box from the origin with a role for each side."""
    sides = Box((0.0,) * len(upper), upper, divisions).sides
    return Box((0.0,) * len(upper), upper, divisions, {side: (side,) for side in sides}).mesh()


def parameters(medium):
    return dict(medium.parameters) | {"one": 1.0}


def space_of(medium):
    return fixed_parameters(parameters(medium))


def load(discretization, force, profile=None, prescribed=None):
    none = np.zeros(discretization.layout.n_dofs)
    given = (none if part is None else part for part in (force, prescribed))
    return Load("load", itemgetter("one"), profile or Constant(), *given)


class Shifted:
    """A profile that a march from a later time sees from its own zero on."""

    def __init__(self, profile, start):
        self.profile, self.start = profile, start

    def __call__(self, times):
        return self.profile(np.asarray(times) + self.start)


def march_graded(case, duration, per_level, levels):
    """Backward Euler from a sudden start at rest, in steps that double: `per_level` up to duration/2^levels, and to
    each doubling of that time. A quasi-static model remembers nothing but its last state, so that pieces of
    equal steps can be put together."""
    ends = duration / 2.0 ** np.arange(levels, -1, -1)
    begin, value = 0.0, np.zeros((case.model.space.n_dofs, 1))
    times, states = [], []
    for end in ends:
        loads = tuple(replace(one, profile=Shifted(one.profile, begin)) for one in case.model.loads)
        grid = TimeGrid((end - begin) / per_level, per_level)
        piece = MarchedModel(replace(case.model, loads=loads), grid, EULER)
        found = piece.march(case.parameters, State.at_rest(value))
        times.append(begin + found.times)
        states.append(found.states)
        begin, value = end, found.states[:, -1:]
    every = np.concatenate(states, axis=1)
    return History(np.concatenate(times), every if case.lift is None else case.lift @ every)


def errors(case, history, times):
    """Relative errors of u, grad u, p and grad p over several times together; none of what is zero."""
    total = {}
    for time in times:
        for name, pair in sizes_and_errors(case.model.space, history.at(time), *case.exact(time)).items():
            total[name] = np.asarray(pair) ** 2 + total.get(name, 0.0)
    return {name: float(np.sqrt(error / size)) for name, (error, size) in total.items() if size > 0}


def interpolated(case, time):
    """The exact state at the nodes (n_dofs,), the tied dofs but the first left out."""
    space, (u, p) = case.model.space, case.exact(time)
    mesh, layout = space.discretization.mesh, space.layout
    moved = u(mesh.nodes(layout.field("u").order))
    out = np.concatenate([moved.T.ravel(), p(mesh.points)])
    if case.lift is not None:
        out[np.setdiff1d(np.arange(layout.n_dofs), case.lift.indices)] = 0.0
    return out


def march_smooth(case, begin, end, steps, scheme=SECOND_ORDER):
    """From the exact state at a time when it is smooth, with a scheme of second order: leaves the error in space."""
    loads = tuple(replace(one, profile=Shifted(one.profile, begin)) for one in case.model.loads)
    gap = 1e-3 * begin
    values = {k: interpolated(case, begin + k * gap)[:, None] for k in (-2, -1, 0, 1, 2)}
    rate = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * gap)
    bend = (16 * (values[1] + values[-1]) - (values[2] + values[-2]) - 30 * values[0]) / (12 * gap**2)
    marched = MarchedModel(replace(case.model, loads=loads), TimeGrid((end - begin) / steps, steps), scheme)
    found = marched.march(case.parameters, State(values[0], rate, bend))
    states = found.states if case.lift is None else case.lift @ found.states
    return History(begin + found.times, states)
