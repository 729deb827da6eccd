"""Waves in bars, a shaken column, and bodies that are loaded before anything seeps, put on meshes."""

from dataclasses import replace

import numpy as np

from dacore.core.model import combine
from dacore_biot.analytic import Column, Medium, Pulse, SunkColumn, Wave, drained, undrained
from dacore_biot.conditions import Conditions, body_force, normal_force, poroelastic, surface_force
from tests.verification.setting import Case, box, load, parameters, put, space_of

MEDIUM = Medium()
TIGHT = Medium(kappa=0.0)
SHAKEN = Column(Medium(kappa=1e-5), 60.0)
SUNK = SunkColumn(TIGHT)


def bar(undrained_bar, fixed, length=1.0):
    """A wave whose pulse is half as long as the bar."""
    medium = TIGHT if undrained_bar else MEDIUM
    speed = Wave(medium, Pulse(1.0, 1.0), length, undrained_bar).speed
    return Wave(medium, Pulse(-1e3, 0.5 * length / speed), length, undrained_bar, fixed)


def wave(name, dim, order, n, problem, remedy="none"):
    """A bar along x on rollers, pulled at x+ by a total traction; dry (p = 0 everywhere) or tight."""
    length = problem.length
    mesh = box((length,) + (2 * length / n,) * (dim - 1), (n,) + (2,) * (dim - 1))
    on = put(name, mesh, order)
    held = {f"{axis}{end}": (k,) for k, axis in enumerate("xyz"[:dim]) for end in "-+" if k}
    if problem.fixed:
        held["x-"] = (0,)
    pull = load(on, normal_force(on, "x+"), problem.pulse)
    model = poroelastic(on, space_of(problem.medium), Conditions(held), (pull,), stabilization=remedy)
    if not problem.undrained:
        dry = model.constrained.copy()
        dry[on.layout.block("p")] = True
        model = replace(model, constrained=dry)

    def exact(time):
        def u(x):
            out = np.zeros_like(x)
            out[:, 0] = problem.displacement(x[:, 0], time)
            return out

        return u, lambda x: problem.pressure(x[:, 0], time)

    return Case(model, parameters(problem.medium), exact)


def rates_of(states, step, scheme, value, rate, acceleration):
    """Rates and accelerations (n_dofs, t) that Newmark's updates give for states (n_dofs, t) after a start."""
    rates, bends = [], []
    for new in states.T:
        beta, gamma = scheme.beta, scheme.gamma
        bend = (new - value - step * rate) / (beta * step**2) - (1 - 2 * beta) / (2 * beta) * acceleration
        rate = rate + step * ((1 - gamma) * acceleration + gamma * bend)
        value, acceleration = new, bend
        rates.append(rate)
        bends.append(bend)
    return np.stack(rates, axis=1), np.stack(bends, axis=1)


class Energy:
    """Kinetic, elastic and stored energy, what the loads do and what seepage takes."""

    def __init__(self, case):
        model, n = case.model, case.model.space.n_dofs
        terms = {t.name: t for t in (*model.second_order, *model.first_order, *model.zeroth_order)}
        pick = lambda *names: combine([terms[name] for name in names], case.parameters, n)  # noqa: E731
        self.mass, self.elastic = pick("inertia"), pick("shear", "dilation")
        self.storage, self.seepage = pick("storage"), pick("seepage")

    def total(self, states, rates):
        """(t,) energies of states and rates (n_dofs, t)."""
        stiff = self.elastic + self.storage
        return 0.5 * ((rates * (self.mass @ rates)).sum(axis=0) + (states * (stiff @ states)).sum(axis=0))

    def lost(self, states, step):
        """(t − 1,) energy that seeps away between the states, by the trapezoidal rule."""
        mean = 0.5 * (states[:, 1:] + states[:, :-1])
        return step * (mean * (self.seepage @ mean)).sum(axis=0)


class Cosine:
    def __init__(self, omega):
        self.omega = omega

    def __call__(self, times):
        return np.cos(self.omega * np.asarray(times))


def _column(name, dim, order, n):
    up = dim - 1
    mesh = box((0.25,) * up + (1.0,), (max(1, n // 4),) * up + (n,))
    bottom, top = ("y-", "y+") if dim == 2 else ("z-", "z+")
    held = {f"{axis}{end}": (k,) for k, axis in enumerate("xyz"[:up]) for end in "-+"} | {bottom: (up,)}
    return put(name, mesh, order), held, top, up


def shaken(name, dim, order, n, column=SHAKEN, remedy="none"):
    """A column shaken for ever: it begins as the formula says and must go on so."""
    on, held, top, up = _column(name, dim, order, n)
    pull = load(on, column.load * normal_force(on, top), Cosine(column.omega))
    model = poroelastic(on, space_of(column.medium), Conditions(held, (top,)), (pull,), stabilization=remedy)

    def exact(time):
        turn = np.exp(1j * column.omega * time)

        def u(x):
            out = np.zeros_like(x)
            out[:, up] = (column.displacement(x[:, up]) * turn).real
            return out

        return u, lambda x: (column.pressure(x[:, up]) * turn).real

    return Case(model, parameters(column.medium), exact)


def sunk(name, dim, order, n, column=SUNK):
    """A column that feels its weight at once; no seepage, so that one step of any length is the answer."""
    on, held, _, up = _column(name, dim, order, n)
    down = np.zeros(dim)
    down[up] = -column.medium.density * column.gravity
    model = poroelastic(on, space_of(column.medium), Conditions(held), (load(on, body_force(on, down)),), inertia=False)

    def exact(_):
        def u(x):
            out = np.zeros_like(x)
            out[:, up] = column.displacement(x[:, up])
            return out

        return u, lambda x: column.pressure(x[:, up])

    return Case(model, parameters(column.medium), exact)


def squeezed(name, dim, order, n, stress, drain, medium=MEDIUM):
    """A box on three rollers under a total stress on the other sides; tight for ever, or drained all around."""
    medium = medium if drain else replace(medium, kappa=0.0)
    mesh = box((1.0, 0.8, 0.6)[:dim], (n,) * dim)
    on = put(name, mesh, order)
    held = {f"{axis}-": (k,) for k, axis in enumerate("xyz"[:dim])}
    sides = tuple(f"{axis}+" for axis in "xyz"[:dim])
    force = sum(surface_force(on, side, np.asarray(stress)[k]) for k, side in enumerate(sides))
    conditions = Conditions(held, sides if drain else ())
    model = poroelastic(on, space_of(medium), conditions, (load(on, force),), inertia=False)
    state = (drained if drain else undrained)(medium, stress)
    functions = state.displacement, lambda x: np.full(len(x), state.pressure)
    return Case(model, parameters(medium), lambda _: functions)
