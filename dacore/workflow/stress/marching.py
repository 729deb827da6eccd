"""A second, plain implementation of the forward model: the schemes' updates as they are printed, in extended precision.

It shares with dacore's own the assembled matrices and the profiles of the loads; not the elimination of
constrained dofs, the symmetrised system, the solver, the schemes' code, nor the formulas of the material.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.core.model import AffineModel, AffineTerm
from dacore.core.parameters import Parameters
from dacore.workflow.stress.needs import mpmath
from dacore.workflow.stress.reference import EPS, Extended, Long, long
from dacore.workflow.stress.stepping import Factors, Known, Plain, stepping


@dataclass(frozen=True, eq=False)
class March:
    """A reference trajectory.

    Parameters
    ----------
    states : (n_dofs, t) array
    condition : float
        Of the worst system of a step.
    system : Steps
        The equations of the steps.
    """

    states: Long
    condition: float
    system: "Steps"


def march(model: AffineModel, parameters: Parameters, scheme: Plain, step: float, steps: int) -> March:
    """March from rest, with what is prescribed jumping in the first step unless it rises from zero.

    Parameters
    ----------
    model : AffineModel
    parameters : mapping of str to float
    scheme : Newmark or GeneralizedAlpha
        Only its numbers are used.
    step : float [s]
    steps : int
    """
    system = Steps(model, parameters, scheme, step, steps)
    states = system.solved()
    return March(states, system.condition, system)


@dataclass(frozen=True, eq=False)
class Residuals:
    """What given states leave in the equations of the steps.

    Relative numbers are in the norm of dacore's tolerance: rows scaled by D, which makes the diagonals of A and
    of C + B diag(A)⁻¹ Bᵀ one.

    Parameters
    ----------
    left : (free dofs, t) array
    relative : float
        The largest of ‖D(b − K x)‖ / ‖D b‖.
    floor : float
        The largest of ε ‖D |K| |x|‖ / ‖D b‖: what rounding x to double leaves of it.
    """

    left: Array
    relative: float
    floor: float


class Steps:
    """The equations of every step, from the states before it."""

    def __init__(self, model: AffineModel, parameters: Parameters, scheme: Plain, step: float, steps: int) -> None:
        n = model.space.n_dofs
        self._terms = tuple(
            _combined(terms, parameters, n) for terms in (model.second_order, model.first_order, model.zeroth_order)
        )
        self._free, self._held = np.flatnonzero(~model.constrained), np.flatnonzero(model.constrained)
        times: Array = np.asarray(step * np.arange(steps + 1), dtype=np.float64)
        profiles = long(np.stack([load.profile(times) for load in model.loads]))
        weights = long(model.amplitudes(parameters))[:, None] * profiles
        self._forces = long(np.stack([load.force for load in model.loads], axis=1)) @ weights
        self._values = long(np.stack([load.prescribed for load in model.loads], axis=1)) @ weights
        self._stepping = stepping(scheme, np.longdouble(step), jump=bool((profiles[:, 0] != 0).any()))
        self._steps = steps
        self._flow = model.antisymmetric
        # Steps alike share a factorisation.
        self._factored = cache(self._factorise)
        self.condition = 0.0

    def solved(self, residuals: Array | None = None) -> Long:
        """States (n_dofs, t) that leave given residuals (free dofs, t) in the steps; none by default."""

        def choose(system: _System, target: Long, k: int) -> Long:
            return system.solver.solve(target if residuals is None else target - long(residuals[:, k]))

        return self._walk(choose)

    def residuals(self, found: Array) -> Residuals:
        """What states (n_dofs, t) leave in the steps, each starting from the states before it."""
        left = np.zeros((len(self._free), self._steps))
        relative, floor = np.zeros(self._steps), np.zeros(self._steps)

        def choose(system: _System, target: Long, k: int) -> Long:
            mine = long(found[self._free, k])
            left[:, k] = np.asarray(target - system.matrix @ mine, dtype=np.float64)
            size = np.linalg.norm(np.asarray(system.scale * target, dtype=np.float64))
            gap = np.linalg.norm(system.scale * left[:, k])
            relative[k] = gap / size if size else float(gap > 0)
            rounded = np.linalg.norm(system.scale * (system.sizes @ np.abs(found[self._free, k])))
            floor[k] = EPS * rounded / size if size else 0.0
            return mine

        self._walk(choose)
        return Residuals(left, float(relative.max()), float(floor.max()))

    def _walk(self, choose: "Callable[[_System, Long, int], Long]") -> Long:
        n = len(self._forces)
        known = Known(*(np.zeros(n, dtype=np.longdouble) for _ in range(4)))
        states = np.empty((n, self._steps), dtype=np.longdouble)
        mass, damping, stiffness = self._terms
        for k in range(self._steps):
            factors = self._stepping.factors(k)
            system = self._factored(factors)
            w = factors.weight
            # Everything but y₁ in M ÿ_* + C ẏ_* + A y_* = F_*.
            right = (1 - w) * self._forces[:, k] + w * self._forces[:, k + 1]
            history = self._stepping.history(known, k)
            right = right - mass @ history.acceleration - damping @ history.rate - stiffness @ history.value
            new = self._values[:, k + 1].copy()
            new[self._free] = choose(system, right[self._free] - system.lift @ new[self._held], k)
            known = self._stepping.advance(known, new, k)
            states[:, k] = new
        return states

    def _factorise(self, factors: Factors) -> "_System":
        mass, damping, stiffness = self._terms
        rows = csr_array(factors.mass * mass + factors.rate * damping + factors.weight * stiffness)[self._free]
        matrix = csr_array(rows[:, self._free])
        solver = Extended(matrix)
        self.condition = max(self.condition, solver.condition)
        # The flow's rows are divided by the rate's factor, as they are where the system is symmetric.
        flow = self._flow[self._free]
        double = csr_array(matrix, dtype=np.float64)
        scale = _scales(double, flow, float(factors.rate))
        return _System(matrix, abs(double), solver, csr_array(rows[:, self._held]), scale)


@dataclass(frozen=True, eq=False)
class _System:
    """One step's matrix on the free dofs, sizes of its entries, its solver, what multiplies held dofs, rows' scale."""

    matrix: Sparse
    sizes: Sparse
    solver: Extended
    lift: Sparse
    scale: Array


def _scales(matrix: Sparse, flow: BoolArray, rate: float) -> Array:
    diagonal = np.abs(matrix.diagonal())
    diagonal[flow] /= rate
    if flow.any() and not flow.all():
        coupling = csr_array(matrix[flow][:, ~flow]) / rate
        diagonal[flow] += np.asarray((coupling**2) @ (1.0 / diagonal[~flow])).ravel()
    return np.asarray(np.where(flow, 1.0 / rate, 1.0) / np.sqrt(diagonal))


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
