"""The figures of docs/verification.md: convergence, consolidation over time, and waves, from fresh computations."""

import numpy as np

from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import State
from dacore.figures.convergence import Convergence, ErrorCurve, convergence
from dacore.figures.formula import FormulaPanel, Known, against_formula
from tests.backends import READY
from tests.verification.consolidation import BALL, COLUMN, cryer, mandel, terzaghi
from tests.verification.motion import bar, wave
from tests.verification.problems import PROBLEMS
from tests.verification.setting import SECOND_ORDER, march_graded
from tests.verification.test_sudden_start import TISSUE, at_point

LEVELS = 7
TIMES = (0.01, 0.04, 0.1, 0.3)


def figures(errors):
    """Figures by name; `errors` by problem and backend as __main__ measures them."""
    return {"convergence": _convergence(errors), "consolidation": _consolidation(), "waves": _waves()}


def _convergence(errors):
    panels = []
    for title, keys in (
        ("Terzaghi", ("terzaghi 2-D P1", "terzaghi 2-D P2")),
        ("Mandel, rigid plate", ("mandel tied P1", "mandel tied P2")),
        ("Cryer", ("cryer P1", "cryer P2")),
        ("Dry bar", ("dry wave P1", "dry wave P2")),
        ("Tight bar", ("tight wave P1", "tight wave P2")),
        ("Shaken column", ("shaken P1", "shaken P2")),
    ):
        curves = []
        for key in keys:
            problem, found = PROBLEMS[key], errors[key, READY[0]]
            sizes = 1 / np.array(problem.fine, dtype=float)
            for quantity, name in (("u", "u"), ("grad u", "∇u"), ("p", "p")):
                if quantity in found[-1]:
                    values = np.array([one[quantity] for one in found])
                    curves.append(ErrorCurve(name, problem.elements, sizes, values))
        panels.append(Convergence(title, tuple(curves)))
    return convergence(panels)


def _profile(case, history, scale, axis, exact, title, x_label):
    """Pressure along a line, in units of the load's jump, at several times."""
    mesh = case.model.space.discretization.mesh
    fine = np.linspace(0, 1, 201)
    coarse = np.linspace(0, 1, 17)
    line = np.zeros((17, mesh.dim))
    line[:, axis] = np.clip(coarse, 1e-12, 1 - 1e-9)
    if axis:
        line[:, 0] = 0.1
    row = case.model.space.discretization.evaluation(line, "p")
    layout, curves = case.model.space.layout, []
    for part in TIMES:
        k = int(np.argmin(np.abs(history.times - part * scale)))
        time, state = history.times[k], history.states[:, k]
        unit = exact.initial_pressure
        depth = (1 - fine) if axis else fine
        computed = row @ state[layout.block("p")] / unit
        curves.append(Known(f"c t/a² = {time / scale:.2g}", fine, exact.pressure(depth, time) / unit, coarse, computed))
    return FormulaPanel(title, x_label, "p / p(0+)", curves)


def _rising(name, problem, make):
    """History of the pressure at the centre from the sudden start."""
    case = make(name)
    history = march_graded(case, 0.5 * problem.time_scale, 16, LEVELS)
    centre = (0.0,) * case.model.space.discretization.mesh.dim
    return history.times, at_point(case, history.states, centre)


CASES = (
    ("Mandel, plate rigid under its force", "P1–P1, 16", TISSUE, lambda name: mandel(name, 1, 16, "tied", TISSUE)),
    ("Mandel, plate rigid under its force", "P2–P1, 16", TISSUE, lambda name: mandel(name, 2, 16, "tied", TISSUE)),
    ("Cryer, an octant", "P1–P1, 6", BALL, lambda name: cryer(name, 1, 6)),
    ("Cryer, an octant", "P1–P1, 12", BALL, lambda name: cryer(name, 1, 12)),
)


def rises():
    """Rows of the table of overshoots."""
    rows = []
    for label, elements, problem, make in CASES:
        times, seen = _rising(READY[0], problem, make)
        fine = np.geomspace(1e-3, 0.5, 2000) * problem.time_scale
        exact = np.array([problem.pressure(np.zeros(1), t)[0] for t in fine]) / problem.initial_pressure
        found = seen / problem.initial_pressure
        peaks = fine[exact.argmax()] / problem.time_scale, times[found.argmax()] / problem.time_scale
        rows.append([label, elements, f"{exact.max():.4f}", f"{found.max():.4f}", *(f"{t:.3f}" for t in peaks)])
    return rows


def _consolidation():
    name = READY[0]
    column = terzaghi(name, 2, 1, 16)
    block = mandel(name, 1, 16, "tied", TISSUE)
    ball = cryer(name, 1, 12)
    marched = [
        march_graded(case, 0.5 * problem.time_scale, 25, LEVELS)
        for case, problem in ((column, COLUMN), (block, TISSUE), (ball, BALL))
    ]
    panels = [
        _profile(column, marched[0], COLUMN.time_scale, 1, COLUMN, "Terzaghi", "height / h"),
        _profile(block, marched[1], TISSUE.time_scale, 0, TISSUE, "Mandel", "x / a"),
        _profile(ball, marched[2], BALL.time_scale, 0, BALL, "Cryer", "distance / a"),
    ]
    row = column.model.space.layout.component("u", 1)
    on = column.model.space.discretization.evaluation(np.array([[0.1, 1.0]]), "u")
    at, fine = slice(None, None, 8), np.geomspace(1.5e-4, 0.5, 300)
    times = marched[0].times / COLUMN.time_scale
    known = np.array([COLUMN.settlement(t * COLUMN.time_scale) for t in fine])
    settled = Known("settlement", fine, 1e3 * known, times[at], -1e3 * (on @ marched[0].states[row])[0][at])
    panels.append(FormulaPanel("Terzaghi", "c t/h²", "u [10⁻³ cm]", [settled], log_x=True))
    for title, problem, case, history in (
        ("Mandel", TISSUE, block, marched[1]),
        ("Cryer", BALL, ball, marched[2]),
    ):
        times = history.times / problem.time_scale
        centre = (0.0,) * case.model.space.discretization.mesh.dim
        seen = at_point(case, history.states, centre) / problem.initial_pressure
        exact = np.array([problem.pressure(np.zeros(1), t * problem.time_scale)[0] for t in fine])
        curve = Known("at the centre", fine, exact / problem.initial_pressure, times[at], seen[at])
        panels.append(FormulaPanel(title, "c t/a²", "p / p(0+)", [curve], log_x=True))
    return against_formula(panels)


def _waves():
    panels, n = [], 96
    for undrained_bar, fixed, title in (
        (False, True, "Dry bar, fixed at x = 0"),
        (False, False, "Dry bar, free at x = 0"),
        (True, True, "Tight bar, fixed at x = 0"),
    ):
        problem = bar(undrained_bar, fixed)
        case = wave(READY[0], 2, 1, n, problem)
        travel = problem.length / problem.speed
        steps = 2 * n
        marched = MarchedModel(case.model, TimeGrid(2.0 * travel / steps, steps), SECOND_ORDER)
        still = State.at_rest(np.zeros((case.model.space.n_dofs, 1)))
        found = marched.march(case.parameters, still)
        fine, coarse = np.linspace(0, 1, 401), np.linspace(0, 1, 25)
        points = np.stack([np.clip(coarse, 1e-9, 1 - 1e-9), np.full(25, 0.5 / n)], axis=1)
        row = case.model.space.discretization.evaluation(points, "u")
        curves = []
        for part in (0.6, 1.0, 1.4, 1.7):
            k = int(np.argmin(np.abs(found.times - part * travel)))
            moved = row @ found.states[case.model.space.layout.component("u", 0), k]
            exact = problem.displacement(fine, found.times[k])
            curves.append(Known(f"t = {part:g} L/c", fine, 1e3 * exact, coarse, 1e3 * moved))
        panels.append(FormulaPanel(title, "x / L", "u [10⁻³ cm]", curves))
    return against_formula(panels)
