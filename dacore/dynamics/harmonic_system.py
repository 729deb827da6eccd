"""The linear system of a motion at one frequency, as the real symmetric quasi-definite systems that dacore solves.

With y(t) = Re(ŷ e^{iωt}) the equation of motion is (−ω²M + iωC + A) ŷ = F̂. The rows of a flow, multiplied by
−1/(iω) as those of a time step are by −1/(factor of C), make its matrix K = B + iD complex symmetric on the free
dofs, and D, what takes energy out of the motion, positive semidefinite: seepage, viscosity and losses of the
material. So ŷ = x + iz solves the real system of twice the size::

    [ D   B ] [x]   [Im F̂]
    [ B  −D ] [z] = [Re F̂]

which is symmetric quasi-definite wherever the motion is damped, indefinite as B is above the first resonance. It is
factorised without pivoting by what factorises a time step.

Where little damps, D is small and a factor without pivoting would lose all digits. There D is made larger, to a
hundredth of what elasticity, inertia and storage are, in the factorised system only, which then preconditions the
true one (the shifted Laplacian of Erlangga, Vuik and Oosterlee, Appl. Numer. Math. 50 (2004) 409, with damped
material in place of a damped wave number). Resonances near the frequency cost an iteration or two each; on one that
nothing damps there is no solution, and the residual says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dacore.algebra.flexible import flexible_gmres
from dacore.algebra.linear_solver import prepared, scales
from dacore.core.arrays import Array, BoolArray, IntArray, Sparse
from dacore.core.model import AffineModel, Coefficient, Load
from dacore.core.parameters import Parameters
from dacore.core.solver import SolverMethod
from dacore.dynamics.pattern import PatternSum
from dacore.dynamics.system import stack
from dacore.errors import AccuracyError, ConvergenceError, ShapeError

Complex = NDArray[np.complex128]

# The factorised system is damped so much at least, relative to elasticity, inertia and storage: a factor in single
# precision is then good for three digits or more.
LEAST_DAMPING = 1e-2
# Residual of the factorised system, each of its solves being one of the outer iteration.
_INNER = 1e-4
# Two complex vectors are kept for each.
_MOST_ITERATIONS = 80
_SYMMETRY_TOLERANCE = 1e-10
_EIGHTHS = 8


class HarmonicSystem:
    """The system of one frequency for an affine model, for any parameters.

    Parameters
    ----------
    model : AffineModel
    frequency : float [Hz]
    losses : mapping of str to callable
        For terms of zeroth order by their names: θ -> η, a factor 1 + iη of the term.

    Attributes
    ----------
    omega : float
        ω = 2πf [1/s].
    free, constrained : (n_free,), (n_dofs − n_free,) int arrays
        Dofs that are solved for, and dofs with prescribed values.
    factors : (n_loads,) complex array
        The amplitude at the frequency of each load's profile: 1 for a cosine, −i for a sine.
    scale : (n_free,) complex array
        Factors of the rows that make K symmetric.
    prescribed : (n_dofs − n_free, n_loads) array
        Values of the constrained dofs per unit of each load and of its factor.

    Raises
    ------
    ShapeError
        If a load is no oscillation of this frequency, a loss names no term of zeroth order, a flow row has mass or
        no dof is free.
    AccuracyError
        If the system is not symmetric on the free dofs.
    """

    def __init__(self, model: AffineModel, frequency: float, losses: Mapping[str, Coefficient]) -> None:
        names = [term.name for term in model.zeroth_order]
        if unknown := [name for name in losses if name not in names]:
            raise ShapeError(f"losses: got {', '.join(unknown)}, expected terms of zeroth order: {', '.join(names)}")
        for term in model.second_order:
            if term.matrix[np.flatnonzero(model.antisymmetric)].nnz:
                raise ShapeError(f"term {term.name}: antisymmetric rows have mass, expected first order in time there")
        self.frequency, self.omega = frequency, 2 * np.pi * frequency
        self.free: IntArray = np.flatnonzero(~model.constrained)
        self.constrained: IntArray = np.flatnonzero(model.constrained)
        if not self.free.size:
            raise ShapeError("model: every dof is constrained, expected at least one free dof")
        self.factors: Complex = np.array(
            [harmonic_factor(load, frequency) for load in model.loads], dtype=np.complex128
        )
        n = model.space.n_dofs
        self.prescribed = stack([load.prescribed for load in model.loads], n)[self.constrained]
        self._forces = stack([load.force for load in model.loads], n)[self.free]
        self._orders = (model.second_order, model.first_order, model.zeroth_order)
        self._losses = dict(losses)
        terms = (*model.second_order, *model.first_order, *model.zeroth_order)
        self._sum = PatternSum([term.matrix for term in terms], (n, n), self.free, (self.free, self.constrained))
        self._flow: BoolArray = model.antisymmetric[self.free]
        self.scale: Complex = np.where(self._flow, 1j / self.omega, 1.0)  # −1/(iω) = i/ω
        pattern = self._sum.combine(np.zeros(len(terms)))[0]
        flow_row = np.repeat(self._flow, np.diff(pattern.indptr))
        flow_column = self._flow[pattern.indices]
        self._among_flow, self._among_rest = flow_row & flow_column, ~flow_row & ~flow_column
        rows = np.repeat(np.arange(len(self.free)), np.diff(pattern.indptr))
        self._diagonal: IntArray = np.flatnonzero(rows == pattern.indices)
        self.definite: BoolArray = np.repeat([True, False], len(self.free))
        self.middle = model.parameters.middle
        _check_symmetry(self.at(self.middle).matrix)

    def at(self, parameters: Parameters) -> "Oscillation":
        """Return the system for one parameter vector."""
        second, first, zeroth = (np.array([t.coefficient(parameters) for t in terms]) for terms in self._orders)
        omega = self.omega
        lost = zeroth * [self._loss(term.name, parameters) for term in self._orders[2]]
        still = self._sum.combine(np.concatenate([-(omega**2) * second, 0 * first, zeroth]))
        moving = self._sum.combine(np.concatenate([0 * second, omega * first, lost]))
        free, constrained = (_complex(real, imaginary) for real, imaginary in zip(still, moving, strict=True))
        matrix, lift = self._scaled(free), self._scaled(constrained)
        own = self._sum.combine(np.concatenate([omega**2 * second, omega * first, zeroth]))[0]
        rest, flow = self._among_rest, self._among_flow
        # Elasticity, inertia and friction of the rows that are no flow, storage and seepage of those that are.
        strength = np.where(rest, own.data, matrix.data.real - np.where(flow, matrix.data.imag, 0.0))
        damping = matrix.data.imag.copy()
        for among, sizes in ((rest, strength), (flow, -matrix.data.real)):
            damping += self._lacking(damping, sizes, among) * np.where(among, sizes, 0.0)
        balance = csr_array((strength, matrix.indices, matrix.indptr), shape=matrix.shape)
        return Oscillation(self, matrix, lift, _doubled(matrix, damping), 1 / scales(balance, ~self._flow))

    def _lacking(self, damping: Array, sizes: Array, among: BoolArray) -> float:
        """What the damping of some rows lacks of `LEAST_DAMPING` times their sizes, on the diagonal."""
        chosen = self._diagonal[among[self._diagonal]]
        chosen = chosen[sizes[chosen] > 0]
        least = float((damping[chosen] / sizes[chosen]).min(initial=LEAST_DAMPING))
        return max(LEAST_DAMPING - least, 0.0)

    def _loss(self, name: str, parameters: Parameters) -> float:
        if name not in self._losses:
            return 0.0
        value = float(self._losses[name](parameters))
        if not 0 <= value < np.inf:
            raise ShapeError(
                f"loss of {name}: got {value:g}, expected a number, zero or more; less would feed the motion"
            )
        return value

    def _scaled(self, matrix: Any) -> Any:
        matrix.data *= np.repeat(self.scale, np.diff(matrix.indptr))
        return matrix

    @property
    def loads(self) -> Complex:
        """Forces (n_free, n_loads) of the free rows, scaled as they are, per unit of each load and of its factor."""
        return np.asarray(self.scale[:, None] * self._forces)


@dataclass(frozen=True, eq=False)
class Oscillation:
    """The system at one parameter vector.

    Parameters
    ----------
    system : HarmonicSystem
    matrix : (n_free, n_free) csr_array
        K, complex symmetric.
    lift : (n_free, n_dofs − n_free) csr_array
        Its columns of the constrained dofs.
    doubled : (2 n_free, 2 n_free) csr_array
        The real system to factorise, damped enough.
    size : (n_free,) array
        Sizes of the rows' residuals that count alike, as those of a time step do.
    """

    system: HarmonicSystem
    matrix: Any
    lift: Any
    doubled: Sparse
    size: Array

    def right_side(self, weights: Complex) -> Complex:
        """Return the right-hand side (n_free, k) for loads (n_loads, k), their factors included."""
        system = self.system
        return np.asarray(system.loads @ weights - self.lift @ (system.prescribed @ weights))

    def solve(self, right: Complex, method: SolverMethod, tolerance: float, analysis: Any = None) -> Complex:
        """Solve for the free dofs (n_free, k).

        Raises
        ------
        ConvergenceError
            If the residual of a column is not reached: nothing damps a motion at a resonance.
        """
        where = f"harmonic response at {self.system.frequency:g} Hz"
        n, out = len(right), np.empty_like(right)
        try:
            solver = prepared(method, self.doubled, self.system.definite, max(tolerance, _INNER), analysis)
            for column in range(right.shape[1]):
                out[:, column], left, used = flexible_gmres(
                    lambda x: (self.matrix @ x) / self.size,
                    lambda r: _joined(solver.solve(_parts(r * self.size)), n),
                    right[:, column] / self.size,
                    tolerance,
                    _MOST_ITERATIONS,
                )
                if not left <= tolerance:
                    raise ConvergenceError(
                        f"the relative residual stays at {left:.1e} after {used} iterations, wanted {tolerance:.1e}: "
                        "this is a resonance that next to nothing damps; give the material a loss, or change the "
                        "frequency"
                    )
        except ConvergenceError as error:
            raise ConvergenceError(f"{where}: {error}") from error
        return out


def harmonic_factor(load: Load, frequency: float) -> complex:
    """Return c with profile(t) = Re(c e^{iωt}); ShapeError if there is none."""
    advice = f"expected a sine or a cosine of {frequency:g} Hz (dacore.dynamics.profiles); leave other loads out"
    if load.initial is not None:
        raise ShapeError(f"load {load.name}: is a state to start from, and a harmonic motion has no start; {advice}")
    eighths = np.arange(_EIGHTHS) / _EIGHTHS
    seen = np.asarray(load.profile(eighths / frequency), dtype=np.float64)
    factor = complex(seen[0], -seen[_EIGHTHS // 4])
    off = np.abs((factor * np.exp(2j * np.pi * eighths)).real - seen).max()
    if not off <= 1e-9 * max(float(np.abs(seen).max()), 1e-300):
        raise ShapeError(f"load {load.name}: got a profile that is no oscillation of the frequency, {advice}")
    return factor


def _complex(real: Sparse, imaginary: Sparse) -> Any:
    """Return a matrix of two real ones of the same pattern."""
    return csr_array((real.data + 1j * imaginary.data, real.indices, real.indptr), shape=real.shape)


def _parts(columns: Complex) -> Array:
    """Right-hand side (2n,) of the doubled system for a complex one (n,)."""
    return np.concatenate([columns.imag, columns.real])


def _joined(doubled: Array, n: int) -> Complex:
    """Complex solution (n,) of that of the doubled system (2n,)."""
    return np.asarray(doubled[:n] + 1j * doubled[n:])


def _doubled(matrix: Any, damping: Array) -> Sparse:
    """Return [[D, B], [B, −D]] for K = B + iD with the entries of D given: rows stay sorted."""
    n, counts = matrix.shape[0], np.diff(matrix.indptr)
    place = np.arange(matrix.nnz) + np.repeat(matrix.indptr[:-1], counts)
    beside = place + np.repeat(counts, counts)
    indices = np.empty(2 * matrix.nnz, dtype=np.int32)
    indices[place], indices[beside] = matrix.indices, matrix.indices + n
    upper, lower = np.empty(2 * matrix.nnz), np.empty(2 * matrix.nnz)
    upper[place], upper[beside] = damping, matrix.data.real
    lower[place], lower[beside] = matrix.data.real, -damping
    starts = 2 * matrix.indptr.astype(np.int64)
    indptr = np.concatenate([starts, starts[-1] + starts[1:]]).astype(np.int32)
    out = csr_array((np.concatenate([upper, lower]), np.tile(indices, 2), indptr), shape=(2 * n, 2 * n))
    out.has_canonical_format = True
    return out


def _check_symmetry(matrix: Any) -> None:
    """AccuracyError unless the matrix, scaled to a unit diagonal where it has one, is symmetric."""
    largest = np.asarray(abs(matrix).max(axis=1).todense()).ravel()
    scale = 1.0 / np.sqrt(np.where(largest > 0, largest, 1.0))
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    scaled = csr_array((matrix.data * scale[rows] * scale[matrix.indices], matrix.indices, matrix.indptr), matrix.shape)
    error = float(abs(scaled - scaled.T).max())
    if error > _SYMMETRY_TOLERANCE * float(np.abs(scaled.data).max()):
        raise AccuracyError(
            f"harmonic system: unsymmetric by {error:.1e} after scaling; mark the rows of a flow as antisymmetric, and "
            "hold one of two coupled fields on every part of the boundary"
        )
