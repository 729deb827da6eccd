"""Every problem with its meshes, its times and what is expected of it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import State
from tests.verification.consolidation import BALL, BLOCK, COLUMN, cryer, mandel, terzaghi
from tests.verification.motion import MEDIUM, SHAKEN, bar, shaken, squeezed, sunk, wave
from tests.verification.norms import rates
from tests.verification.setting import EULER, SECOND_ORDER, History, errors, march_graded, march_smooth

LINEAR = {"u": 2, "grad u": 1, "p": 2, "grad p": 1}
TAYLOR_HOOD = {"u": 2, "grad u": 2, "p": 2, "grad p": 1}
"""With p of order 1 its own error, of order 2, limits u in L² too."""


@dataclass(frozen=True)
class Problem:
    """Meshes of a problem and what must come out.

    `make(backend, n)` gives a case with n cells along a side, `solve(case, n)` its errors. `orders` are the
    expected rates between the last two of `sizes`, each within `slack`; `caps` bound u and p on the last.
    """

    label: str
    elements: str
    make: Callable
    solve: Callable
    sizes: tuple
    fine: tuple
    orders: dict
    caps: dict
    slack: dict = field(default_factory=dict)
    blind: tuple = ()
    """Mistakes of `setting.SPOILT` that this problem cannot see."""

    @property
    def probe(self):
        """The two coarsest meshes: enough to notice a mistake."""
        return self.sizes[:2]

    def cases(self, name, sizes=None):
        """A case for each mesh, smallest first."""
        return [(n, self.make(name, n)) for n in sizes or self.sizes]

    def study(self, name, sizes=None):
        """Errors on each mesh."""
        return [self.solve(case, n) for n, case in self.cases(name, sizes)]

    def check(self, found, sizes=None):
        """AssertionError unless the errors are as expected."""
        sizes = sizes or self.sizes
        for quantity, order in self.orders.items():
            seen = rates(sizes, [row[quantity] for row in found])
            slack = self.slack.get(quantity, 0.2)
            assert abs(seen[-1] - order) < slack, f"{quantity}: rates {seen}, expected {order} +- {slack}"
        for quantity, cap in self.caps.items():
            limit = cap * (self.sizes[-1] / sizes[-1]) ** self.orders.get(quantity, 0)
            assert found[-1][quantity] < limit, f"{quantity}: error {found[-1][quantity]:.2e}, expected < {limit:.2e}"


def smooth(scale, begin, end, steps=1):
    """March from the exact state of one time to another with `steps` steps a cell."""

    def solve(case, n):
        history = march_smooth(case, begin * scale, end * scale, int(np.ceil(steps * n * end)) + n)
        return errors(case, history, [end * scale])

    return solve


def from_rest(duration, steps):
    """March from rest, `steps` of second order a cell."""

    def solve(case, n):
        count = int(np.ceil(steps * n))
        marched = MarchedModel(case.model, TimeGrid(duration / count, count), SECOND_ORDER)
        still = State.at_rest(np.zeros((case.model.space.n_dofs, 1)))
        found = marched.march(case.parameters, still)
        return errors(case, History(found.times, found.states), [duration])

    return solve


def at_once(case, _):
    """One step from rest: without seepage and inertia its length has no influence."""
    marched = MarchedModel(case.model, TimeGrid(1.0, 1), EULER)
    found = marched.march(case.parameters, State.at_rest(np.zeros((case.model.space.n_dofs, 1))))
    return errors(case, History(found.times, found.states), [1.0])


def in_the_end(case, _):
    """Long after the load came on."""
    return errors(case, march_graded(case, 1e4, 2, 3), [1e4])


NO_INERTIA = ("density 5% high",)
NO_FREE_WALL = ("no pressure on the boundary",)
"""Where p is zero or the normal displacement held on every side, the pressure presses nowhere."""


def _orders(order):
    return LINEAR if order == 1 else TAYLOR_HOOD


def _elements(order, remedy="none"):
    return f"P{order}–P1" + ("" if remedy == "none" else f", {remedy}")


def _terzaghi(dim, order, piston, sizes, fine, u, p):
    return Problem(
        f"Terzaghi {dim}-D, {'load on a tight piston' if piston else 'load on the drained end'}",
        f"P{order}–P1",
        lambda name, n: terzaghi(name, dim, order, n, piston),
        smooth(COLUMN.time_scale, 0.1, 0.4),
        sizes,
        fine,
        _orders(order),
        {"u": u, "p": p},
        blind=NO_INERTIA if piston else NO_INERTIA + NO_FREE_WALL,
    )


def _mandel(order, plate, sizes, fine, u, p, remedy="none"):
    return Problem(
        f"Mandel, plate {'moved as the formula says' if plate == 'given' else 'rigid under its force'}",
        _elements(order, remedy),
        lambda name, n: mandel(name, order, n, plate, remedy=remedy),
        smooth(BLOCK.time_scale, 0.1, 0.4),
        sizes,
        fine,
        _orders(order),
        {"u": u, "p": p},
        blind=NO_INERTIA + NO_FREE_WALL if plate == "given" else NO_INERTIA,
    )


def _cryer(order, sizes, fine, u, p):
    return Problem(
        "Cryer, an octant",
        f"P{order}–P1",
        lambda name, n: cryer(name, order, n),
        smooth(BALL.time_scale, 0.05, 0.15),
        sizes,
        fine,
        _orders(order),
        {"u": u, "p": p},
        # On a coarse ball the strain and pressure gradients still fall faster than they will in the end.
        {"u": 0.35, "p": 0.35, "grad u": 0.45, "grad p": 0.45},
        NO_INERTIA + NO_FREE_WALL,
    )


def _wave(undrained_bar, fixed, dim, order, sizes, fine, u, p):
    problem = bar(undrained_bar, fixed)
    quantities = ("u", "grad u", "p") if undrained_bar else ("u", "grad u")
    caps = {"u": u} | ({"p": p} if undrained_bar else {})
    unseen = ("permeability 5% high",)
    return Problem(
        f"{'Tight' if undrained_bar else 'Dry'} bar {dim}-D, {'fixed' if fixed else 'free'} end",
        f"P{order}–P1",
        lambda name, n: wave(name, dim, order, n, problem),
        from_rest(2.6 * problem.length / problem.speed, 2.6 * 2 * order),
        sizes,
        fine,
        {name: _orders(order)[name] for name in quantities},
        caps,
        # The front is not yet resolved where a quick test can afford it: `make verify` goes on.
        {"u": 0.3, "grad u": 0.45, "p": 0.65 if order == 1 else 0.4},
        unseen if undrained_bar else (*unseen, "alpha 5% high", "storage 5% high", *NO_FREE_WALL),
    )


def _shaken(dim, order, sizes, fine, u, p, remedy="none"):
    period = 1 / SHAKEN.frequency
    return Problem(
        f"Shaken column {dim}-D",
        _elements(order, remedy),
        lambda name, n: shaken(name, dim, order, n, remedy=remedy),
        smooth(period, 1.0, 1.9, 2),
        sizes,
        fine,
        _orders(order),
        {"u": u, "p": p},
        # What is lumped is a storage of order h², which coarse meshes feel in ∇u.
        {"grad u": 0.25},
        NO_FREE_WALL,
    )


def _sunk(order, sizes, fine):
    # Without seepage nothing smooths the pressure: at a free end of a P1–P1 column it is of order 3/2 only.
    linear = {"u": 2, "grad u": 1, "p": 1.5}
    return Problem(
        "Column under its own weight, undrained",
        f"P{order}–P1",
        lambda name, n: sunk(name, 2, order, n),
        at_once,
        sizes,
        fine,
        linear if order == 1 else {},
        {"u": 1.2e-3, "p": 6e-3} if order == 1 else {"u": 1e-10, "p": 1e-10},
        blind=(*NO_INERTIA, "permeability 5% high"),
    )


def _squeezed(dim, order, drain):
    # Without shear stresses, which the rollers would have to take.
    stress = np.diag([1e3, -2e3, 5e2][:dim])
    return Problem(
        f"Box {dim}-D under a uniform stress, {'in the end' if drain else 'undrained'}",
        f"P{order}–P1",
        lambda name, n: squeezed(name, dim, order, n, stress, drain, MEDIUM),
        in_the_end if drain else at_once,
        (2, 3),
        (3, 4),
        {},
        {"u": 1e-9} if drain else {"u": 1e-9, "p": 1e-9},
        blind=(
            *NO_INERTIA,
            "permeability 5% high",
            *(("alpha 5% high", "storage 5% high", *NO_FREE_WALL) if drain else ()),
        ),
    )


PROBLEMS = {
    "terzaghi 2-D P1": _terzaghi(2, 1, False, (8, 16, 32), (16, 32, 64), 1.5e-4, 6e-4),
    "terzaghi 2-D P2": _terzaghi(2, 2, False, (4, 8, 16), (8, 16, 32), 3e-4, 2e-3),
    "terzaghi 3-D P1": _terzaghi(3, 1, True, (4, 8, 16), (8, 16, 32), 6e-4, 2.5e-3),
    "terzaghi 3-D P2": _terzaghi(3, 2, True, (4, 8), (4, 8, 16), 1.2e-3, 8e-3),
    "mandel given P1": _mandel(1, "given", (8, 16, 32), (16, 32, 64), 9e-5, 5e-4),
    "mandel given P2": _mandel(2, "given", (4, 8, 16), (8, 16, 32), 2e-4, 2e-3),
    "mandel tied P1": _mandel(1, "tied", (8, 16, 32), (16, 32, 64), 9e-5, 5e-4),
    "mandel tied P2": _mandel(2, "tied", (4, 8, 16), (8, 16, 32), 2e-4, 2e-3),
    "cryer P1": _cryer(1, (4, 8), (6, 12, 18), 8e-3, 3e-2),
    "cryer P2": _cryer(2, (3, 6), (4, 8, 12), 8e-3, 4e-2),
    "dry wave P1": _wave(False, True, 2, 1, (32, 64), (64, 128, 256), 1e-2, 0),
    "dry wave P2": _wave(False, False, 2, 2, (16, 32), (32, 64, 128), 1e-2, 0),
    "tight wave P1": _wave(True, True, 2, 1, (32, 64), (64, 128, 256), 2.5e-3, 1e-2),
    "tight wave P2": _wave(True, True, 2, 2, (16, 32), (32, 64, 128), 4e-2, 1e-1),
    "shaken P1": _shaken(2, 1, (8, 16), (16, 32, 64), 3e-3, 3e-3),
    "shaken P2": _shaken(2, 2, (8, 16), (8, 16, 32), 2e-3, 2e-3),
    "mandel lumped P1": _mandel(1, "tied", (8, 16), (16, 32, 64), 2e-4, 8e-4, "lumped"),
    "mandel projected P1": _mandel(1, "tied", (8, 16), (16, 32, 64), 3e-4, 1.6e-3, "projected"),
    "mandel lumped P2": _mandel(2, "tied", (4, 8), (8, 16, 32), 2e-4, 3.2e-3, "lumped"),
    "shaken lumped P1": _shaken(2, 1, (8, 16), (16, 32, 64), 5e-3, 1e-3, "lumped"),
    "shaken projected P1": _shaken(2, 1, (8, 16), (16, 32, 64), 2e-3, 2e-3, "projected"),
    "sunk P1": _sunk(1, (8, 16), (16, 32, 64)),
    "sunk P2": _sunk(2, (4, 8), (8, 16)),
    "undrained 2-D P1": _squeezed(2, 1, False),
    "undrained 3-D P1": _squeezed(3, 1, False),
    "undrained 3-D P2": _squeezed(3, 2, False),
    "drained 2-D P2": _squeezed(2, 2, True),
    "drained 3-D P1": _squeezed(3, 1, True),
}
