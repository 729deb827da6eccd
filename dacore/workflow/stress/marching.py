"""A second, plain implementation of the forward model: Newmark's updates as they are printed, in extended precision.

It shares with dacore's own the assembled matrices and the profiles of the loads; not the elimination of
constrained dofs, the symmetrised system, the solver, the scheme's code, nor the formulas of the material.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, IntArray
from dacore.core.model import AffineModel, AffineTerm
from dacore.core.parameters import Parameters
from dacore.dynamics.newmark import Newmark
from dacore.workflow.stress.needs import mpmath
from dacore.workflow.stress.reference import Extended, Long, long


@dataclass(frozen=True, eq=False)
class March:
    """A reference trajectory.

    Parameters
    ----------
    states : (n_dofs, t) array
    condition : float
        Of the system of a step.
    shares : mapping of str to float
        For each field, how many times larger the whole scaled state is than the field's part of it: an
        error of the whole weighs so much more on the field.
    """

    states: Long
    condition: float
    shares: Mapping[str, float]


def march(model: AffineModel, parameters: Parameters, scheme: Newmark, step: float, steps: int) -> March:
    """March from rest, with what is prescribed jumping in the first step.

    Parameters
    ----------
    model : AffineModel
    parameters : mapping of str to float
    scheme : Newmark
        Only its numbers are used.
    step : float [s]
    steps : int
    """
    n = model.space.n_dofs
    tau, beta, gamma = np.longdouble(step), np.longdouble(scheme.beta), np.longdouble(scheme.gamma)
    mass, damping, stiffness = (
        _combined(terms, parameters, n) for terms in (model.second_order, model.first_order, model.zeroth_order)
    )
    euler = scheme.first_order == "backward_euler"
    rate_factor = 1 / tau if euler else gamma / (beta * tau)
    system = csr_array(mass / (beta * tau**2) + rate_factor * damping + stiffness)
    free, held = np.flatnonzero(~model.constrained), np.flatnonzero(model.constrained)
    solver = Extended(system[free][:, free])
    lift = system[free][:, held]
    amplitudes = long(model.amplitudes(parameters))
    forces = long(np.stack([load.force for load in model.loads], axis=1))
    values = long(np.stack([load.prescribed for load in model.loads], axis=1))
    profiles = long(np.stack([load.profile(step * np.arange(1.0, steps + 1)) for load in model.loads]))
    y, v, a = (np.zeros(n, dtype=np.longdouble) for _ in range(3))
    states = np.empty((n, steps), dtype=np.longdouble)
    for k in range(steps):
        weights = amplitudes * profiles[:, k]
        # ÿ₁ = (y₁ − y₀ − τẏ₀)/(βτ²) − (1 − 2β)/(2β) ÿ₀: the part known before the step.
        known_a = -(y + tau * v) / (beta * tau**2) - (1 - 2 * beta) / (2 * beta) * a
        known_v = -y / tau if euler else v + tau * ((1 - gamma) * a + gamma * known_a)
        right = forces @ weights - mass @ known_a - damping @ known_v
        new = values @ weights
        new[free] = solver.solve(right[free] - lift @ new[held])
        old_a, a = a, new / (beta * tau**2) + known_a
        v = v + tau * ((1 - gamma) * old_a + gamma * a)
        y = new
        states[:, k] = y
    return March(states, solver.condition, _shares(model, states, free, solver.columns))


def _shares(model: AffineModel, states: Long, free: IntArray, columns: Array) -> dict[str, float]:
    scaled = np.zeros(states.shape, dtype=np.float64)
    scaled[free] = states[free] / columns[:, None]
    whole = float(np.linalg.norm(scaled))
    layout = model.space.layout
    parts = {each.name: float(np.linalg.norm(scaled[layout.block(each.name)])) for each in layout.fields}
    return {name: whole / part if part else float("inf") for name, part in parts.items()}


def _combined(terms: tuple[AffineTerm, ...], parameters: Parameters, n: int) -> csr_array:
    total = csr_array((n, n), dtype=np.longdouble)
    for term in terms:
        total = total + csr_array(term.matrix, dtype=np.longdouble) * coefficient(term, parameters)
    return csr_array(total)


def coefficient(term: AffineTerm, parameters: Parameters) -> np.longdouble:
    """Coefficient of a term from the textbook's formula in 40 digits; from the term itself if its name is unknown."""
    if term.name not in _FORMULAS:
        return np.longdouble(term.coefficient(parameters))
    mp = mpmath()
    with mp.workdps(40):
        value = _FORMULAS[term.name]({name: mp.mpf(each) for name, each in parameters.items()})
        return np.longdouble(mp.nstr(mp.mpf(value), 25))


# Biot's theory in terms of E, ν, α and Skempton's B (Detournay and Cheng 1993).
_FORMULAS: dict[str, Callable[[Mapping[str, float]], float]] = {
    "inertia": lambda q: q["density"],
    "storage": lambda q: (
        3 * q["alpha"] * (1 - q["alpha"] * q["skempton"]) * (1 - 2 * q["nu"]) / (q["skempton"] * q["E"])
    ),
    "swelling": lambda q: q["alpha"],
    "shear": lambda q: q["E"] / (1 + q["nu"]),
    "dilation": lambda q: q["E"] * q["nu"] / ((1 + q["nu"]) * (1 - 2 * q["nu"])),
    "pressure gradient": lambda q: q["alpha"],
    "seepage": lambda q: q["kappa"] / q["viscosity"],
}
