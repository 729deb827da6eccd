"""Parameters at their limits, marched and compared with a plain march in extended precision."""

from dataclasses import replace
from typing import Any

import numpy as np

from dacore.core.mesh import Mesh
from dacore.core.model import AffineModel
from dacore.core.parameters import Parameters
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.newmark import Newmark
from dacore.dynamics.static import steady_state
from dacore.workflow.stress.case import CEILING, Case, Inapplicable, Outcome
from dacore.workflow.stress.context import Context
from dacore.workflow.stress.marching import March, Steps, march
from dacore.workflow.stress.needs import mpmath
from dacore.workflow.stress.reference import EPS
from dacore.workflow.stress.stepping import Plain

STEPS = 3
TOLERANCE = 1e-10
SLACK = 10.0


def compare(
    context: Context,
    model: AffineModel,
    parameters: Parameters,
    step: float | None = None,
    method: Any = None,
    tolerance: float = TOLERANCE,
    scheme: Plain | None = None,
    slack: float = SLACK,
) -> Outcome:
    """March a model with dacore and with the reference."""
    tau, rule = step or context.step, scheme or context.scheme
    own = MarchedModel(model, TimeGrid(tau, STEPS), rule, "zero", method, tolerance)
    found = context.ask(lambda: own.solve(parameters).states)
    expected = march(model, parameters, rule, tau, STEPS)
    return outcome(context, found, expected, tolerance, slack)


def outcome(context: Context, found: Any, expected: March, tolerance: float, slack: float = SLACK) -> Outcome:
    """Compare states with a reference.

    Every field may be off by `slack` times what the residuals do that the states leave, their signs drawn anew;
    residuals that are larger than the tolerance allows excuse no more than the tolerance.
    """
    layout = context.space.layout
    if not np.isfinite(found).all():
        return Outcome(np.inf, 0.0, note="NaN or infinite states")
    residuals = expected.system.residuals(found)
    # More than the tolerance and rounding allow counts as much as they do.
    allowed = min(1.0, (tolerance + residuals.floor) / residuals.relative if residuals.relative else 1.0)
    signs = context.rng(7).choice([-1.0, 1.0], residuals.left.shape)
    shaken = expected.system.solved(signs * allowed * residuals.left)
    worst = (0.0, 1.0)
    for each in layout.fields:
        block = layout.block(each.name)
        size, gap, moved = (
            float(np.linalg.norm(states[block].astype(np.float64)))
            for states in (expected.states, found - expected.states, shaken - expected.states)
        )
        error = gap / size if size else (np.inf if gap else 0.0)
        # What is held is rounded to double.
        bound = min(slack * moved / size + EPS if size else EPS, CEILING)
        worst = max(worst, (error, bound), key=lambda pair: pair[0] / pair[1])
    return Outcome(*worst, note=f"residual {residuals.relative:.0e}, condition of a step {expected.condition:.0e}")


def _with(**changes: float) -> Any:
    return lambda context: compare(context, context.model, context.parameters(**changes))


def _residual(tolerance: float = TOLERANCE, **changes: float) -> Any:
    """Ask whether the states solve their equations, where no state can be held against another any more."""

    def run(context: Context) -> Outcome:
        values = context.parameters(**changes)
        own = MarchedModel(context.model, TimeGrid(context.step, STEPS), context.scheme, "zero", None, tolerance)
        found = context.ask(lambda: own.solve(values).states)
        system = Steps(context.model, values, context.scheme, context.step, STEPS)
        left = system.residuals(found)
        note = f"residual against {tolerance:.0e} asked for; rounding leaves up to {left.floor:.0e}"
        # Schemes that solve for a moment within the step have another right side there, of about the same size.
        return Outcome(left.relative, 3.0 * (tolerance + left.floor), note=f"{note}, condition {system.condition:.0e}")

    return run


def _step(factor: float) -> Any:
    return lambda context: compare(context, context.model, context.parameters(), context.step * factor)


def _units(context: Context) -> Outcome:
    """The same body in SI: mesh in m, parameters in Pa, m², kg/m³, Pa s. Every unit is converted by pint."""
    import pint

    registry: Any = pint.UnitRegistry()

    def factor(unit: str) -> float:
        return 1.0 if unit == "1" else float(registry.Quantity(1.0, unit).to_base_units().magnitude)

    mesh = context.mesh
    scaled = Mesh(0.01 * mesh.points, mesh.cells, mesh.facets, mesh.facet_tags, mesh.roles)
    model = context.affine(context.builder.physics, scaled)
    values = context.parameters()
    si = {p.name: values[p.name] * factor(p.unit) for p in context.session.parameters.parameters}
    own = MarchedModel(model, TimeGrid(context.step, STEPS), context.scheme)
    found = context.ask(lambda: own.solve(si).states)
    layout = context.space.layout
    for each in layout.fields:
        found[layout.block(each.name)] /= factor(each.unit)
    return outcome(context, found, march(context.model, values, context.scheme, context.step, STEPS), TOLERANCE)


def _released(fields: str, balanced: bool = False) -> Any:
    """Start from an equilibrium of a field that is held nowhere: there is none, or there are infinitely many."""

    def run(context: Context) -> Outcome:
        model = context.model
        layout = model.space.layout
        flow = [each for each in layout.fields if model.antisymmetric[layout.block(each.name)].any()]
        rest = [each for each in layout.fields if each not in flow]
        chosen = flow if fields == "flow" else rest
        if not chosen:
            raise Inapplicable("the model has no such field")
        constrained, force = model.constrained.copy(), np.zeros(layout.n_dofs)
        for each in chosen:
            constrained[layout.block(each.name)] = False
            rows = layout.block(each.name)
            force[rows] = 1.0  # a source, or a push, that nothing balances
            if balanced:
                force[rows] = np.where(np.arange(rows.stop - rows.start) % 2, 1.0, -1.0)
                force[rows] -= force[rows].mean()
        loads = tuple(replace(load, prescribed=load.prescribed * constrained) for load in model.loads)
        free = replace(model, constrained=constrained, loads=(replace(loads[0], force=force), *loads[1:]))
        weights = np.eye(len(loads))[:, :1]
        found = context.ask(lambda: steady_state(free, context.parameters(), weights))
        # There is no equilibrium, or no single one: whatever came out is wrong.
        return Outcome(np.inf, 0.0, note=f"largest value {np.abs(found).max():.1e}")

    return run


def _newmark(beta: float, gamma: float) -> Any:
    """March with a member of Newmark's family; stable only if oscillators of all frequencies are."""

    def run(context: Context) -> Outcome:
        scheme = context.ask(lambda: Newmark(beta, gamma, "newmark"))
        excess = _growth(beta, gamma) - 1.0
        if excess > 1e-12:
            return Outcome(excess, 1e-12, note=f"grows by {1 + excess:.6g} a step")
        return compare(context, context.model, context.parameters(), scheme=scheme)

    return run


def _growth(beta: float, gamma: float) -> float:
    """Largest spectral radius over oscillators ẍ + ω²x = 0, in 40 digits, from the printed updates."""
    mp = mpmath()
    with mp.workdps(40):
        b, g = mp.mpf(beta), mp.mpf(gamma)
        worst = mp.mpf(0)
        for exponent in range(-12, 13):
            o = mp.mpf(10) ** exponent  # (ωτ)²
            # x₁ = (x₀ + τẋ₀ + (1/2 − β)τ²ẍ₀)/(1 + βΩ), with ẍ = −ω²x, in the unknowns x and τẋ.
            x = [(1 - (mp.mpf(1) / 2 - b) * o) / (1 + b * o), 1 / (1 + b * o)]
            v = [-((1 - g) * o + g * o * x[0]), 1 - g * o * x[1]]
            half, det = (x[0] + v[1]) / 2, x[0] * v[1] - x[1] * v[0]
            root = mp.sqrt(mp.mpc(half**2 - det))
            worst = max(worst, abs(half + root), abs(half - root))
        return float(worst)


def _limit(name: str, stressed: str, hard: str, **changes: float) -> Case:
    return Case(name, "physics", stressed, hard, _with(**changes))


_LAME = "λ grows like 1/(1 − 2ν), which the subtraction must not spoil, and stiffens the system"
_FLOOR = "rounding the answer alone leaves a residual, which grows like λ"

CASES = (
    _limit("nu = 0.49", "ν = 0.49", _LAME, nu=0.49),
    _limit("nu = 0.4999", "ν = 0.4999", _LAME, nu=0.4999),
    _limit("nu = 0.499999", "ν = 0.499999", _LAME, nu=0.499999),
    _limit("nu = 1/2 - 1e-8", "ν = 1/2 − 1e-8", _LAME, nu=0.5 - 1e-8),
    Case("nu = 1/2 - 1e-12, residual", "physics", "ν = 1/2 − 1e-12", _FLOOR, _residual(nu=0.5 - 1e-12)),
    Case(
        "nu = 1/2 - 1e-12, tolerance 1e-13",
        "physics",
        "ν = 1/2 − 1e-12, a tolerance below what rounding leaves",
        _FLOOR,
        _residual(1e-13, nu=0.5 - 1e-12),
    ),
    _limit("nu = 0.5", "ν = 1/2 itself", "λ is infinite", nu=0.5),
    _limit("kappa = 1e-12", "κ = 1e-12 cm²", "the pressure block all but vanishes", kappa=1e-12),
    _limit("kappa = 1e-16", "κ = 1e-16 cm²", "the pressure block all but vanishes", kappa=1e-16),
    _limit("storage near zero", "B = 1 − 1e-12, α = 1", "1 − αB cancels", alpha=1.0, skempton=1 - 1e-12),
    _limit("no storage", "B = 1, α = 1", "S = 0: the flow has no mass", alpha=1.0, skempton=1.0),
    _limit(
        "no storage, no permeability",
        "B = 1, α = 1, κ = 0",
        "nothing determines the pressure",
        alpha=1.0,
        skempton=1.0,
        kappa=0.0,
    ),
    _limit("E = 1e2", "E = 1e2 dyn/cm²", "three decades below the range: inertia rules", E=1e2),
    _limit("E = 1e8", "E = 1e8 dyn/cm²", "two decades above the range: stiffness rules", E=1e8),
    _limit("E = NaN", "E = NaN", "NaN passes comparisons unnoticed", E=float("nan")),
    Case("time step x 1e-9", "physics", "τ a billionth of the scene's", "1/(βτ²) dwarfs stiffness", _step(1e-9)),
    Case("time step x 1e6", "physics", "τ a million times the scene's", "no inertia helps the solver", _step(1e6)),
    Case("SI units", "physics", "the whole scene in m, Pa, kg", "entries shift by 4 to 10 decades", _units),
    Case(
        "steady start, free pressure",
        "physics",
        "an equilibrium with p held nowhere and a source",
        "the flow at rest is singular",
        _released("flow"),
    ),
    Case(
        "steady start, undetermined pressure",
        "physics",
        "the same with sources that balance",
        "a constant may be added: many solutions, residuals of zero",
        _released("flow", balanced=True),
    ),
    Case(
        "steady start, free body",
        "physics",
        "an equilibrium with u held nowhere and a push",
        "rigid motions cost nothing",
        _released("rest"),
    ),
    Case(
        "Newmark beta = 1/4, gamma = 1",
        "physics",
        "a scheme that the paper allows",
        "it grows by 4.2 a step at high frequencies",
        _newmark(0.25, 1.0),
    ),
    Case(
        "Newmark beta = 1/2 - 1e-9, gamma = 1",
        "physics",
        "just outside 2β ≥ γ",
        "it looks stable for thousands of steps",
        _newmark(0.5 - 1e-9, 1.0),
    ),
    Case(
        "Newmark beta = 1/4, gamma = 1/2",
        "physics",
        "on the border of stability",
        "a double root on the unit circle at infinite frequency",
        _newmark(0.25, 0.5),
    ),
)
